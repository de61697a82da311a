//! Long simulated runs against a wall: whether it puts more energy out than the device damps.
//!
//! The product's controller renders the wall, without its energy account and without damping; the
//! simulated device has no encoder step, and its hand is a spring that takes no energy. The force
//! comes as late as that of the loop that was measured. The hand presses for seconds with a tremor,
//! then lifts off. While the wall is touched without a break its hold leaks
//! `K (T/2 + n T) ∫ v² dt`, as theory says, so that what is damped off the wall does not count.
//! Bounces leak less: a device of little damping makes some, and its limit lies higher.

use crate::cases::held_tool::{box_tool, plan, station};
use crate::failure::Failure;
use crate::models::profiles::extruded;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use haptic_device::{Intent, Sample};
use scene::{DeviceRotationPlan, HandImpedance, ProbeShape, ScenePlan, SimulatedDevicePlan};
use simulated_device::SimulatedDevice;
use simulator::{Client, ClientOptions, Simulation};
use std::f64::consts::TAU;

/// Length of a run, seconds; in its first and last part the hand is away.
const RUN_S: f64 = 8.0;
const AWAY_S: f64 = 0.2;
/// How far it is away then, of the depth.
const AWAY_SHARE: f64 = 0.02;
/// Time in which the hand presses, and in which it lets go, seconds.
const RAMP_S: f64 = 0.5;
/// Depth of the press: metres, radians.
const PRESSED: [f64; 2] = [1e-3, 0.02];
/// Tremors of the hand: Hz, and share of the depth.
const TREMORS: [(f64, f64); 3] = [(1.7, 0.1), (4.3, 0.1), (9.1, 0.05)];
/// Energy beyond which a run is over: it has diverged. Joules.
const DIVERGED_J: f64 = 1.0;
/// No limit of a force (N) or torque (N m): what the rendering itself does is looked at.
const UNLIMITED: f64 = 1e12;
/// Ticks in which the model arrives and the front comes to rest.
const START_TICKS: u32 = 1500;
/// Mass of a device that turns only, kg, and its damping, N s/m: it stays where it is.
const HELD_FAST: f64 = 1e9;
/// Depth of the blade's upper side in the slot, metres.
const MARGIN_M: f64 = 5e-4;
/// Half sides of a blade, metres, and half width of the slot that it is turned in, millimetres.
const BLADE_M: [f64; 3] = [1e-3, 1e-2, 4e-3];
const SLOT_MM: f64 = 1.1;

/// What is limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wall {
    /// A plate under a ball.
    Plate,
    /// A slot around a blade: a couple that holds it against turning.
    Slot,
}

/// A wall, a device and a loop.
#[derive(Debug, Clone, Copy)]
pub struct Loaded {
    /// The wall.
    pub wall: Wall,
    /// Period of the loop, seconds.
    pub period_s: f64,
    /// Delay of the force beyond the hold of a period, ticks.
    pub delay_ticks: f64,
    /// Mass, kg, or moment of inertia, kg m².
    pub inertia: f64,
    /// Damping, N s/m or N m s/rad.
    pub damping: f64,
    /// Spring of the hand, N/m or N m/rad; above 0.
    pub hand: f64,
}

impl Loaded {
    /// The stiffest wall that puts no energy out in theory, N/m or N m/rad (Colgate 1994, with a
    /// delay Gil 2009).
    #[must_use]
    pub fn theory(&self) -> f64 {
        self.damping / (self.period_s * (0.5 + self.delay_ticks))
    }

    /// How far the limit of a run may lie above theory, relative. Theory holds for a motion that is
    /// slow beside the period. At the frequency ω of the device on wall and hand, the part of the
    /// delayed and held force that is in phase with the velocity is less by
    /// `ω² ((τ + T/2)² + (T/2)²) / 6`, with the delay τ.
    #[must_use]
    pub fn uncertainty(&self) -> f64 {
        let squared = (self.theory() + self.hand) / self.inertia;
        let half = 0.5 * self.period_s;
        let lag = self.delay_ticks * self.period_s + half;
        squared * (lag * lag + half * half) / 6.0
    }

    /// Whether a wrench is the wall's answer, against the coordinate that is pressed.
    fn answers(&self, wrench: &Wrench) -> bool {
        let against = match self.wall {
            Wall::Plate => wrench.force.z,
            Wall::Slot => wrench.torque.z,
        };
        against != 0.0
    }

    fn device(&self) -> SimulatedDevicePlan {
        let exact = SimulatedDevicePlan {
            encoder_m: 0.0,
            ..SimulatedDevicePlan::default()
        };
        let hand = |stiffness_n_per_m: f64| HandImpedance {
            stiffness_n_per_m,
            damping_ns_per_m: 0.0,
        };
        match self.wall {
            Wall::Plate => SimulatedDevicePlan {
                mass_kg: self.inertia,
                damping_ns_per_m: self.damping,
                hand: hand(self.hand),
                ..exact
            },
            Wall::Slot => SimulatedDevicePlan {
                mass_kg: HELD_FAST,
                damping_ns_per_m: 0.0,
                hand: hand(0.0),
                rotation: Some(DeviceRotationPlan {
                    inertia_kgm2: self.inertia,
                    damping_nms_per_rad: self.damping,
                    encoder_rad: 0.0,
                    hand_stiffness_nm_per_rad: self.hand,
                    hand_damping_nms_per_rad: 0.0,
                    is_rendered: true,
                }),
                ..exact
            },
        }
    }

    fn scene(&self, stiffness_n_per_m: f64, passivity: bool) -> Result<ScenePlan, Failure> {
        let tool = match self.wall {
            Wall::Plate => ProbeShape::Sphere { radius_m: 1e-3 },
            Wall::Slot => box_tool(DVec3::from_array(BLADE_M)),
        };
        let mut plan = plan(
            &tool,
            [stiffness_n_per_m, 0.0],
            "renders = 6, encoder_m = 0.0",
        )?;
        plan.loop_.rate_hz = 1.0 / self.period_s;
        plan.safety.passivity = passivity;
        plan.safety.force_max_n = UNLIMITED;
        plan.safety.torque_max_nm = UNLIMITED;
        plan.safety.slew_n_per_s = UNLIMITED / self.period_s;
        plan.safety.ramp_s = 0.0;
        Ok(plan)
    }

    /// Where the device is at this value of the coordinate that is pressed, metres or radians: at 0
    /// it begins to touch.
    fn pose(&self, pressed: f64) -> Pose {
        match self.wall {
            Wall::Plate => Pose::at(DVec3::Z * (1e-3 - pressed)),
            Wall::Slot => Pose {
                position: DVec3::Z * -(BLADE_M[2] + MARGIN_M),
                orientation: DQuat::from_rotation_z(touching_rad() + pressed),
            },
        }
    }
}

/// Angle at which the blade touches the walls: `l sin θ + w cos θ = W`.
fn touching_rad() -> f64 {
    let [w, l, _] = BLADE_M;
    (1e-3 * SLOT_MM / l.hypot(w)).asin() - w.atan2(l)
}

/// A wall that is there as a whole, and nothing near.
struct Rendered {
    simulation: Simulation<Vec<u8>>,
}

impl Rendered {
    fn new(loaded: &Loaded, plan: &ScenePlan) -> Result<Self, Failure> {
        let mesh = match loaded.wall {
            Wall::Plate => extruded(&[[-20.0, 0.0], [20.0, 0.0]], 40.0),
            Wall::Slot => {
                let w = SLOT_MM;
                extruded(
                    &[
                        [-8.0, 0.0],
                        [-w, 0.0],
                        [-w, -9.0],
                        [w, -9.0],
                        [w, 0.0],
                        [8.0, 0.0],
                    ],
                    30.0,
                )
            }
        };
        let options = ClientOptions {
            device_max_n: UNLIMITED,
            ..ClientOptions::default()
        };
        let station = station(plan, mesh)?;
        let mut rendered = Self {
            simulation: Simulation::new(station, Client::new(plan, options)),
        };
        let free = loaded.pose(match loaded.wall {
            Wall::Plate => -2e-3,
            Wall::Slot => -touching_rad(),
        });
        for _ in 0..START_TICKS {
            rendered.wrench(Sample::at(free));
        }
        Ok(rendered)
    }

    fn wrench(&mut self, sample: Sample) -> Wrench {
        self.simulation.step(Some(sample)).wrenches[0]
    }
}

/// Torsional stiffness of the slot in units of the surface's, m²/rad: from two presses by given
/// turns around the depth of the runs.
///
/// # Errors
/// When the slot cannot be served.
pub fn torsion_per_stiffness(loaded: &Loaded) -> Result<f64, Failure> {
    let stiffness = 100.0;
    let plan = loaded.scene(stiffness, false)?;
    let mut rendered = Rendered::new(loaded, &plan)?;
    // As slowly as in a run: a contact that begins by a jump is not the same.
    let mut pressed = -0.1;
    let mut press = |share: f64| {
        let mut torque_nm = 0.0;
        while pressed < share {
            pressed += 2e-3;
            let sample = Sample::at(loaded.pose(pressed * PRESSED[1]));
            torque_nm = rendered.wrench(sample).torque.z;
        }
        (pressed, torque_nm)
    };
    let [low, high] = [0.75, 1.25].map(&mut press);
    // A slope: the proxy keeps off the wall by a contact offset.
    let angle = (high.0 - low.0) * PRESSED[1];
    Ok((low.1 - high.1) / (angle * stiffness))
}

/// Where the hand is at a time to press the device so deep, for a wall that needs it so many times
/// as deep: just off before and after, since what it gives there is damped without the wall.
fn hand_at(t: f64, depth: f64, beyond: f64) -> f64 {
    let tremor: f64 = TREMORS
        .iter()
        .map(|(hz, share)| share * (TAU * hz * t).sin())
        .sum();
    let left = RUN_S - AWAY_S - t;
    if t >= AWAY_S && left > 0.0 {
        let ramp = ((t - AWAY_S).min(left) / RAMP_S).min(1.0);
        depth * (1.0 + tremor) * beyond * ramp
    } else {
        -AWAY_SHARE * depth
    }
}

/// Whether a wall of this stiffness, N/m of its surface and of the coordinate that is pressed, puts
/// no more energy out in a run than the device damps; without the account only what it damps at the
/// wall counts.
///
/// # Errors
/// When the wall cannot be served, or was never touched.
pub fn holds(
    loaded: &Loaded,
    [surface, stiffness]: [f64; 2],
    passivity: bool,
) -> Result<bool, Failure> {
    let mut rendered = Rendered::new(loaded, &loaded.scene(surface, passivity)?)?;
    let mut device = SimulatedDevice::new(loaded.device(), loaded.period_s);
    let depth = match loaded.wall {
        Wall::Plate => PRESSED[0],
        Wall::Slot => PRESSED[1],
    };
    // Where the hand has to be for the device to be that deep.
    let beyond = 1.0 + stiffness / loaded.hand;
    let whole = loaded.delay_ticks.floor() as usize;
    let late = loaded.delay_ticks.fract() * loaded.period_s;
    let mut wrenches = vec![Wrench::ZERO; whole + 2];
    let (mut was_touched, mut damped_j) = (false, 0.0);
    let ticks = (RUN_S / loaded.period_s) as u64;
    device.intend_still(loaded.pose(-AWAY_SHARE * depth));
    for tick in 0..ticks {
        let t = tick as f64 * loaded.period_s;
        device.intend_still(loaded.pose(hand_at(t, depth, beyond)));
        wrenches.rotate_right(1);
        wrenches[0] = rendered.wrench(device.sample());
        let damped_before_j = device.state().damped_j;
        device.hold(wrenches[whole + 1], late);
        device.hold(wrenches[whole], loaded.period_s - late);
        let state = device.state();
        let is_at_wall = wrenches.iter().any(|wrench| loaded.answers(wrench));
        was_touched |= is_at_wall;
        // The account may take all of a force that the wall would give.
        if is_at_wall || passivity {
            damped_j += state.damped_j - damped_before_j;
        }
        let net_j = state.work_j - damped_j;
        // What is no number is no passive wall.
        if net_j.is_nan() || net_j > DIVERGED_J {
            return Ok(false);
        }
    }
    if !was_touched {
        return Err(Failure::Run(
            "a simulated wall was never touched: nothing can be said of it".to_string(),
        ));
    }
    Ok(device.state().work_j <= damped_j)
}

/// A hand that holds a place.
trait Still {
    fn intend_still(&mut self, pose: Pose);
}

impl Still for SimulatedDevice {
    fn intend_still(&mut self, pose: Pose) {
        haptic_device::Device::intend(self, Intent::still(pose));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate(inertia: f64) -> Loaded {
        Loaded {
            wall: Wall::Plate,
            period_s: 1e-3,
            delay_ticks: 0.0,
            inertia,
            damping: 1.0,
            hand: 200.0,
        }
    }

    /// A hand moves a device of 1e9 kg by nanometres in a run: it stays just off the wall.
    #[test]
    fn a_wall_that_was_never_touched_is_not_passive() {
        let wall = [1000.0; 2];
        let held = holds(&plate(HELD_FAST), wall, false);
        let said = held.expect_err("nothing was touched").to_string();
        assert!(said.contains("never touched"), "{said}");
        assert_eq!(holds(&plate(0.1), wall, false), Ok(true));
    }
}
