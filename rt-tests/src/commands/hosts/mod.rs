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
//! | `session` | the touches of a scene, one after another |
//! | `long` | the scenes and links of `--long` |
//! | `recorded` | the forces of two runs beside each other |
//! | `result`, `words`, `picture` | what was seen, as JSON, tables and charts |
//!
//! With `--long` the whole is done: what is asked, and the curves over distance and bandwidth, for
//! three models.
//!
//! With `--json` one object (`result`): `skipped` is a sentence where the rights are missing, or
//! null; `rows` has the touch on one machine first (`wire` is null), then one a link; with
//! `--controllers` one for each alone, then one for each among all (`controllers` is their number).
//! `full_share`, `certified_error_m`, `measured_error_m`, `heard_ms`, `ready_ms`,
//! `first_touch_ms`, `first_full_ms` and `bytes_per_vsp` are null where there is none: nothing was
//! touched, nothing came. Bytes and packets of `wire` are those of IP, of everything that the two
//! hosts said to each other from the start of the station to its end: greeting, encryption and
//! repetitions too; `link_bytes` has those of the messages alone, by kind. With `--long` there is
//! such an object for each model, in `parts`, and `left_out` names what is not there.

mod asked;
pub(super) mod links;
mod long;
mod picture;
pub(super) mod points;
pub(super) mod programs;
mod recorded;
pub(super) mod relay;
mod result;
mod session;
pub(super) mod touch;
pub(super) mod way;
mod words;

use self::asked::ASKED;
use self::links::STATION;
use self::long::{Plan, Whole};
use self::points::{Guest, Point, chosen, guests};
use self::programs::missing_right;
use self::result::Found;
use self::session::{Ask, Session, Setting, Touch};
use self::touch::CUT_SHARE;
use crate::failure::Failure;
use crate::report::output::{print_either, print_json, write_json, write_whole};
use crate::scenes::{SceneFile, check_seconds};
use clap::Args;
use scene_args::OverrideArgs;
use serde::Serialize;
use std::path::PathBuf;

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
    /// The whole, in at most 45 minutes at 10 seconds each: what is asked of the links, curves from
    /// 0.2 to 200 ms and from 0.25 to 100 Mbit/s for three models, three controllers at once
    #[arg(long, conflicts_with_all = ["scene", "rtt_ms", "mbit", "asked", "controllers", "loss",
        "jitter_ms", "cut", "damaged", "replayed", "model", "size", "tolerance"])]
    pub long: bool,
    /// Folder of stanford-bunny.obj and dragon.obj
    #[arg(long, value_name = "DIR", requires = "long")]
    pub models: Option<PathBuf>,
    /// Faces of the generated terrain
    #[arg(
        long,
        value_name = "N",
        requires = "long",
        default_value_t = 10_000_000
    )]
    pub terrain_faces: u32,
    /// The links of which something is asked: what it is, what was seen, and whether it was met;
    /// status 1 when it was not
    #[arg(long, conflicts_with_all = ["rtt_ms", "mbit", "controllers", "loss", "jitter_ms", "cut", "damaged", "replayed"])]
    pub asked: bool,
    /// Several controllers at once, each RTT_MS:MBIT, or RTT_MS:MBIT:stopped for one that is
    /// stopped for the middle third of its touch
    #[arg(long, value_name = "LIST", value_delimiter = ',',
        conflicts_with_all = ["rtt_ms", "mbit"])]
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
    if args.long {
        let plan = Plan::new(args)?;
        if let Some(why) = missing_right(STATION) {
            return skip(args, &why, &Whole::skipped(&why));
        }
        let whole = plan.run(args)?;
        let svg = picture::draw_whole(&whole.parts);
        let charts = args.out.join("hosts.svg");
        return tell(args, &svg, &whole.words(&charts), &whole, &whole.wrong());
    }
    let file = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let setting = Setting::new(file, &args.overrides, touches)?;
    if let Some(why) = missing_right(STATION) {
        return skip(args, &why, &Found::skipped(&why));
    }
    let found = Session::begin(args, 1 + setting.touches.len())?.run(&setting)?;
    let charts = args.out.join("hosts.svg");
    let words = format!("{}\ncharts: {}\n", found.words(), charts.display());
    tell(args, &picture::draw(&found), &words, &found, &found.wrong())
}

fn skip(args: &HostsArgs, why: &str, found: &impl Serialize) -> Result<(), Failure> {
    eprintln!("skipped: {why}");
    if args.json { print_json(found) } else { Ok(()) }
}

/// Writes and prints what was found; what must not be is the failure.
fn tell(
    args: &HostsArgs,
    svg: &str,
    words: &str,
    found: &impl Serialize,
    wrong: &[String],
) -> Result<(), Failure> {
    write_json(&args.out.join("hosts.json"), found)?;
    write_whole(&args.out.join("hosts.svg"), svg.as_bytes())?;
    print_either(args.json, words, found)?;
    if wrong.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(wrong.join("; ")))
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
    let alone = |point: Point| Touch::alone(point.losing(args.loss));
    if guests.is_empty() {
        let points = chosen(&args.rtt_ms, &args.mbit)?;
        return Ok(points.into_iter().map(alone).collect());
    }
    let each: Vec<_> = guests.iter().map(|guest| alone(guest.point)).collect();
    let ask = Ask::Nothing;
    Ok(each.into_iter().chain([Touch { guests, ask }]).collect())
}
