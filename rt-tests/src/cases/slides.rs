//! Slides of a pressed probe along a surface and over its edges: how the force changes, and that it
//! is there.

use super::bench::Bench;
use super::case::Found;
use super::setup::Departure;
use glam::DVec3;

/// Share of stiffness times depth that a probe which slides over a ridge must have without the
/// energy account: the proxy is at least the depth away, so that all of it is due. Half, as of a
/// bounce off a wall.
pub(super) const PUSHED_SHARE: f64 = 0.5;

/// The forces of a slide along a surface.
struct Slide {
    /// Of the tick before, newtons.
    last: DVec3,
    /// Change of the force in a tick that may be, over the larger force.
    allowed: f64,
    /// A force that is no more is none, newtons.
    none_n: f64,
    /// Whether the energy account may withhold the force.
    has_account: bool,
    /// Ticks without a force.
    without: u32,
}

impl Slide {
    /// From a force on. What is pressed in has one, whatever the account takes of it later.
    fn new(last: DVec3, [allowed, none_n]: [f64; 2], has_account: bool, found: &mut Found) -> Self {
        found.must(last.length() > 0.0);
        Self {
            last,
            allowed,
            none_n,
            has_account,
            without: 0,
        }
    }

    /// A tick: it is to touch, and to have a force where no account takes it. With the account that
    /// is no premise: behind an edge it may take all of the force for as long as the slide goes on.
    fn add(&mut self, force: DVec3, touches: bool, found: &mut Found) {
        // What is no number is no force.
        let has_force = force.length() > self.none_n;
        self.without += u32::from(!has_force);
        found.must(touches && (has_force || self.has_account));
        let larger = self.last.length().max(force.length());
        if larger != 0.0 {
            found.most(force.distance(self.last) / (larger * self.allowed));
        }
        self.last = force;
    }
}

/// Slides along a line from -`reach` to `reach`, metres, at a speed, m/s, and lifts off: the change
/// of the force in a tick over the force times what is allowed. `limits`: that, and a force that is
/// taken for none, newtons.
pub(super) fn slide(
    bench: &mut Bench,
    direction: impl Fn(f64) -> DVec3,
    [reach, speed]: [f64; 2],
    limits: [f64; 2],
    found: &mut Found,
) {
    bench.press(direction(-reach), DVec3::Z);
    let last = bench.touch(direction(-reach)).force;
    let has_account = !bench.setup().departs_in(Departure::Account);
    let mut slide = Slide::new(last, limits, has_account, found);
    let ticks = (2.0 * reach / (speed * bench.period_s())).ceil() as u32;
    for tick in 1..=ticks {
        let at = reach * (2.0 * f64::from(tick) / f64::from(ticks) - 1.0);
        let response = bench.touch(direction(at));
        slide.add(response.force, response.record.contact, found);
    }
    found.log(
        "ticks of a slide without a force, share",
        f64::from(slide.without) / f64::from(ticks),
    );
    bench.travel(DVec3::Z * 0.02);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the forces of a slide over a ridge of 140 degrees come to, of 1 N that is due.
    fn of(forces: &[DVec3], has_account: bool, touches: bool) -> Found {
        let mut found = Found::new(0.0);
        let allowed = 2.0 * 70f64.to_radians().sin();
        let limits = [allowed, PUSHED_SHARE];
        let mut slide = Slide::new(forces[0], limits, has_account, &mut found);
        for &force in &forces[1..] {
            slide.add(force, touches, &mut found);
        }
        found
    }

    #[test]
    fn a_force_that_is_lost_in_one_tick_of_a_slide_fails_it() {
        let whole = [DVec3::Z; 9];
        assert_eq!(of(&whole, false, true).value, 0.0);
        assert_eq!(of(&whole, false, false).value, f64::INFINITY);
        for lost in [DVec3::ZERO, DVec3::Z * 0.4, DVec3::NAN] {
            let mut forces = whole;
            forces[4] = lost;
            assert_eq!(of(&forces, false, true).value, f64::INFINITY, "{lost}");
        }
        // The account may take it: then it is a change like any other, as long as it lasts.
        let mut forces = [DVec3::ZERO; 9];
        forces[0] = DVec3::Z;
        let found = of(&forces, true, true);
        assert!(found.value > 0.5 && found.value < 1.0, "{}", found.value);
        assert_eq!(of(&[DVec3::ZERO; 9], true, true).value, f64::INFINITY);
    }
}
