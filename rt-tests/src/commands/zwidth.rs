//! `rt-tests zwidth`: the stiffest wall that a loop with the period of this machine can render
//! without putting energy into the hand, by simulated bounces and in theory.
//!
//! The period of the loop is measured in a run of both processes; the delay of the force in virtual
//! time, from the energy that a bounce off a wall leaks: K (T/2 + n T) times the integral of v² for
//! n whole ticks of delay (Gil 2009). Then walls of any stiffness are hit with the scene's own
//! device, in nobody's hand, at that period: the stiffest one that never gives back more than the
//! device damps is the limit, K = b / (T/2 + n T) in theory (Colgate 1994). The energy
//! account is off for that; how far it reaches beyond is simulated too. Theory holds for any motion
//! of the hand, the bounces are single ones: their limit may lie above it.

use crate::cases::bench::{Fault, Setup};
use crate::cases::walls::{bounce_of, wall};
use crate::failure::Failure;
use crate::processes::pair::{PairArgs, Shown, run_pair};
use crate::processes::roles::LoopArgs;
use crate::processes::stop::stop_flag;
use crate::report::chart::{
    Axis, COLORS, Chart, Curve, GREY, Ground, Names, Stroke, Unit, grid, xs, ys,
};
use crate::report::output::{make_folder, print_either, write_whole};
use crate::report::table::Table;
use crate::scenes::{SceneFile, check_seconds, prepare_models};
use clap::Args;
use scene::load;
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Dampings that the curve is drawn over, N s/m.
const DAMPINGS: [f64; 7] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0];
/// Speeds of the bounces, m/s, and how many bounces at each, touching first at another share of a
/// period.
const SPEEDS: [f64; 4] = [0.05, 0.1, 0.2, 0.5];
const PHASES: u32 = 8;
/// The stiffest wall that is tried, N/m: beyond it a bounce lasts less than a period.
const STIFFEST: f64 = 1e5;
/// Halvings of the interval that the limit lies in: to a hundredth of a per cent of its logarithm.
const HALVINGS: u32 = 17;
/// Height of the picture, pixels.
const PICTURE_HEIGHT: f64 = 320.0;

/// Arguments of `rt-tests zwidth`.
#[derive(Debug, Args)]
pub struct ZwidthArgs {
    /// Scene whose loop and device are measured [default: the bundled first-touch scene]
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Length of the run that measures the period
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Folder of the picture
    #[arg(long, value_name = "DIR", default_value = "reports/zwidth")]
    pub out: PathBuf,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Zwidth {
    /// The stiffest wall that put no energy out, N/m.
    pub k_max_measured: f64,
    /// ... and in theory.
    pub k_max_theory: f64,
    /// Median of the loop's period, seconds.
    pub period_s: f64,
    /// Delay of the force beyond the hold of a period, ticks.
    pub delay_ticks: f64,
    /// Damping of the device, N s/m.
    pub damping: f64,
    /// Its mass, kg.
    pub mass_kg: f64,
    /// The longest period that the run had, seconds; a missed one counts.
    pub longest_period_s: f64,
    /// Periods that were missed in the run, and all of them.
    pub missed: u64,
    /// ...
    pub ticks: u64,
    /// What theory allows at the longest period, N/m.
    pub k_max_longest_period: f64,
    /// The stiffest wall that put no energy out with the energy account, N/m, of those up to 100
    /// kN/m.
    pub k_max_with_account: f64,
    /// The limit over the damping of a device.
    pub curve: Vec<Limit>,
}

/// The limit of a device.
#[derive(Debug, Serialize)]
pub struct Limit {
    /// N s/m.
    pub damping: f64,
    /// N/m.
    pub k_max_measured: f64,
    /// N/m.
    pub k_max_theory: f64,
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status.
pub fn zwidth(args: &ZwidthArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    let scene = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let plan = load(scene.path(), &args.overrides.overrides(), &DiskFiles)?;
    make_folder(&args.out)?;
    prepare_models(&plan)?;
    eprintln!("the period is measured for {} s", args.seconds);
    let stop = stop_flag()?;
    let pair = PairArgs {
        scene: scene.path(),
        plan: &plan,
        seconds: args.seconds,
        overrides: &args.overrides,
        loop_: LoopArgs::default(),
        record: None,
    };
    let mut show = |shown: Shown| {
        if let Shown::Said(who, line) = shown {
            eprintln!("{who}: {line}");
        }
    };
    let outcome = run_pair(&pair, &stop, &mut show)?;
    outcome.check_finite()?;
    let run = outcome.finished.result;
    let period_s = run.period_us.p50 * 1e-6;
    let device = plan.probes[0].device;
    let found = measure(
        Loop {
            period_s,
            longest_period_s: (run.period_us.max * 1e-6).max(period_s),
            missed: run.missed,
            ticks: run.ticks,
        },
        [device.mass_kg, device.damping_ns_per_m],
    )?;
    let picture = args.out.join("zwidth.svg");
    write_whole(&picture, draw(&found).as_bytes())?;
    let words = format!("{}picture: {}\n", words(&found), picture.display());
    print_either(args.json, &words, &found)
}

/// What was seen of a loop.
#[derive(Debug, Clone, Copy)]
pub struct Loop {
    /// Median of its period, seconds.
    pub period_s: f64,
    /// The longest.
    pub longest_period_s: f64,
    /// Periods missed.
    pub missed: u64,
    /// Ticks run.
    pub ticks: u64,
}

/// Finds the limit of a loop and a device of a mass, kg, and a damping, N s/m.
///
/// # Errors
/// When the wall cannot be served.
pub fn measure(of: Loop, [mass_kg, damping]: [f64; 2]) -> Result<Zwidth, Failure> {
    let period_s = of.period_s;
    let delay_ticks = delay(period_s)?;
    let theory = |damping: f64, period_s: f64| damping / (period_s * (0.5 + delay_ticks));
    let mut curve = Vec::new();
    for damping in DAMPINGS {
        curve.push(Limit {
            damping,
            k_max_measured: stiffest(period_s, [mass_kg, damping], false)?,
            k_max_theory: theory(damping, period_s),
        });
    }
    Ok(Zwidth {
        k_max_measured: stiffest(period_s, [mass_kg, damping], false)?,
        k_max_theory: theory(damping, period_s),
        period_s,
        delay_ticks,
        damping,
        mass_kg,
        longest_period_s: of.longest_period_s,
        missed: of.missed,
        ticks: of.ticks,
        k_max_longest_period: theory(damping, of.longest_period_s),
        k_max_with_account: stiffest(period_s, [mass_kg, damping], true)?,
        curve,
    })
}

/// Every bounce off a wall: the energy put out, joules, and the integral of the squared speed.
fn bounces(
    setup: Setup,
    device: [f64; 2],
    mut visit: impl FnMut(f64, f64) -> bool,
) -> Result<(), Failure> {
    let mut bench = wall(setup)?;
    for speed in SPEEDS {
        for k in 0..PHASES {
            let phase = (f64::from(k) + 0.5) / f64::from(PHASES);
            let bounce = bounce_of(&mut bench, device, speed, phase);
            if !visit(bounce.energy_j, bounce.travel) {
                return Ok(());
            }
        }
    }
    Ok(())
}

/// Delay of the force in ticks, beyond the hold of a period: from the leak of a soft wall, where
/// theory is exact.
fn delay(period_s: f64) -> Result<f64, Failure> {
    let setup = Setup {
        rate_hz: 1.0 / period_s,
        stiffness_n_per_m: 100.0,
        ..Setup::with(Fault::None)
    };
    let held = setup.stiffness_n_per_m * period_s;
    let (mut energy, mut travel) = (0.0, 0.0);
    bounces(setup, [0.1, 0.0], |energy_j, squared| {
        energy += energy_j;
        travel += squared;
        true
    })?;
    Ok((energy / (held * travel) - 0.5).max(0.0))
}

/// The stiffest wall off which no bounce takes more energy than the device damps, N/m.
fn stiffest(period_s: f64, device: [f64; 2], passivity: bool) -> Result<f64, Failure> {
    let [_, damping] = device;
    let holds = |stiffness_n_per_m: f64| -> Result<bool, Failure> {
        let setup = Setup {
            rate_hz: 1.0 / period_s,
            stiffness_n_per_m,
            passivity,
            ..Setup::with(Fault::None)
        };
        let mut holds = true;
        bounces(setup, device, |energy, travel| {
            holds = energy <= damping * travel;
            holds
        })?;
        Ok(holds)
    };
    if holds(STIFFEST)? {
        return Ok(STIFFEST);
    }
    let (mut low, mut high) = (1.0f64, STIFFEST);
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if holds(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(low)
}

fn words(found: &Zwidth) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "loop        period {:.1} µs at median, {:.1} µs at most; {} of {} period(s) missed\n            the force comes {:.3} tick(s) later than a hold of one period makes it",
        found.period_s * 1e6,
        found.longest_period_s * 1e6,
        found.missed,
        found.missed + found.ticks,
        found.delay_ticks
    );
    let _ = writeln!(
        text,
        "device      {} kg, {} N s/m, in nobody's hand\nstiffest    {:.0} N/m put no energy out in simulated bounces; theory says {:.0} N/m\n            at the longest period theory says {:.0} N/m\n            with the energy account {}{:.0} N/m",
        found.mass_kg,
        found.damping,
        found.k_max_measured,
        found.k_max_theory,
        found.k_max_longest_period,
        if found.k_max_with_account >= STIFFEST {
            "at least "
        } else {
            ""
        },
        found.k_max_with_account
    );
    let heads = "damping\nN s/m | simulated\nN/m | theory\nN/m";
    let mut table = Table::new(0, heads);
    for limit in &found.curve {
        table.row([
            limit.damping.to_string(),
            format!("{:.0}", limit.k_max_measured),
            format!("{:.0}", limit.k_max_theory),
        ]);
    }
    let _ = write!(text, "\n{table}");
    text
}

/// The limit over the damping, as SVG.
fn draw(found: &Zwidth) -> String {
    let curve = |label: &str, color, stroke, of: fn(&Limit) -> f64| {
        let points = found.curve.iter().map(|limit| (limit.damping, of(limit)));
        Curve::new(label, color, stroke, points)
    };
    let here = [(found.damping, found.k_max_measured)];
    let curves = vec![
        curve("theory: b / (T/2 + n T)", GREY, Stroke::Line, |limit| {
            limit.k_max_theory
        }),
        curve("simulated bounces", COLORS[0], Stroke::Dots, |limit| {
            limit.k_max_measured
        }),
        Curve::new("this device", COLORS[1], Stroke::Dots, here),
    ];
    let x = Axis::over("damping of the device, N s/m", Unit::Number, xs(&curves));
    let y = Axis::over("N/m", Unit::Number, ys(&curves));
    let mut chart = Chart::new("Stiffest wall that puts no energy out", x, y, curves);
    chart.names = Names::Legend;
    grid(&[chart], 1, PICTURE_HEIGHT, Ground::Paper)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_follows_theory_over_period_and_damping() {
        for period_s in [5e-4, 1e-3, 2e-3] {
            let found = measure(
                Loop {
                    period_s,
                    longest_period_s: period_s,
                    missed: 0,
                    ticks: 1,
                },
                [0.1, 1.0],
            )
            .expect("the wall is there");
            assert!(found.delay_ticks < 0.05, "{found:?}");
            let ratio = found.k_max_measured / found.k_max_theory;
            assert!((0.85..1.2).contains(&ratio), "{found:?}");
            assert!(
                found.k_max_with_account > 4.0 * found.k_max_measured,
                "{found:?}"
            );
        }
    }
}
