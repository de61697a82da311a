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
//! Without arguments the whole is done: what is asked of links and the curves over distance and
//! bandwidth for three models, then who is refused at a link, then links that are cut, killed and
//! restarted in contact. With `--short` four links, and who is refused.
//!
//! | module | holds |
//! |---|---|
//! | `asked` | what is asked of some links |
//! | `touch` | one run over a link |
//! | `session` | the touches of a scene, one after another |
//! | `long` | the scenes and links of the whole |
//! | `alone`, `refused` | who is refused at a link |
//! | `recorded` | the forces of two runs beside each other |
//! | `result`, `words`, `picture` | what was seen, as rows, tables and charts |
//! | `whole` | the result of the command |
//!
//! With `--json` one object: `skipped` is a sentence where the rights are missing, or null;
//! `left_out` names what is not there; `scenes` has one of each model, `rows` every touch of all.
//! Of each scene the touch on one machine is first (`wire` is null, `rtt_ms`, `loss` and `mbit` are
//! 0), then comes one a link; with several controllers one for each alone, then one for each among
//! all (`controllers` is their number). `full_share`, `certified_error_m`, `measured_error_m`,
//! `heard_ms`, `first_force_ready_ms`, `first_touch_ms`, `local_full_ms` and `bytes_per_vsp` are
//! null where there is none: nothing was touched, no contact has a certified error, nothing came.
//! `local_full_ms` is the time from the first tick in contact to the first in contact at full
//! resolution. Bytes and packets of `wire` are those of IP, of everything that the two hosts said
//! to each other from the start of the station to its end: greeting, encryption and repetitions
//! too; `link_bytes` has those of the messages alone, by kind. `cut` is null where no link was cut,
//! `refused` empty where nobody came. `failed` has what came to no result: touches, and a part that
//! failed, with which the command ends; what was measured before it is there all the same.

mod alone;
mod asked;
mod long;
mod picture;
mod recorded;
mod refused;
mod result;
mod session;
mod touch;
mod whole;
mod words;

use self::asked::ASKED;
use self::long::Plan;
use self::refused::Refused;
use self::session::{Ask, Session, Setting, Touch};
use self::touch::CUT_SHARE;
use self::whole::{Cut, Whole};
use crate::failure::Failure;
use crate::links::hosts::STATION;
use crate::links::points::{Guest, Point, chosen, guests};
use crate::links::programs::missing_right;
use crate::processes::stop::stop_flag;
use crate::report::output::{print_either, print_json, write_json, write_whole};
use crate::report::units::grouped;
use crate::scenes::{SceneFile, check_seconds};
use clap::Args;
use scene_args::OverrideArgs;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Options of which none is for the whole.
const NOT_LONG: [&str; 14] = [
    "short",
    "scene",
    "rtt_ms",
    "mbit",
    "asked",
    "controllers",
    "loss",
    "jitter_ms",
    "cut",
    "damaged",
    "replayed",
    "model",
    "size",
    "tolerance",
];

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
    /// 0.2 to 200 ms and from 0.25 to 100 Mbit/s for three models, three controllers at once; who
    /// is refused; links cut, killed and restarted in contact. So it is without any of the options
    /// that it excludes
    #[arg(long, conflicts_with_all = NOT_LONG)]
    pub long: bool,
    /// Four links only, and who is refused
    #[arg(long, conflicts_with_all = ["rtt_ms", "mbit", "asked", "controllers"])]
    pub short: bool,
    /// Folder of stanford-bunny.obj and dragon.obj [default: ../shared/models]
    #[arg(long, value_name = "DIR", conflicts_with_all = NOT_LONG)]
    pub models: Option<PathBuf>,
    /// Faces of the generated terrain
    #[arg(long, value_name = "N", default_value_t = 10_000_000, conflicts_with_all = NOT_LONG)]
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

impl HostsArgs {
    /// Whether the whole is asked for: nothing that it excludes was typed.
    #[must_use]
    pub fn is_long(&self) -> bool {
        let of = &self.overrides;
        let shares = [
            self.loss,
            self.jitter_ms,
            self.cut,
            self.damaged,
            self.replayed,
        ];
        let is_other = self.short
            || self.scene.is_some()
            || !(self.rtt_ms.is_empty() && self.mbit.is_empty() && self.controllers.is_empty())
            || self.asked
            || shares != [0.0; 5]
            || of.model.is_some()
            || of.size.is_some()
            || of.tolerance.is_some();
        self.long || !is_other
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for bad input and programs without the link, 1 when a run fails or
/// something was wrong whatever the link is like.
pub fn hosts(args: &HostsArgs) -> Result<(), Failure> {
    let touches = check(args)?;
    // Before the first file in a temporary folder: an end on request removes it.
    let stop = stop_flag()?;
    let plan = if args.is_long() {
        Plan::new(args)?
    } else {
        let file = SceneFile::named_or_bundled(args.scene.as_deref())?;
        Plan {
            settings: vec![Setting::new(file, &args.overrides, touches)?],
            left_out: Vec::new(),
        }
    };
    if let Some(why) = missing_right(STATION) {
        eprintln!("skipped: {why}");
        let skipped = Whole::skipped(&why);
        return if args.json {
            print_json(&skipped.json())
        } else {
            Ok(())
        };
    }
    tell(args, &run(args, plan, stop)?)
}

/// Runs all; a failure on the way is said beside what was measured before it.
fn run(args: &HostsArgs, plan: Plan, stop: Arc<AtomicBool>) -> Result<Whole, Failure> {
    let of = plan.touches();
    let mut session = Session::begin(args, of, stop)?;
    for sentence in &plan.left_out {
        eprintln!("{sentence}");
    }
    if args.is_long() {
        eprintln!(
            "{of} touches; a terrain of {} faces is built first where it is not kept yet, which takes minutes",
            grouped(u64::from(args.terrain_faces))
        );
    }
    let mut whole = Whole {
        left_out: plan.left_out,
        ..Whole::default()
    };
    match measure(args, &plan.settings, &mut session, &mut whole) {
        Ok(()) => Ok(whole),
        Err(failure) => whole.ended_by(failure),
    }
}

/// Touches, then who is refused, then what is done to links.
fn measure(
    args: &HostsArgs,
    settings: &[Setting],
    session: &mut Session<'_>,
    whole: &mut Whole,
) -> Result<(), Failure> {
    for setting in settings {
        let mut found = session.found(setting);
        let ended = session.run(setting, &mut found);
        if !found.rows.is_empty() {
            whole.parts.push(found);
        }
        ended?;
    }
    if args.short || args.is_long() {
        whole.refused = session.refuse()?;
    }
    if args.is_long() {
        let faults = session.disturb()?;
        whole.refused.extend(Refused::packets(&faults));
        whole.cut = Some(Cut::of(faults));
    }
    Ok(())
}

/// Writes and prints what was found; what must not be is the failure.
fn tell(args: &HostsArgs, whole: &Whole) -> Result<(), Failure> {
    let charts = args.out.join("hosts.svg");
    let svg = match &whole.parts[..] {
        [part] if !args.is_long() => picture::draw(part),
        parts => picture::draw_whole(parts),
    };
    let json = whole.json();
    write_json(&args.out.join("hosts.json"), &json)?;
    write_whole(&charts, svg.as_bytes())?;
    print_either(args.json, &whole.words(&charts), &json)?;
    let wrong = whole.wrong();
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
