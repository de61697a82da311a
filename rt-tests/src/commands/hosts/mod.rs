//! `rt-tests hosts`: station and controller on two hosts, with a link of any length and bandwidth
//! between them, beside the same touch on one machine.
//!
//! Both hosts are made of namespaces of this machine: they have nothing in common but the files of
//! its disk and its cores. `ve-station serve --listen` runs on one and `hrtc run --station` on the
//! other, as a user would start them, with keys made for them. Every packet between them goes
//! through a relay, which delays, queues, loses, cuts and counts them.
//!
//! | module | holds |
//! |---|---|
//! | `points` | the links that are tried |
//! | `programs` | the two programs, and the rights that hosts need |
//! | `way` | what becomes of a packet: one direction of a link |
//! | `relay` | the thread that carries packets between the cables of two hosts |
//! | `touch` | one run over a link |
//! | `result`, `picture` | what was seen, as JSON, table and charts |
//!
//! With `--json` one object (`result`): `skipped` is a sentence where the rights are missing, or
//! null; `rows` has the touch on one machine first (`wire` is null), then one a link. `full_share`,
//! `certified_error_m`, `measured_error_m`, `first_touch_ms` and `bytes_per_vsp` are null where
//! there is none: nothing was touched, nothing came. Bytes and packets of `wire`
//! are those of IP, of everything that the two hosts said to each other from the start of the
//! station to its end: greeting, encryption and repetitions too.

mod picture;
mod points;
mod programs;
mod relay;
mod result;
mod touch;
mod way;

use self::points::{Point, chosen};
use self::programs::{Programs, missing_right};
use self::result::Found;
use self::touch::{Bench, CUT_SHARE, STATION};
use crate::failure::Failure;
use crate::machine::Machine;
use crate::processes::stop::stop_flag;
use crate::report::output::{
    make_folder, print_either, print_json, status_line, write_json, write_whole,
};
use crate::scenes::{SceneFile, check_seconds, prepare_models};
use clap::Args;
use scene::load;
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use std::path::{Path, PathBuf};

/// Seed of losses and jitter, and of the tour, where none is given.
const SEED: u64 = 1;

/// Arguments of `rt-tests hosts`.
#[derive(Debug, Args)]
pub struct HostsArgs {
    /// Scene that both programs are given [default: the bundled first-touch scene]
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Round-trip times, each with every bandwidth
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub rtt_ms: Vec<f64>,
    /// Bandwidths of each direction, Mbit/s
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub mbit: Vec<f64>,
    /// All round-trip times from 0.2 to 200 ms with all bandwidths from 0.25 to 100 Mbit/s
    #[arg(long)]
    pub long: bool,
    /// Share of the packets that are lost, 0 to 1
    #[arg(
        long,
        value_name = "SHARE",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub loss: f64,
    /// Largest random delay of a packet, beside the round-trip time
    #[arg(
        long,
        value_name = "MS",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub jitter_ms: f64,
    /// Cut the cable for so long, a third of a touch after its start
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub cut: f64,
    /// Length of each touch
    #[arg(
        long,
        value_name = "S",
        default_value_t = 10.0,
        allow_negative_numbers = true
    )]
    pub seconds: f64,
    /// Over the scene; the seed is that of losses and jitter too.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Folder of hosts.json and the charts, hosts.svg
    #[arg(long, value_name = "DIR", default_value = "reports/hosts")]
    pub out: PathBuf,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for bad input and programs without the link, 1 when a run fails.
pub fn hosts(args: &HostsArgs) -> Result<(), Failure> {
    let points = check(args)?;
    let file = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let plan = load(file.path(), &args.overrides.overrides(), &DiskFiles)?;
    if let Some(why) = missing_right(STATION) {
        eprintln!("skipped: {why}");
        return if args.json {
            print_json(&Found::skipped(&why))
        } else {
            Ok(())
        };
    }
    let programs = Programs::find()?;
    make_folder(&args.out)?;
    prepare_models(&plan)?;
    let found = run(args, &points, programs, file.path())?;
    write_json(&args.out.join("hosts.json"), &found)?;
    let charts = args.out.join("hosts.svg");
    write_whole(&charts, picture::draw(&found).as_bytes())?;
    let words = format!("{}\ncharts: {}\n", found.words(), charts.display());
    print_either(args.json, &words, &found)
}

/// The links, if everything else is in its range.
fn check(args: &HostsArgs) -> Result<Vec<Point>, Failure> {
    check_seconds(args.seconds)?;
    let longest_cut = CUT_SHARE * args.seconds;
    for (option, number, most) in [
        ("--loss", args.loss, 1.0),
        ("--jitter-ms", args.jitter_ms, 1000.0),
        ("--cut", args.cut, longest_cut),
    ] {
        if !(0.0..=most).contains(&number) {
            return Err(Failure::Input(format!(
                "{option} is {number}; write a number from 0 to {most}"
            )));
        }
    }
    chosen(&args.rtt_ms, &args.mbit, args.long)
}

fn run(
    args: &HostsArgs,
    points: &[Point],
    programs: Programs,
    scene: &Path,
) -> Result<Found, Failure> {
    let stop = stop_flag()?;
    let folder = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
    let keys = folder.path().join("keys");
    programs.make_keys(&keys, &STATION.to_string())?;
    let scene = std::path::absolute(scene)
        .map_err(|error| Failure::Input(format!("{}: {error}", scene.display())))?;
    let bench = Bench {
        programs,
        scene,
        overrides: args.overrides.typed(),
        keys,
        seconds: args.seconds,
        cut_s: args.cut,
        jitter_s: args.jitter_ms * 1e-3,
        loss: args.loss,
        seed: args.overrides.seed.unwrap_or(SEED),
        stop: &stop,
    };
    let mut found = Found {
        machine: Some(Machine::read()),
        seconds: args.seconds,
        seed: bench.seed,
        loss: args.loss,
        jitter_ms: args.jitter_ms,
        cut_s: args.cut,
        ..Found::default()
    };
    let bar = status_line();
    bar.set_message("one machine");
    found.add(bench.local()?);
    for (number, point) in (1..).zip(points) {
        let Point { rtt_ms, mbit } = point;
        let of = points.len();
        bar.set_message(format!("{rtt_ms} ms, {mbit} Mbit/s ({number} of {of})"));
        found.add(bench.linked(*point)?);
    }
    bar.finish_and_clear();
    Ok(found)
}
