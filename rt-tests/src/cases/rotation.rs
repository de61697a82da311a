//! Tools that are turned by a hand against what holds them: the energy that their rendering puts
//! out, measured at the device.
//!
//! The hand presses and turns by swings of several frequencies, and lifts the tool off every few
//! seconds. The surface has no damping of its own, so that nothing but the account of the product
//! keeps the rendering passive.
//!
//! Energy is that of a touch: what the motors did since the tool was last off what it touches. What
//! a touch dissipates excuses no other. That of the whole run counts too: what each touch may put
//! out must not add up. The account of the product has no part in it: neither what it says was put
//! out, nor what it says was given.

use super::case::{Case, Found, ProbeOfCase, Run, Size, Trial, positive};
use super::held_tool::{HeldTool, box_tool, plan};
use super::setup::Setup;
use crate::failure::Failure;
use crate::models::profiles::{extruded, revolved};
use crate::models::surface::unit;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use hrtc_core::record::max_or_nan;
use mutants::Mutant;
use rand_xoshiro::Xoshiro256PlusPlus;
use scene::ProbeShape;
use spm_builder::SoupMesh;
use std::f64::consts::TAU;

/// Energy that a balance at a device does not tell from 0, joules: of 1 N over a tenth of an
/// encoder's step.
const ENERGY_SEEN_J: f64 = 1e-6;

/// Energy that a touch is known to put out, joules, where contacts are found late: a contact that
/// is found a tick late is held by a spring that nobody pressed, of `K (u T)² / 2` at a speed u.
/// Hand and lift move the farthest corner by up to 0.1 m/s, so that it is 2e-5 J at 4 kN/m and
/// 1 kHz, and 8e-5 J at 250 Hz, as K T² goes with the period. Of five in a touch.
const FOUND_LATE_J: f64 = 4e-4;

/// A row of this file.
const fn of(name: &'static str, runs: &'static str, run: Run) -> Case {
    Case {
        facts: "issue 23: energy put out at most 0, measured at the device, over ten minutes",
        runs,
        probe: ProbeOfCase::Tool,
        ..Case::of(
            [
                name,
                "",
                "energy put out at the device in a touch, and in all, J",
            ],
            ENERGY_SEEN_J,
            Mutant::Passivity,
            run,
        )
    }
}

/// The same where contacts are found late, and what they give is not taken back.
const fn late(name: &'static str, runs: &'static str, run: Run) -> Case {
    Case {
        open: "a contact that is found a tick late gives K (u T)²/2 that nobody paid for, 2e-5 J at 4 kN/m and \
               0.1 m/s; the product puts it out on purpose, so that a late contact has a force",
        known: FOUND_LATE_J,
        ..of(name, runs, run)
    }
}

/// The cases of this file.
pub const CASES: &[Case] = &[
    of(
        "turned-in-slot",
        "blade of 2 mm in a slot of 2.2 mm, turned and tilted; 800 N/m; and without encoder steps, turned back \
         before it is lifted",
        in_slot,
    ),
    late(
        "turned-in-slot-stiff",
        "the same at 4000 N/m",
        in_slot_stiff,
    ),
    of(
        "twisted-on-plate",
        "box flat on a plate, twisted and tilted; 800 N/m",
        on_plate,
    ),
    late(
        "twisted-on-plate-stiff",
        "the same at 4000 N/m",
        on_plate_stiff,
    ),
    late(
        "tilted-in-hole",
        "rod of 2 mm in a hole with 0.1 mm of play, tilted; 800 N/m",
        in_hole,
    ),
    late(
        "tilted-in-hole-stiff",
        "the same at 4000 N/m",
        in_hole_stiff,
    ),
    of(
        "rocked-on-edge",
        "bar across an edge of 90 degrees, rocked; 800 N/m",
        on_edge,
    ),
    late(
        "rocked-on-edge-stiff",
        "the same at 4000 N/m",
        on_edge_stiff,
    ),
    Case {
        runs: "the tools of the cases above but the bar, in contact, and a ball on the plate, wherever it is behind it; 800 N/m",
        probe: ProbeOfCase::Tool,
        ..Case::of(
            [
                "turned-force",
                "",
                "force that is withheld, summed over the ticks, of the force that is wanted",
            ],
            MAX_WITHHELD,
            Mutant::Mute,
            withheld,
        )
    },
    Case {
        runs: "the bar across an edge",
        open: "at some seeds: it touches by some 0.3 mm for seconds, and trembles. Hold and encoder put out as much as \
               its spring holds, several times over; 0.62 at seed 10, beyond the limit at 4 of 24 seeds",
        known: 0.75,
        probe: ProbeOfCase::Tool,
        ..Case::of(
            ["turned-force-on-edge", "", "the same"],
            MAX_WITHHELD,
            Mutant::Mute,
            withheld_on_edge,
        )
    },
];

/// A surface, N/m and N s/m, and the keys of a device.
type Rendered = ([f64; 2], &'static str);

/// The default stiffness, through encoders. Neither surface has damping of its own.
const SOFT: Rendered = ([800.0, 0.0], "renders = 6");
/// One whose hold leaks twice the energy that the device damps (K T / 2 = 2 N s/m, b = 1 N s/m),
/// without encoder steps: beyond 2 b / T no account that sees the device through encoders is exact
/// (Abbott 2005).
const STIFF: Rendered = (
    [4000.0, 0.0],
    "renders = 6, encoder_m = 0.0, encoder_rad = 0.0",
);
/// The default stiffness, as [`SOFT`], through exact encoders.
const EXACT: Rendered = (
    [800.0, 0.0],
    "renders = 6, encoder_m = 0.0, encoder_rad = 0.0",
);
/// Length of a run, seconds: quick, full (ten minutes).
const SECONDS: [u64; 2] = [5, 600];
/// Frequencies of the swings, Hz: no two have a short common period. The last is a tremor.
const SWINGS_HZ: [f64; 4] = [0.31, 0.73, 1.27, 7.9];
/// Share of each swing.
const SHARES: [f64; 4] = [0.4, 0.3, 0.25, 0.05];
/// Period of the lifts, seconds.
const LIFT_PERIOD_S: f64 = 4.0;
/// Least torque that a run must have rendered, newton metres; in proportion to the stiffness where
/// that is less than at 1 kHz.
const MIN_TORQUE_NM: f64 = 1e-3;

/// Share of the wanted force that may be withheld: a controller that renders nothing is passive,
/// too. On its way in a device pays, so that nothing is to be withheld; on its way out at most half
/// of the force, which is still more than a hand takes for a surface that is not there. Both have
/// the same places, and so as much force that is wanted: half of one half. A third of every force
/// leaves 0.67.
const MAX_WITHHELD: f64 = 0.25;

/// A tool on an object, and what the hand does with it.
struct Held {
    mesh: SoupMesh,
    tool: ProbeShape,
    /// Middle of the swings, metres, pressed into what is touched.
    at: DVec3,
    /// Amplitudes: metres, and radians about the world's axes.
    swings: [DVec3; 2],
    /// Height of a lift, metres.
    lift_m: f64,
    /// Share of a lift from which on it is upright, and in the middle.
    upright: f64,
}

/// A blade of 2 mm in a slot of 2.2 mm: it is held against turning and tilting.
fn slot() -> Held {
    let profile = [
        [-10.0, 0.0],
        [-1.1, 0.0],
        [-1.1, -9.0],
        [1.1, -9.0],
        [1.1, 0.0],
        [10.0, 0.0],
    ];
    Held {
        mesh: extruded(&profile, 30.0),
        tool: box_tool(DVec3::new(1e-3, 1e-2, 5e-3)),
        at: DVec3::new(0.0, 0.0, -5e-3),
        swings: [DVec3::new(5e-4, 1e-3, 1.5e-3), DVec3::new(0.1, 0.1, 0.3)],
        lift_m: 0.015,
        upright: 1.0,
    }
}

/// The same, which is turned back within the slot. One that is lifted while the walls turn it loses
/// what its spring holds, 1e-3 J, where the hold of a touch without an account puts out 1e-4 J.
fn slot_turned_back() -> Held {
    Held {
        upright: 0.5,
        ..slot()
    }
}

/// See [`slot`] and [`slot_turned_back`]: the latter through exact encoders, since nothing is lost
/// in it, so that what an encoder's step hides would be seen.
fn in_slot(trial: Trial<'_>) -> Result<Found, Failure> {
    let Trial {
        size,
        random,
        defaults,
    } = trial;
    let mut found = Found::new(f64::NEG_INFINITY);
    for (held, surface) in [(slot(), SOFT), (slot_turned_back(), EXACT)] {
        touches(&held, surface, (size, random, defaults), &mut found)?;
    }
    Ok(found)
}

/// See [`slot`].
fn in_slot_stiff(trial: Trial<'_>) -> Result<Found, Failure> {
    passivity(trial, &slot(), STIFF)
}

/// A box flat on a plate, which is twisted and tilted.
fn plate() -> Held {
    Held {
        mesh: extruded(&[[-25.0, 0.0], [25.0, 0.0]], 50.0),
        tool: box_tool(DVec3::new(1e-2, 1e-2, 5e-3)),
        at: DVec3::new(0.0, 0.0, 4e-3),
        swings: [DVec3::new(5e-3, 5e-3, 1e-3), DVec3::new(0.2, 0.2, 0.6)],
        lift_m: 0.01,
        upright: 1.0,
    }
}

/// A ball as large as that box on the same plate. Nothing turns it.
fn ball() -> Held {
    Held {
        tool: ProbeShape::Sphere { radius_m: 5e-3 },
        ..plate()
    }
}

/// See [`plate`].
fn on_plate(trial: Trial<'_>) -> Result<Found, Failure> {
    passivity(trial, &plate(), SOFT)
}

/// See [`plate`].
fn on_plate_stiff(trial: Trial<'_>) -> Result<Found, Failure> {
    passivity(trial, &plate(), STIFF)
}

/// A rod of 2 mm in a hole with 0.1 mm of play, which is tilted.
fn hole() -> Held {
    Held {
        // A hole of this radius and depth in a plate.
        mesh: revolved(&[[2.1, -10.0], [2.1, 0.0], [12.0, 0.0]], 96),
        tool: ProbeShape::Cylinder {
            radius_m: 2e-3,
            length_m: 0.03,
            faces: 240,
        },
        at: DVec3::new(0.0, 0.0, -7e-3),
        swings: [DVec3::new(5e-4, 5e-4, 2e-3), DVec3::new(0.2, 0.2, 0.3)],
        lift_m: 0.012,
        upright: 1.0,
    }
}

/// See [`hole`].
fn in_hole(trial: Trial<'_>) -> Result<Found, Failure> {
    passivity(trial, &hole(), SOFT)
}

/// See [`hole`].
fn in_hole_stiff(trial: Trial<'_>) -> Result<Found, Failure> {
    passivity(trial, &hole(), STIFF)
}

/// A bar across an edge of 90 degrees, on which it rocks.
fn edge() -> Held {
    Held {
        mesh: extruded(&[[-20.0, -20.0], [0.0, 0.0], [20.0, -20.0]], 40.0),
        tool: box_tool(DVec3::new(1.5e-2, 3e-3, 2e-3)),
        at: DVec3::new(0.0, 0.0, 1e-3),
        swings: [DVec3::new(8e-3, 4e-3, 5e-4), DVec3::new(0.1, 0.3, 0.3)],
        lift_m: 0.01,
        upright: 1.0,
    }
}

/// See [`edge`].
fn on_edge(trial: Trial<'_>) -> Result<Found, Failure> {
    passivity(trial, &edge(), SOFT)
}

/// See [`edge`].
fn on_edge_stiff(trial: Trial<'_>) -> Result<Found, Failure> {
    passivity(trial, &edge(), STIFF)
}

/// A tool on a surface by a device, the hand that leads it, and for how many ticks.
fn held_by_hand<'a>(
    held: &'a Held,
    ([stiffness, damping], device): Rendered,
    (size, random, defaults): (&Size, &mut Xoshiro256PlusPlus, Setup),
) -> Result<(HeldTool, Swings<'a>, u64), Failure> {
    let scaled = [stiffness * defaults.stiffer(), damping];
    let mut plan = plan(&held.tool, scaled, device)?;
    plan.loop_ = plan.loop_.at_rate(defaults.rate_hz);
    plan.cache_bytes = defaults.cache_bytes(plan.cache_bytes);
    let mut hand = Swings::new(held, random);
    let tool = HeldTool::new(&plan, &defaults, held.mesh.clone(), hand.pose(0.0))?;
    let ticks = size.of(SECONDS[0], SECONDS[1]) * plan.loop_.rate_hz as u64;
    Ok((tool, hand, ticks))
}

/// Energy that a touch has put out at the device.
#[derive(Default)]
struct Touch {
    /// Work of the motors before it, joules.
    before_j: f64,
}

impl Touch {
    /// What it has put out by a tick, joules, of the work of the motors so far. With the tool off
    /// what it touches, another one begins.
    fn put_out_j(&mut self, work_j: f64, is_off: bool) -> f64 {
        if is_off {
            self.before_j = work_j;
        }
        work_j - self.before_j
    }
}

/// Energy put out at the device in a touch, joules, the largest at any time, or in the whole run:
/// its true motion times what its motors render, whatever the account of the product says.
fn passivity(trial: Trial<'_>, held: &Held, surface: Rendered) -> Result<Found, Failure> {
    let Trial {
        size,
        random,
        defaults,
    } = trial;
    let mut found = Found::new(f64::NEG_INFINITY);
    touches(held, surface, (size, random, defaults), &mut found)?;
    Ok(found)
}

/// The same, beside what was found before.
fn touches(
    held: &Held,
    surface: Rendered,
    run: (&Size, &mut Xoshiro256PlusPlus, Setup),
    found: &mut Found,
) -> Result<(), Failure> {
    let defaults = run.2;
    let (mut tool, mut hand, ticks) = held_by_hand(held, surface, run)?;
    let mut touch = Touch::default();
    let (mut torque_nm, mut lifts, mut was_off) = (0.0f64, 0_u64, false);
    for tick in 1..=ticks {
        let seconds = tick as f64 * tool.period_s();
        let wrench = tool.lead(hand.pose(seconds));
        let is_off = raised(seconds) >= 1.0 && wrench == Wrench::ZERO;
        lifts += u64::from(is_off && !was_off);
        was_off = is_off;
        torque_nm = max_or_nan(torque_nm, wrench.torque.length());
        found.must(wrench.is_finite());
        found.most(touch.put_out_j(tool.device().work_j, is_off));
    }
    let whole_j = tool.device().work_j;
    found.most(whole_j);
    found.log("energy put out in the whole run, J", whole_j);
    found.must(torque_nm > MIN_TORQUE_NM * defaults.stiffer().min(1.0));
    // It begins at the top of a lift, and comes there again in every period.
    let period = (LIFT_PERIOD_S / tool.period_s()) as u64;
    found.must(lifts > ticks / period);
    Ok(())
}

/// The force of one of these tools, or of a ball, that is not rendered, as a sum over ticks, of
/// what is wanted, of the one that loses most: since its contact was found late, or since the
/// account or a limit withholds it. What is wanted is stiffness times depth: the surface has no
/// damping. Of a tool both are by the record, in the ticks in contact, and its depth is that of the
/// device: a turn alone counts for nothing. Of the ball they are where the device is and what its
/// motors render, in all ticks in which it is behind the plate, found or not.
fn withheld(trial: Trial<'_>) -> Result<Found, Failure> {
    let held = [
        ("in a slot", slot()),
        ("on a plate", plate()),
        ("in a hole", hole()),
        ("a ball on a plate", ball()),
    ];
    most_withheld(&held, trial)
}

/// The same of the bar across an edge.
fn withheld_on_edge(trial: Trial<'_>) -> Result<Found, Failure> {
    most_withheld(&[("on an edge", edge())], trial)
}

fn most_withheld(held: &[(&'static str, Held)], trial: Trial<'_>) -> Result<Found, Failure> {
    let Trial {
        size,
        random,
        defaults,
    } = trial;
    let mut found = Found::new(0.0);
    for (name, held) in held {
        let share = withheld_of(held, (size, random, defaults))?;
        // Without a contact it is no number, and fails.
        found.most(share);
        found.log(name, share);
    }
    Ok(found)
}

/// Forces that were wanted, newtons, and what of them was not rendered, as sums.
#[derive(Default)]
struct Withheld {
    wanted: f64,
    missing: f64,
}

impl Withheld {
    /// A tick.
    fn add(&mut self, wanted_n: f64, rendered_n: f64) {
        self.wanted += wanted_n;
        // What lingers beyond what is wanted makes up for nothing.
        self.missing += positive(wanted_n - rendered_n);
    }

    /// No number where nothing was wanted.
    fn share(&self) -> f64 {
        self.missing / self.wanted
    }
}

/// The same of one of them.
fn withheld_of(held: &Held, run: (&Size, &mut Xoshiro256PlusPlus, Setup)) -> Result<f64, Failure> {
    let stiffness = SOFT.0[0] * run.2.stiffer();
    let (mut tool, mut hand, ticks) = held_by_hand(held, SOFT, run)?;
    let mut sums = Withheld::default();
    for tick in 1..=ticks {
        let wrench = tool.lead(hand.pose(tick as f64 * tool.period_s()));
        let probe = tool.record().probes[0];
        if let ProbeShape::Sphere { radius_m } = held.tool {
            // The plate is in z = 0.
            let depth_m = positive(radius_m - tool.device().pose.position.z);
            sums.add(stiffness * depth_m, wrench.force.length());
        } else if probe.contact {
            let wanted_n = stiffness * probe.depth_m;
            sums.add(wanted_n, wanted_n * (1.0 - probe.force_withheld));
        }
    }
    Ok(sums.share())
}

/// How far a lift is up after so many seconds, 0 to 1.
fn raised(seconds: f64) -> f64 {
    (3.0 * (TAU * seconds / LIFT_PERIOD_S).cos() - 1.5).clamp(0.0, 1.0)
}

/// What the hand wants over time.
struct Swings<'a> {
    held: &'a Held,
    /// Phase of each swing of each coordinate, radians.
    phases: [[f64; 4]; 6],
}

impl<'a> Swings<'a> {
    fn new(held: &'a Held, random: &mut Xoshiro256PlusPlus) -> Self {
        let mut phases = [[0.0; 4]; 6];
        for phase in phases.iter_mut().flatten() {
            *phase = TAU * unit(random);
        }
        Self { held, phases }
    }

    /// It begins at the top of a lift.
    fn pose(&mut self, seconds: f64) -> Pose {
        let swing = |coordinate: usize| -> f64 {
            let waves = SWINGS_HZ.iter().zip(&self.phases[coordinate]);
            let waves = waves.map(|(hz, phase)| (TAU * hz * seconds + phase).sin());
            waves.zip(SHARES).map(|(wave, share)| wave * share).sum()
        };
        let vector = |first: usize| DVec3::new(swing(first), swing(first + 1), swing(first + 2));
        let raised = raised(seconds);
        // Upright and in the middle where it goes in.
        let share = positive(1.0 - raised / self.held.upright);
        let [linear, angular] = self.held.swings;
        Pose {
            position: self.held.at
                + linear * vector(0) * share
                + DVec3::Z * (raised * self.held.lift_m),
            orientation: DQuat::from_scaled_axis(angular * vector(3) * share),
        }
    }
}

#[cfg(test)]
mod tests;
