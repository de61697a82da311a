//! The contacts of a probe, tracked from tick to tick: each effect acts at each of them, with the
//! contact's own force, and keeps a state for it.
//!
//! The projection of a tool's motion chooses up to six contacts that push. Where more would do (a
//! box on a plate, a long edge), rounding chooses among them, and their forces jump though their
//! sum does not. So a contact keeps its slot while one pushes near it, and its share of the sum of
//! the normal forces follows the multipliers at a rate that is not felt: one that is not chosen any
//! more fades where the tool has it. The shares are 1 together, also while they change.
//!
//! A ball has one contact, with all of its force.

use super::{ContactSample, Rendered};
use crate::contact::rigid_proxy::projection::MAX_ACTIVE;
use crate::perception::STEP_SHARE_PER_S;
use geometry::Pose;
use glam::DVec3;

/// Contacts that are tracked: those that push, and as many that fade.
pub const MAX_CONTACTS: usize = 2 * MAX_ACTIVE;
/// Distance within which a contact is the one of the tick before, in radii of gyration of the tool:
/// the torque of its force changes by less of the force times that radius than is felt, 7 %.
const NEAR: f64 = 0.05;
/// Cosine of the angle between the normals of a contact in two ticks, at the least: a tool may turn
/// over an edge, but the wall opposite is another contact.
const SAME_SIDE: f64 = 0.5;
/// Share of the normal forces below which a contact that pushes no more is forgotten: a thousandth,
/// where 7 % of a force is not felt.
const FADED: f64 = 1e-3;

/// A contact in which a surface pushes; object's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Push {
    /// Contact point on the surface, metres.
    pub point: DVec3,
    /// Force of the surface on the probe, newtons.
    pub force: DVec3,
}

impl Push {
    /// No force: the content of an unused place.
    pub const NONE: Self = Self {
        point: DVec3::ZERO,
        force: DVec3::ZERO,
    };
}

/// A contact at which effects act in this tick; object's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acting {
    /// Its slot: the same in every tick of its life.
    pub slot: usize,
    /// Contact point on the surface, metres.
    pub point: DVec3,
    /// Lever arm from the proxy's position, metres; zero for a ball, which has no axes.
    pub arm: DVec3,
    /// Force of the surface there with the effects so far, newtons.
    pub force: DVec3,
    /// Share of the normal forces of all contacts, 0 to 1.
    pub share: f64,
    /// Whether the contact pushes in this tick; else it fades.
    pub is_pushing: bool,
    /// Whether its slot had no contact in the tick before.
    pub is_new: bool,
}

impl Acting {
    const NONE: Self = Self {
        slot: 0,
        point: DVec3::ZERO,
        arm: DVec3::ZERO,
        force: DVec3::ZERO,
        share: 0.0,
        is_pushing: false,
        is_new: false,
    };

    /// Adds a force (newtons) here to the contact and to the passive wrench.
    pub fn add(&mut self, force: DVec3, out: &mut Rendered) {
        self.force += force;
        out.add_passive(force, self.arm);
    }
}

/// The contacts of a tick.
#[derive(Debug, Clone, Copy)]
pub struct ActingContacts {
    all: [Acting; MAX_CONTACTS],
    count: usize,
}

impl ActingContacts {
    const EMPTY: Self = Self {
        all: [Acting::NONE; MAX_CONTACTS],
        count: 0,
    };

    fn push(&mut self, acting: Acting) {
        if let Some(place) = self.all.get_mut(self.count) {
            *place = acting;
            self.count += 1;
        }
    }

    /// The contacts.
    pub fn all(&mut self) -> &mut [Acting] {
        &mut self.all[..self.count]
    }
}

/// A contact between two ticks.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
struct Tracked {
    /// Where it was on the surface, object's axes, metres.
    point: DVec3,
    /// The same in the axes of the proxy.
    on_tool: DVec3,
    /// Unit direction of its force.
    normal: DVec3,
    share: f64,
}

/// The contacts of one probe with one surface.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct ContactSet {
    slots: [Option<Tracked>; MAX_CONTACTS],
    /// The last tick with a contact.
    tick: u64,
    high_water: usize,
}

impl ContactSet {
    /// Ends all contacts.
    pub fn reset(&mut self) {
        self.slots = [None; MAX_CONTACTS];
    }

    /// Largest number of contacts in a tick.
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// The contacts at which effects act in this tick; `whole`: the force of the surface, newtons.
    pub fn track(&mut self, at: &ContactSample<'_>, whole: DVec3) -> ActingContacts {
        let mut acting = ActingContacts::EMPTY;
        if at.middle.is_some() {
            self.high_water = self.high_water.max(1);
            acting.push(Acting {
                point: at.point,
                force: whole,
                share: 1.0,
                is_pushing: true,
                ..Acting::NONE
            });
            return acting;
        }
        // A tool that is held though nothing pushes it has its force at the point nearest to it.
        let held = [Push {
            point: at.point,
            force: whole,
        }];
        let pushes = if at.pushes.is_empty() {
            &held
        } else {
            at.pushes
        };
        let total: f64 = pushes.iter().map(|push| push.force.length()).sum();
        if !(total > 0.0 && total.is_finite()) {
            self.reset();
            return acting;
        }
        let ticks = at.clock.tick.saturating_sub(self.tick).max(1);
        self.tick = at.clock.tick;
        let is_first = self.slots.iter().all(Option::is_none);
        let rate = STEP_SHARE_PER_S * at.clock.period_s * ticks as f64;
        let rate = if is_first { 1.0 } else { rate.min(1.0) };
        let pushed = self.take(at, pushes, total, rate);
        self.drop_faded(&pushed);
        for (slot, tracked) in self.slots.iter().enumerate() {
            if let Some(of) = tracked {
                acting.push(Acting {
                    slot,
                    point: of.point,
                    arm: of.point - at.proxy.position,
                    force: of.normal * (total * of.share),
                    share: of.share,
                    is_pushing: pushed[slot] != Pushed::No,
                    is_new: pushed[slot] == Pushed::New,
                });
            }
        }
        self.high_water = self.high_water.max(acting.count);
        acting
    }

    /// Takes the contacts that push into their slots, and moves all shares towards theirs.
    fn take(
        &mut self,
        at: &ContactSample<'_>,
        pushes: &[Push],
        total: f64,
        rate: f64,
    ) -> [Pushed; MAX_CONTACTS] {
        let mut pushed = [Pushed::No; MAX_CONTACTS];
        for tracked in self.slots.iter_mut().flatten() {
            tracked.share *= 1.0 - rate;
        }
        let mut left = [false; MAX_ACTIVE];
        for (left, push) in left.iter_mut().zip(pushes) {
            *left = push.force.length() > 0.0;
        }
        // The nearest pair of all first, so the order of the contacts has no influence.
        while let Some((k, slot)) = self.nearest(at, pushes, &left, &pushed) {
            left[k] = false;
            pushed[slot] = Pushed::Again;
            self.put(slot, at.proxy, &pushes[k], rate / total);
        }
        for (k, push) in pushes.iter().enumerate().take(MAX_ACTIVE) {
            if left[k]
                && let Some(slot) = self.room(&pushed)
            {
                self.slots[slot] = None;
                pushed[slot] = Pushed::New;
                self.put(slot, at.proxy, push, rate / total);
            }
        }
        for (tracked, pushed) in self.slots.iter_mut().zip(&pushed) {
            if let (Some(of), Pushed::No) = (tracked, pushed) {
                of.point = at.proxy.transform_point(of.on_tool);
            }
        }
        pushed
    }

    /// A contact that pushes is that of a slot.
    fn put(&mut self, slot: usize, proxy: Pose, push: &Push, share_per_newton: f64) {
        let size = push.force.length();
        let before = self.slots[slot].map_or(0.0, |of| of.share);
        self.slots[slot] = Some(Tracked {
            point: push.point,
            on_tool: proxy.inverse_transform_point(push.point),
            normal: push.force / size,
            share: before + size * share_per_newton,
        });
    }

    /// The contact and the slot of the tick before that are nearest to each other, of those left. A
    /// contact slides over the tool or along with it.
    fn nearest(
        &self,
        at: &ContactSample<'_>,
        pushes: &[Push],
        left: &[bool],
        pushed: &[Pushed],
    ) -> Option<(usize, usize)> {
        let mut best = None;
        let mut least = (NEAR * at.gyration_m).powi(2);
        for (k, push) in pushes
            .iter()
            .enumerate()
            .take(MAX_ACTIVE)
            .filter(|(k, _)| left[*k])
        {
            let normal = push.force.normalize_or_zero();
            for (slot, tracked) in self.slots.iter().enumerate() {
                let Some(of) = tracked.filter(|_| pushed[slot] == Pushed::No) else {
                    continue;
                };
                let carried = at.proxy.transform_point(of.on_tool);
                let apart = of.point.distance_squared(push.point);
                let apart = apart.min(carried.distance_squared(push.point));
                if apart <= least && normal.dot(of.normal) > SAME_SIDE {
                    least = apart;
                    best = Some((k, slot));
                }
            }
        }
        best
    }

    /// A slot for a new contact: a free one, or that of the contact that has faded most.
    fn room(&self, pushed: &[Pushed]) -> Option<usize> {
        let share = |slot: usize| self.slots[slot].map_or(-1.0, |of| of.share);
        (0..MAX_CONTACTS)
            .filter(|&slot| pushed[slot] == Pushed::No)
            .min_by(|&a, &b| share(a).total_cmp(&share(b)))
    }

    /// Forgets what has faded; the shares of the others are 1 together.
    fn drop_faded(&mut self, pushed: &[Pushed]) {
        for (tracked, pushed) in self.slots.iter_mut().zip(pushed) {
            if *pushed == Pushed::No && tracked.is_some_and(|of| of.share < FADED) {
                *tracked = None;
            }
        }
        let sum: f64 = self.slots.iter().flatten().map(|of| of.share).sum();
        for of in self.slots.iter_mut().flatten() {
            of.share /= sum;
        }
    }
}

/// Whether the contact of a slot pushes in this tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pushed {
    No,
    Again,
    New,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::effects::tests::Bench;
    use proptest::prelude::*;

    const GYRATION_M: f64 = 0.01;

    /// Where a tool of that size may touch, farther apart than [`NEAR`].
    fn site(k: usize) -> DVec3 {
        GYRATION_M * DVec3::new((k % 4) as f64 * 0.3, (k / 4) as f64 * 0.3, 0.0)
    }

    fn push(point: DVec3, newtons: f64) -> Push {
        Push {
            point,
            force: DVec3::Z * newtons,
        }
    }

    /// The contacts of a tick, by their places.
    fn tracked(set: &mut ContactSet, bench: &Bench, pushes: &[Push]) -> Vec<Acting> {
        let whole = pushes.iter().map(|push| push.force).sum();
        let mut acting = set.track(&bench.sample(pushes), whole);
        let mut all = acting.all().to_vec();
        let place = |of: &Acting| of.point.x + 8.0 * of.point.y;
        all.sort_by(|a, b| place(a).total_cmp(&place(b)));
        all
    }

    proptest! {
        #[test]
        fn shares_are_one_together_in_any_order_and_the_room_suffices(
            ticks in prop::collection::vec(
                prop::collection::vec((0..16usize, 0.0..1.0f64), 1..=MAX_ACTIVE), 1..60,
            ),
        ) {
            let (mut set, mut backwards) = (ContactSet::default(), ContactSet::default());
            let mut bench = Bench::new(GYRATION_M);
            for tick in &ticks {
                bench.step();
                let mut pushes: Vec<Push> = Vec::new();
                for &(k, newtons) in tick {
                    if pushes.iter().all(|of| of.point != site(k)) {
                        pushes.push(push(site(k), newtons + 1e-3));
                    }
                }
                let all = tracked(&mut set, &bench, &pushes);
                let shares: f64 = all.iter().map(|of| of.share).sum();
                let forces: DVec3 = all.iter().map(|of| of.force).sum();
                let whole: DVec3 = pushes.iter().map(|push| push.force).sum();
                prop_assert!((shares - 1.0).abs() < 1e-12, "{}", shares);
                prop_assert!(forces.distance(whole) < 1e-12 * whole.length());
                prop_assert!(all.len() <= MAX_CONTACTS && set.high_water() <= MAX_CONTACTS);
                let pushing = all.iter().filter(|of| of.is_pushing).count();
                prop_assert_eq!(pushing, pushes.len());
                pushes.reverse();
                let again = tracked(&mut backwards, &bench, &pushes);
                prop_assert_eq!(again.len(), all.len());
                for (a, b) in all.iter().zip(&again) {
                    prop_assert!(a.point == b.point && (a.share - b.share).abs() < 1e-12);
                }
            }
        }
    }

    /// A box on a plate: of its four corners three push, which of them changes by rounding.
    #[test]
    fn which_contacts_are_chosen_is_not_felt() {
        let corners = [0, 1, 4, 5].map(site);
        let chosen = |missing: usize| -> Vec<Push> {
            let pushing = (0..4).filter(|&k| k != missing);
            // The one across the missing corner bears no more than the others.
            pushing.map(|k| push(corners[k], 1.0)).collect()
        };
        let (mut set, mut bench) = (ContactSet::default(), Bench::new(GYRATION_M));
        let mut last: Option<Vec<f64>> = None;
        for tick in 0..1000usize {
            bench.step();
            let all = tracked(&mut set, &bench, &chosen(tick * tick / 7 % 4));
            let share = |corner: &DVec3| {
                let of = all.iter().find(|of| of.point == *corner);
                of.map_or(0.0, |of| of.share)
            };
            let shares: Vec<f64> = corners.iter().map(share).collect();
            if let Some(last) = last.replace(shares.clone()) {
                for (now, before) in shares.iter().zip(&last) {
                    assert!((now - before).abs() <= 0.0701, "{tick}: {before}, {now}");
                }
            }
        }
    }

    /// A contact that two take the place of, side by side.
    #[test]
    fn a_contact_that_is_split_keeps_its_place() {
        let (mut set, mut bench) = (ContactSet::default(), Bench::new(GYRATION_M));
        let whole = [push(site(0), 1.0), push(site(2), 1.0)];
        let aside = DVec3::X * (0.4 * NEAR * GYRATION_M);
        let split = [
            push(site(0) - aside, 0.5),
            push(site(0) + aside, 0.5),
            push(site(2), 1.0),
        ];
        let torque =
            |all: Vec<Acting>| -> DVec3 { all.iter().map(|of| of.arm.cross(of.force)).sum() };
        let mut before: Option<DVec3> = None;
        for tick in 0..400 {
            bench.step();
            let is_whole = tick / 20 % 2 == 0;
            let pushes: &[Push] = if is_whole { &whole } else { &split };
            let now = torque(tracked(&mut set, &bench, pushes));
            let changed = before
                .replace(now)
                .map_or(0.0, |before| now.distance(before));
            // 2 N, at the most as far aside as is near.
            assert!(changed < 2.0 * NEAR * GYRATION_M, "{tick}: {changed} Nm");
        }
    }

    #[test]
    fn opposite_walls_and_distant_places_are_other_contacts() {
        let (mut set, mut bench) = (ContactSet::default(), Bench::new(GYRATION_M));
        bench.step();
        let first = tracked(&mut set, &bench, &[push(site(0), 1.0)]);
        assert!(first[0].is_new && first[0].share == 1.0, "{first:?}");
        bench.step();
        let again = tracked(&mut set, &bench, &[push(site(0), 2.0)]);
        assert!(!again[0].is_new && again[0].share == 1.0, "{again:?}");
        bench.step();
        let both = [push(site(0), 1.0), push(site(0), -1.0)];
        let walls = tracked(&mut set, &bench, &both);
        assert_eq!(walls.iter().filter(|of| of.is_new).count(), 1, "{walls:?}");
        // The second begins with the share of a tick, and each comes to its half.
        let begins = walls.iter().find(|of| of.is_new).map_or(0.0, |of| of.share);
        assert!((begins - 0.035).abs() < 1e-9, "{begins}");
        for _ in 0..300 {
            bench.step();
            let walls = tracked(&mut set, &bench, &both);
            assert!(walls.iter().all(|of| !of.is_new));
        }
        bench.step();
        for of in tracked(&mut set, &bench, &both) {
            assert!((of.share - 0.5).abs() < 1e-6, "{of:?}");
        }
    }
}
