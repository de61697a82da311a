//! `rt-tests hosts`: station and controller on two hosts, with a link of any length and bandwidth
//! between them, beside the same touch on one machine.
//!
//! Both hosts are made of namespaces of this machine: they have nothing in common but the files of
//! its disk and its cores. `ve-station serve --listen` runs on one and `hrtc run --station` on the
//! other, as a user would start them, with keys made for them. Every packet between them goes
//! through a relay, which delays, queues, loses, cuts, changes, repeats and counts them.
//!
//! With `--controllers` each of several has a host and a link of its own to one station: first each
//! touches alone, then all at once.
//!
//! | module | holds |
//! |---|---|
//! | `points` | the links that are tried |
//! | `asked` | what is asked of some of them |
//! | `programs` | the two programs, and the rights that hosts need |
//! | `way` | what becomes of a packet: one direction of a link |
//! | `relay` | the thread that carries packets between the cables of hosts |
//! | `links` | hosts, each with a link to the station's |
//! | `touch` | one run over a link |
//! | `recorded` | the forces of two runs beside each other |
//! | `result`, `picture` | what was seen, as JSON, table and charts |
//!
//! With `--json` one object (`result`): `skipped` is a sentence where the rights are missing, or
//! null; `rows` has the touch on one machine first (`wire` is null), then one a link; with
//! `--controllers` one for each alone, then one for each among all (`controllers` is their number).
//! `full_share`, `certified_error_m`, `measured_error_m`, `heard_ms`, `ready_ms`,
//! `first_touch_ms`, `first_full_ms` and `bytes_per_vsp` are null where there is none: nothing was
//! touched, nothing came. Bytes and packets of `wire` are those of IP, of everything that the two
//! hosts said to each other from the start of the station to its end: greeting, encryption and
//! repetitions too.

mod asked;
pub(super) mod links;
mod picture;
pub(super) mod points;
pub(super) mod programs;
mod recorded;
pub(super) mod relay;
mod result;
pub(super) mod touch;
pub(super) mod way;

use self::asked::{ASKED, Asked};
use self::links::{Links, STATION};
use self::points::{Guest, Point, chosen, guests};
use self::programs::{Programs, missing_right};
use self::result::Found;
use self::touch::{Bench, CUT_SHARE};
use self::way::Shape;
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
use std::time::Instant;

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
    /// All round-trip times from 0.2 to 200 ms with all bandwidths from 0.25 to 100 Mbit/s: 48
    /// links, 11 minutes at 10 seconds each
    #[arg(long)]
    pub long: bool,
    /// The links of which something is asked: what it is, what was seen, and whether it was met;
    /// status 1 when it was not
    #[arg(long, conflicts_with_all = ["rtt_ms", "mbit", "long", "controllers", "loss", "jitter_ms",
        "cut", "damaged", "replayed"])]
    pub asked: bool,
    /// Several controllers at once, each RTT_MS:MBIT, or RTT_MS:MBIT:stopped for one that is
    /// stopped for the middle third of its touch
    #[arg(long, value_name = "LIST", value_delimiter = ',',
        conflicts_with_all = ["rtt_ms", "mbit", "long"])]
    pub controllers: Vec<String>,
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
    /// Share of the packets that somebody changes, so that no checksum of IP or TCP shows it
    #[arg(
        long,
        value_name = "SHARE",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub damaged: f64,
    /// Share of the packets that somebody sends once more, a second later
    #[arg(
        long,
        value_name = "SHARE",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub replayed: f64,
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
/// One sentence: status 2 for bad input and programs without the link, 1 when a run fails or
/// something was wrong whatever the link is like.
pub fn hosts(args: &HostsArgs) -> Result<(), Failure> {
    let touches = check(args)?;
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
    let found = run(args, &touches, plan.loop_.rate_hz, programs, file.path())?;
    write_json(&args.out.join("hosts.json"), &found)?;
    let charts = args.out.join("hosts.svg");
    write_whole(&charts, picture::draw(&found).as_bytes())?;
    let words = format!("{}\ncharts: {}\n", found.words(), charts.display());
    print_either(args.json, &words, &found)?;
    let wrong = found.wrong();
    if wrong.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(wrong.join("; ")))
}

/// Controllers that touch at the same time, and what is asked of the only one.
struct Touch {
    guests: Vec<Guest>,
    asked: Option<&'static Asked>,
}

impl Touch {
    fn of(guests: Vec<Guest>) -> Self {
        let asked = None;
        Self { guests, asked }
    }

    fn asked(asked: &'static Asked) -> Self {
        Self {
            guests: vec![asked.guest()],
            asked: Some(asked),
        }
    }
}

/// The touches, each with the controllers in it, if everything else is in its range.
fn check(args: &HostsArgs) -> Result<Vec<Touch>, Failure> {
    check_seconds(args.seconds)?;
    let longest_cut = CUT_SHARE * args.seconds;
    for (option, number, most) in [
        ("--loss", args.loss, 1.0),
        ("--jitter-ms", args.jitter_ms, 1000.0),
        ("--cut", args.cut, longest_cut),
        ("--damaged", args.damaged, 1.0),
        ("--replayed", args.replayed, 1.0),
    ] {
        if !(0.0..=most).contains(&number) {
            return Err(Failure::Input(format!(
                "{option} is {number}; write a number from 0 to {most}"
            )));
        }
    }
    if args.asked {
        return Ok(ASKED.iter().map(Touch::asked).collect());
    }
    let guests = guests(&args.controllers)?;
    let loses = |guest: Guest| Guest {
        point: guest.point.losing(args.loss),
        ..guest
    };
    let guests: Vec<Guest> = guests.into_iter().map(loses).collect();
    let alone = |point: Point| Touch::of(vec![loses(Guest::at(point))]);
    if guests.is_empty() {
        let points = chosen(&args.rtt_ms, &args.mbit, args.long)?;
        return Ok(points.into_iter().map(alone).collect());
    }
    let each: Vec<_> = guests.iter().map(|guest| alone(guest.point)).collect();
    Ok(each.into_iter().chain([Touch::of(guests)]).collect())
}

fn run(
    args: &HostsArgs,
    touches: &[Touch],
    rate_hz: f64,
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
    let seed = args.overrides.seed.unwrap_or(SEED);
    let bench = Bench {
        programs,
        scene,
        overrides: args.overrides.typed(),
        links: Links {
            keys,
            shape: Shape {
                jitter_s: args.jitter_ms * 1e-3,
                damaged: args.damaged,
                replayed: args.replayed,
                ..Shape::default()
            },
            seed,
        },
        folder: folder.path().to_path_buf(),
        seconds: args.seconds,
        rate_hz,
        cut_s: args.cut,
        stop: &stop,
    };
    let mut found = Found {
        machine: Some(Machine::read()),
        seconds: args.seconds,
        seed,
        loss: args.loss,
        jitter_ms: args.jitter_ms,
        cut_s: args.cut,
        damaged: args.damaged,
        replayed: args.replayed,
        ..Found::default()
    };
    let bar = status_line();
    let (begin, of) = (Instant::now(), touches.len());
    bar.set_message("one machine");
    found.add(bench.local()?, None);
    for (number, Touch { guests, asked }) in (1..).zip(touches) {
        let names = guests.iter().map(|guest| guest.point.to_string());
        let names = names.collect::<Vec<_>>().join(" and ");
        bar.set_message(format!("{names} ({number} of {of})"));
        for row in bench.linked(guests)? {
            found.add(row, *asked);
        }
        if args.long {
            let each_s = begin.elapsed().as_secs_f64() / (number + 1) as f64;
            let minutes = each_s * (of - number) as f64 / 60.0;
            bar.suspend(|| eprintln!("{names}: {number} of {of}, {minutes:.0} minutes more"));
        }
    }
    bar.finish_and_clear();
    Ok(found)
}
