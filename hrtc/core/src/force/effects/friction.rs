//! Dry friction: a spring along the surface that depends on displacement, not on velocity
//! (Hayward 2000). A sticking contact does not creep, and the noise of a velocity does not make a
//! sliding one chatter.
//!
//! The deflection `z` points along the surface from the contact to its anchor. With μ the
//! coefficient of friction, F the normal force of the contact, K the stiffness of the surface and
//! w the share of F in the normal forces of all contacts (1 for a single one):
//!
//! - Sticking: `z` changes by the motion of the proxy, while `|z| <= μ_static F / (w K)`.
//! - Sliding: `|z|` stays at `μ_dynamic F / (w K)`, until the motion makes it less.
//!
//! The force of the contact is `w K z`, at its own point. So a tool between two walls, whose forces
//! on it cancel, is held by both, and all contacts together are no stiffer than one. Where the
//! normal force moves from one contact to another, a new one has the deflection of the rigid motion
//! that those of the others show: with their sum and their centre unchanged, the sum of friction is
//! unchanged too.
//!
//! A fade-in makes the springs stiffer, and shortens `z` so that their energy stays: more would
//! have to be taken back at the next turn, at once.
//!
//! A period of hold puts out energy as with any sampled spring (Colgate 1994), so friction has an
//! energy account of its own, and no closed path gains energy. It counts force and torque.

use super::contact_set::{Acting, MAX_CONTACTS};
use super::{ContactSample, Rendered};
use crate::contact::motion::Placement;
use crate::force::passivity::EnergyAccount;
use geometry::{Pose, Wrench};
use glam::DVec3;
use mutants::{Mutant, is};
use scene::FrictionPlan;

/// Friction of one surface on one probe.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Friction {
    plan: FrictionPlan,
    /// Of each contact, by its slot.
    anchors: [Option<Anchor>; MAX_CONTACTS],
    /// `None` without a contact in the last tick.
    last: Option<Last>,
    /// Limits the energy that it puts out.
    account: Option<EnergyAccount>,
}

#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Anchor {
    /// `z`, metres, object's axes.
    deflection: DVec3,
    /// Whether it slid in the last tick.
    slides: bool,
}

impl Anchor {
    /// The anchor after its spring has become stiffer by a fade-in, `before` times as stiff until
    /// then. A spring of the same deflection would have more energy, which nothing has paid for.
    fn of_equal_energy(self, before: f64) -> Self {
        Self {
            deflection: self.deflection * before.min(1.0).sqrt(),
            ..self
        }
    }
}

/// The last tick.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Last {
    proxy: Pose,
    device: Pose,
    /// Torque of the friction about the device's position.
    torque: DVec3,
    /// Amount of the effect, 0 to 1.
    amount: f64,
}

/// Friction of one contact in a tick.
#[derive(Debug, Clone, Copy)]
struct Held {
    arm: DVec3,
    normal: DVec3,
    deflection: DVec3,
    stiffness_n_per_m: f64,
}

impl Held {
    const NONE: Self = Self {
        arm: DVec3::ZERO,
        normal: DVec3::ZERO,
        deflection: DVec3::ZERO,
        stiffness_n_per_m: 0.0,
    };

    fn force(&self) -> DVec3 {
        self.deflection * self.stiffness_n_per_m
    }

    fn stored_j(&self) -> f64 {
        0.5 * self.stiffness_n_per_m * self.deflection.length_squared()
    }

    /// Motion along the surface at the contact, of a motion of the device, metres and radians.
    fn motion(&self, next: DVec3, turn: DVec3) -> DVec3 {
        let next = next + turn.cross(self.arm);
        next - self.normal * self.normal.dot(next)
    }

    /// After a motion of the device, metres and radians.
    fn moved(&self, next: DVec3, turn: DVec3) -> Self {
        Self {
            deflection: self.deflection - self.motion(next, turn),
            ..*self
        }
    }
}

impl Friction {
    /// Friction before any contact. `account`: an empty one of the device; `None` without an energy
    /// limit.
    #[must_use]
    pub fn new(plan: FrictionPlan, account: Option<EnergyAccount>) -> Self {
        Self {
            plan,
            anchors: [None; MAX_CONTACTS],
            last: None,
            account,
        }
    }

    /// Ends the contact.
    pub fn reset(&mut self) {
        self.anchors = [None; MAX_CONTACTS];
        if self.last.take().is_some()
            && let Some(account) = &mut self.account
        {
            *account = account.restarted();
        }
    }

    /// Adds the friction of each contact to the passive wrench, scaled by `amount` (0 to 1).
    pub fn render(
        &mut self,
        at: &ContactSample<'_>,
        contacts: &mut [Acting],
        amount: f64,
        out: &mut Rendered,
    ) {
        let whole: f64 = contacts.iter().map(|of| of.force.length()).sum();
        if !(whole > 0.0 && whole.is_finite()) {
            self.reset();
            return;
        }
        let mut held = [Held::NONE; MAX_CONTACTS];
        let fade = self.last.map_or(1.0, |last| last.amount / amount);
        let before = std::mem::replace(&mut self.anchors, [None; MAX_CONTACTS]);
        let before = before.map(|anchor| anchor.map(|anchor| anchor.of_equal_energy(fade)));
        for (held, contact) in held.iter_mut().zip(&*contacts) {
            let size = contact.force.length();
            if size > 0.0 {
                *held = self.hold(at, (contact, size), (&before, contacts));
                held.stiffness_n_per_m *= amount;
            }
        }
        let held = &held[..contacts.len()];
        let [next, turn] = self.lead(at, held);
        let mut sum = Wrench::ZERO;
        for (contact, held) in contacts.iter_mut().zip(held) {
            let force = held.moved(next, turn).force();
            sum.force += force;
            sum.torque += held.arm.cross(force);
            out.add_passive(force, contact.arm);
            out.spring.stored_j += held.stored_j();
        }
        if let Some(account) = &mut self.account {
            account.set_force(sum.force);
        }
        self.last = Some(Last {
            proxy: at.proxy,
            device: at.device,
            torque: sum.torque,
            amount,
        });
    }

    /// The friction of a contact, and its anchor.
    fn hold(
        &mut self,
        at: &ContactSample<'_>,
        (contact, size): (&Acting, f64),
        (before, contacts): (&[Option<Anchor>; MAX_CONTACTS], &[Acting]),
    ) -> Held {
        let normal = contact.force / size;
        let known = before[contact.slot].filter(|_| !contact.is_new);
        let anchor = known.unwrap_or_else(|| anchor_of_others(contact, normal, before, contacts));
        // Place of the contact's material point of the proxy one tick ago.
        let last = self.last.map_or(at.proxy, |last| last.proxy);
        let was = last.transform_point(at.proxy.inverse_transform_point(contact.point));
        let kept = match () {
            () if is(Mutant::FrictionCreep) => anchor.deflection * 0.9999,
            () if is(Mutant::FrictionShared) => mutants::exchange(anchor.deflection.into()).into(),
            () => anchor.deflection,
        };
        let deflection = kept - (contact.point - was);
        let deflection = deflection - normal * normal.dot(deflection);
        let length = deflection.length();
        let stiffness_n_per_m = at.stiffness_n_per_m * contact.share;
        let most = |coefficient: f64| coefficient * size / stiffness_n_per_m;
        let holds = if anchor.slides {
            self.plan.dynamic
        } else {
            self.plan.static_
        };
        let slides = length > most(holds);
        let deflection = if slides {
            deflection * (most(self.plan.dynamic) / length)
        } else {
            deflection
        };
        self.anchors[contact.slot] = Some(Anchor { deflection, slides });
        Held {
            arm: contact.arm,
            normal,
            deflection,
            stiffness_n_per_m,
        }
    }

    /// The part of the coming motion, metres and radians, after which the springs are to give their
    /// force of now, so that its work over all of that motion is no more than they lose: half of
    /// it, as a sampled spring needs, if the account knows of no other energy.
    fn lead(&mut self, at: &ContactSample<'_>, held: &[Held]) -> [DVec3; 2] {
        let Some(account) = &mut self.account else {
            return [DVec3::ZERO; 2];
        };
        if at.is_interrupted {
            // What it did meanwhile it did not do against this force.
            *account = account.restarted();
        }
        let last = self.last.filter(|_| !at.is_interrupted);
        let (before, torque) =
            last.map_or((at.device, DVec3::ZERO), |last| (last.device, last.torque));
        let turn = placement(&before).to(&placement(&at.device)).angular;
        let turned_j = torque.dot(turn);
        if at.goes_on {
            account.go_on(at.periods[0], [-turned_j; 2]);
        } else {
            account.moved_to(&Pose::at(at.device.position), at.periods, [-turned_j; 2]);
        }
        account.dissipate_beyond(held.iter().map(Held::stored_j).sum());
        // What it turns in the coming period, by the estimate, as what it moves: without a sample
        // both go on.
        let turn = at.angular * at.clock.period_s;
        let next = account.next();
        let then_j: f64 = held.iter().map(|of| of.moved(next, turn).stored_j()).sum();
        let (mut work, mut of_motion, mut force) = (0.0, 0.0, DVec3::ZERO);
        for of in held {
            let motion = of.motion(next, turn);
            work += of.force().dot(motion);
            of_motion += of.stiffness_n_per_m * motion.length_squared();
            force += of.force();
        }
        // Two encoder steps of error in the balance are tolerated.
        let noise = 2.0 * force.length() * account.encoder_m();
        let excess = work - account.balance(then_j) - noise;
        if !(work > 0.0 && excess > 0.0) || is(Mutant::Passivity) {
            return [DVec3::ZERO; 2];
        }
        // At most until the force does no work; where it does next to none, half of the motion.
        let most = (work / of_motion).max(0.5);
        [next, turn].map(|motion| motion * (excess / of_motion).min(most))
    }
}

/// The anchor of a new contact: where the rigid motion puts it that the deflections of the others
/// show, those that lie alike most. Without others the contact begins at its anchor.
fn anchor_of_others(
    new: &Acting,
    normal: DVec3,
    before: &[Option<Anchor>; MAX_CONTACTS],
    contacts: &[Acting],
) -> Anchor {
    let others = || {
        let known = contacts.iter().filter(|of| !of.is_new);
        known.filter_map(|of| {
            let weight = of.share * of.force.normalize_or_zero().dot(normal).max(0.0);
            before[of.slot].map(|anchor| (weight, of.point, anchor))
        })
    };
    let sum: f64 = others().map(|(weight, ..)| weight).sum();
    if sum <= 0.0 {
        return Anchor {
            deflection: DVec3::ZERO,
            slides: false,
        };
    }
    let middle = others().map(|(w, point, _)| point * w).sum::<DVec3>() / sum;
    let mean = others().map(|(w, _, of)| of.deflection * w).sum::<DVec3>() / sum;
    let mut turned = (0.0, 0.0);
    for (weight, point, anchor) in others() {
        let arm = point - middle;
        let arm = arm - normal * normal.dot(arm);
        turned.0 += weight * normal.dot(arm.cross(anchor.deflection - mean));
        turned.1 += weight * arm.length_squared();
    }
    let turn = if turned.1 > 0.0 {
        turned.0 / turned.1
    } else {
        0.0
    };
    let longest = others().fold(0.0, |most, (_, _, of)| of.deflection.length().max(most));
    let deflection = mean + (normal * turn).cross(new.point - middle);
    Anchor {
        deflection: deflection.clamp_length_max(longest),
        slides: others().all(|(_, _, of)| of.slides),
    }
}

fn placement(pose: &Pose) -> Placement {
    Placement {
        centre: pose.position,
        orientation: pose.orientation,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::effects::contact_set::{ContactSet, Push};
    use crate::force::effects::tests::Bench;
    use crate::record::max_or_nan;
    use geometry::Wrench;

    const HALF_M: f64 = 0.01;

    /// The most work, joules, and the largest torque, N m, of the friction of a tool on four
    /// corners, over a path of turns and displacements of its proxy, with the device below. The
    /// device has a sample in one of so many periods, and moves as much more slowly.
    fn work_of(account: Option<EnergyAccount>, stays: bool, every: u32) -> [f64; 2] {
        let plan = FrictionPlan {
            static_: 0.4,
            dynamic: 0.3,
        };
        let mut friction = Friction::new(plan, account);
        let mut set = ContactSet::default();
        let mut bench = Bench::new(HALF_M);
        let (mut wrench, mut worst, mut joules) = (Wrench::ZERO, f64::NEG_INFINITY, 0.0);
        let (mut felt, mut here, mut angular) = (0.0, bench.pose, DVec3::ZERO);
        for tick in 0..20_000u32 {
            let t = 1e-3 * f64::from(tick) / f64::from(every);
            // Some sixty turns a second, of less than what slides, or of more.
            let reach = if stays { 2e-4 } else { 2e-3 };
            let turn = reach / HALF_M * (380.0 * t).sin();
            let before = here;
            here = Pose {
                position: DVec3::new(0.3 * reach * (130.0 * t).sin(), 0.0, 0.0),
                orientation: glam::DQuat::from_rotation_z(turn),
            };
            let motion = placement(&before).to(&placement(&here));
            joules += wrench.force.dot(motion.linear) + wrench.torque.dot(motion.angular);
            worst = max_or_nan(worst, joules);
            let goes_on = !tick.is_multiple_of(every);
            let periods = [1, if tick == 0 { 1 } else { u64::from(every) }];
            if !goes_on {
                let turned = placement(&bench.pose).to(&placement(&here)).angular;
                angular = turned / (1e-3 * periods[1] as f64);
                bench.pose = here;
            }
            bench.step();
            let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
            let pushes = corners.map(|(x, y)| Push {
                point: bench.pose.transform_point(DVec3::new(x, y, 0.0) * HALF_M),
                force: DVec3::Z * 0.5,
            });
            let sample = ContactSample {
                periods: if goes_on { [1; 2] } else { periods },
                goes_on,
                angular,
                ..bench.sample(&pushes)
            };
            let mut out = Rendered::default();
            let mut contacts = set.track(&sample, DVec3::Z * 2.0);
            friction.render(&sample, contacts.all(), 1.0, &mut out);
            wrench = out.passive;
            felt = max_or_nan(felt, wrench.torque.length());
        }
        [worst, felt]
    }

    /// A sampled spring puts out energy where it is turned to and fro: that of torques too is
    /// limited, whether the contacts stick or slide, and where a device has no sample in most
    /// periods.
    #[test]
    fn friction_puts_out_no_energy_where_a_tool_turns() {
        for stays in [true, false] {
            let account = EnergyAccount::new(0.0, 1e-3);
            for every in [1, 4] {
                let [limited, felt] = work_of(Some(account.clone()), stays, every);
                let [free, felt_free] = work_of(None, stays, every);
                println!("{every}: {limited} J, {free} J without the limit");
                assert!(felt > 1e-3 && felt_free > 1e-3, "{felt} {felt_free} N m");
                assert!(limited < 1e-5, "{every}: {limited} J put out");
                assert!(!stays || free > 1e-3, "{free} J: nothing to limit");
            }
        }
    }

    /// Forces of the friction of a ball pressed by 2 N, whose proxy and device take these
    /// displacements, a tick each, at these amounts of the effect.
    fn forces_along(steps: impl Iterator<Item = (DVec3, f64)>) -> Vec<DVec3> {
        let plan = FrictionPlan {
            static_: 0.4,
            dynamic: 0.4,
        };
        let account = EnergyAccount::new(0.0, 1e-3);
        let mut friction = Friction::new(plan, Some(account));
        let mut set = ContactSet::default();
        let mut bench = Bench::new(HALF_M);
        let forces = steps.map(|(displacement, amount)| {
            bench.pose.position += displacement;
            bench.step();
            let push = Push {
                point: bench.pose.position,
                force: DVec3::Z * 2.0,
            };
            let pushes = [push];
            let sample = bench.sample(&pushes);
            let mut out = Rendered::default();
            let mut contacts = set.track(&sample, push.force);
            friction.render(&sample, contacts.all(), amount, &mut out);
            out.passive.force
        });
        forces.collect()
    }

    /// A spring that a motion passes by, as at a turn, loses nothing: only what the hold puts out
    /// along the motion is taken off its force.
    #[test]
    fn a_motion_across_the_deflection_takes_no_force_away() {
        let step_m = 1e-5;
        let slide = (0..200).map(|_| DVec3::X);
        // Slowly from straight on to straight back.
        let turn = (0..1800).map(|k| glam::DQuat::from_rotation_z(f64::from(k) * 1e-3) * DVec3::X);
        let forces = forces_along(slide.chain(turn).map(|along| (along * step_m, 1.0)));
        let largest = forces.windows(2).map(|pair| pair[0].distance(pair[1]));
        let largest = largest.fold(0.0, max_or_nan);
        assert!(largest < 2.0 * 800.0 * step_m, "{largest} N in a tick");
        assert!(forces[1000].length() > 0.7, "{}", forces[1000]);
    }

    /// Its spring becomes stiffer where nothing moves: its energy is none that was put in.
    #[test]
    fn a_fade_in_at_rest_adds_no_energy() {
        let slide = (0..5).map(|_| (DVec3::X * 1e-5, 0.1));
        let fade = (1..=90).map(|k| (DVec3::ZERO, 0.1 + 0.01 * f64::from(k)));
        let forces = forces_along(slide.chain(fade));
        let stored_j = |force: DVec3, amount: f64| force.length_squared() / (2.0 * 800.0 * amount);
        let (before, after) = (stored_j(forces[4], 0.1), stored_j(forces[94], 1.0));
        assert!(
            (after / before - 1.0).abs() < 1e-9,
            "{after} J of {before} J"
        );
    }
}
