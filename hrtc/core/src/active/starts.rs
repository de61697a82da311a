//! Where the pair of a probe and an object begins, whenever the object gets its place.
//!
//! An object that is near may wait for its place, or lose it and have it again, while the hand goes
//! on: a proxy that began where the probe is by then could begin inside. So for every pair that is
//! near the last place is kept where the probe was outside of every front of the object, of which
//! no other one may come later.
//!
//! An object may lose its place while the probe is nearer than that, and has gone round it: then
//! the pair goes on beside its proxy. Not at it: the base mesh, with which the object comes back,
//! may bulge over that. Where there is no such place, as in a narrow pocket or of a tool that
//! touches, it stays where it was.

use geometry::Pose;

/// A probe and an object that is near it, in a tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vicinity {
    /// Where the probe was in the tick before, and where it is; object's axes of each tick, metres.
    pub last: Option<Pose>,
    pub now: Option<Pose>,
    /// Distance of the object's box from the probe, metres.
    pub distance: f64,
    /// Distance from its box up to which the probe may touch a front, metres.
    pub zone: f64,
    /// Whether the object holds the probe's proxy: the probe may be behind it.
    pub is_held: bool,
}

impl Vicinity {
    /// Whether the probe may have been in the object's box since the tick before, and is out again:
    /// its way is as long as to the box. A hand that goes slowly out of the zone has not: each way
    /// is shorter than that.
    fn may_have_passed(&self) -> bool {
        let ends = self.last.zip(self.now);
        let path = ends.map(|(last, now)| last.position.distance(now.position));
        path.is_some_and(|path| path >= self.distance.max(self.zone))
    }
}

/// The start of one pair.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Start {
    /// Tick when the two were last near.
    near_at: Option<u64>,
    /// Tick when the probe may last have gone right through the object.
    passed_at: Option<u64>,
    /// The last place outside; object's axes, metres.
    pose: Option<Pose>,
}

impl Start {
    /// The two are near in a tick. Returns where their pair is to begin in it, if it does; object's
    /// axes, metres. `sleep`: ticks for which a pair that is not near any more goes on.
    pub fn note(&mut self, of: &Vicinity, tick: u64, sleep: u64) -> Option<Pose> {
        let is_recent = |at: u64| tick <= at + sleep;
        if of.may_have_passed() {
            self.passed_at = Some(tick);
        }
        self.pose = match () {
            // It began before, and goes on wherever the probe is.
            () if of.is_held => self.pose,
            // It has just come: in the tick before it was out of reach.
            () if !self.near_at.is_some_and(is_recent) => of.last.or(of.now),
            () if of.distance > of.zone && !self.passed_at.is_some_and(is_recent) => of.now,
            () => self.pose,
        };
        self.near_at = Some(tick);
        self.pose
    }

    /// Where the pair begins, by the last tick in which the two were near.
    pub fn pose(&self) -> Option<Pose> {
        self.pose
    }

    /// The object loses its place: the pair goes on beside its proxy; object's axes, metres.
    pub fn go_on_from(&mut self, beside: Pose) {
        self.pose = Some(beside);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    const SLEEP: u64 = 100;
    const ZONE: f64 = 0.01;

    fn at(height: f64) -> Pose {
        Pose::at(DVec3::Z * height)
    }

    /// Of a flat object at height 0, whose box has no thickness.
    fn beside(last: Option<f64>, now: f64) -> Vicinity {
        Vicinity {
            last: last.map(at),
            now: Some(at(now)),
            distance: now.abs(),
            zone: ZONE,
            is_held: false,
        }
    }

    #[test]
    fn a_pair_begins_at_the_last_place_outside_however_late_it_begins() {
        let mut start = Start::default();
        let (mut last, mut tick) = (None, 7);
        for k in 0..60 {
            let now = 0.0505 - 1e-3 * f64::from(k);
            let begins = start.note(&beside(last, now), tick, SLEEP);
            let due = if now > ZONE { now } else { 0.0105 };
            let height = begins.map(|pose| pose.position.z);
            assert!(
                height.is_some_and(|z| (z - due).abs() < 1e-9),
                "{now}: {height:?}"
            );
            last = Some(now);
            tick += 1;
        }
        // It comes out where it is by then.
        let begins = start.note(&beside(last, -0.02), tick, SLEEP);
        assert_eq!(begins, Some(at(-0.02)));
        assert_eq!(start.pose(), begins);
    }

    #[test]
    fn a_pair_that_comes_at_once_begins_where_the_probe_came_from() {
        // Out of reach before, and inside now.
        let mut start = Start::default();
        assert_eq!(
            start.note(&beside(Some(0.06), 0.0), 5, SLEEP),
            Some(at(0.06))
        );
        // And again after a while.
        let again = 6 + SLEEP;
        let begins = start.note(&beside(Some(-0.06), 0.0), again, SLEEP);
        assert_eq!(begins, Some(at(-0.06)));
        // The first sample of all: nothing else is known.
        let mut start = Start::default();
        assert_eq!(start.note(&beside(None, 0.005), 0, SLEEP), Some(at(0.005)));
        // It is no place outside, but none after it is better.
        assert_eq!(
            start.note(&beside(Some(0.005), 0.0), 1, SLEEP),
            Some(at(0.005))
        );
    }

    #[test]
    fn what_may_have_gone_right_through_begins_before_it_for_a_while() {
        for was_near in [false, true] {
            let mut start = Start::default();
            let mut tick = 50;
            if was_near {
                start.note(&beside(Some(0.06), 0.06), tick, SLEEP);
                tick += 1;
            }
            for k in 0..=SLEEP {
                let last = if k == 0 { 0.06 } else { -0.06 };
                let begins = start.note(&beside(Some(last), -0.06), tick, SLEEP);
                assert_eq!(begins, Some(at(0.06)), "{was_near}, {k}");
                tick += 1;
            }
            // Without a place for so long it has passed.
            let begins = start.note(&beside(Some(-0.06), -0.06), tick, SLEEP);
            assert_eq!(begins, Some(at(-0.06)), "{was_near}");
        }
    }

    #[test]
    fn a_way_that_does_not_reach_the_object_is_none_through_it() {
        let mut start = Start::default();
        start.note(&beside(Some(0.06), 0.06), 1, SLEEP);
        // As far as to the other side, but away.
        let begins = start.note(&beside(Some(0.06), 0.19), 2, SLEEP);
        assert_eq!(begins, Some(at(0.19)));
    }

    #[test]
    fn a_way_through_may_begin_in_the_zone() {
        // On the other side, and on the one from which it came.
        for (ends, due) in [(-0.06, 0.012), (0.04, 0.04)] {
            let mut start = Start::default();
            for (tick, [last, now]) in (1..).zip([[0.012, 0.011], [0.011, 0.005]]) {
                start.note(&beside(Some(last), now), tick, SLEEP);
            }
            let begins = start.note(&beside(Some(0.005), ends), 3, SLEEP);
            assert_eq!(begins, Some(at(due)), "{ends}");
        }
    }

    #[test]
    fn a_hand_that_is_held_is_no_start_behind_the_object() {
        let mut start = Start::default();
        start.note(&beside(Some(0.06), 0.06), 1, SLEEP);
        // It is out of reach for a while.
        for tick in 2 + SLEEP..3 * SLEEP {
            let held = Vicinity {
                is_held: true,
                ..beside(Some(-0.06), -0.06)
            };
            assert_eq!(start.note(&held, tick, SLEEP), Some(at(0.06)), "{tick}");
        }
        // It has come back.
        let begins = start.note(&beside(Some(0.005), 0.005), 3 * SLEEP, SLEEP);
        assert_eq!(begins, Some(at(0.06)));
    }

    #[test]
    fn a_hand_that_went_round_in_the_zone_goes_on_from_where_its_proxy_was() {
        let mut start = Start::default();
        start.note(&beside(Some(0.06), 0.06), 1, SLEEP);
        start.note(&beside(Some(0.06), -0.005), 2, SLEEP);
        start.go_on_from(at(-0.03));
        let begins = start.note(&beside(Some(-0.005), -0.006), 3, SLEEP);
        assert_eq!(begins, Some(at(-0.03)));
        let begins = start.note(&beside(Some(-0.006), -0.011), 4, SLEEP);
        assert_eq!(begins, Some(at(-0.03)), "it may have passed in tick 2");
        let begins = start.note(&beside(Some(-0.011), -0.011), 3 + SLEEP, SLEEP);
        assert_eq!(begins, Some(at(-0.011)));
    }
}
