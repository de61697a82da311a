//! Where a hand goes: presses, slides, hovers, leaves and holds on the surface of an object, in the
//! object's own frame, so that it follows one that moves.

use super::library::Version;
use super::standing_tool::{StandingTool, metres_per_unit};
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::ModelFrame;
use simulator::Random;

/// Ticks between two knots of a path.
const KNOT_TICKS: u64 = 20;
/// How far a hand goes up to leave, metres.
const LEAVE_M: f64 = 0.03;
/// Places on the way down to where a path begins that are looked at.
const WAYPOINTS: u32 = 6;
/// Height at which a path begins, metres.
const START_M: f64 = 6e-3;
/// How far it hovers before it comes back after the faults, metres.
pub const HOVER_M: f64 = 0.012;
/// Ticks in which it goes to that height, at which it stays, and in which it comes down again.
pub const LIFT_TICKS: u64 = 400;
/// See [`LIFT_TICKS`].
pub const HOVER_TICKS: u64 = 600;
/// See [`LIFT_TICKS`].
pub const PRESS_TICKS: u64 = 300;

/// A place of a path.
#[derive(Debug, Clone, Copy)]
struct Knot {
    /// On the full surface, stored coordinates.
    point: DVec3,
    /// Outward, unit.
    normal: DVec3,
    /// Height of the tip above the surface, metres; negative is pressed in.
    height_m: f64,
}

impl Knot {
    /// Whether a tool that stands over it with its tip at a height, metres, meets the full mesh.
    fn is_met(&self, version: &Version, tool: &StandingTool, height_m: f64) -> bool {
        tool.meets(version, [self.point, self.normal], height_m)
    }
}

/// The path of a hand.
#[derive(Debug, Clone)]
pub struct HandPath {
    /// Object of the scene.
    pub object: usize,
    /// How deep it wants to press, metres.
    pub depth_m: f64,
    /// On each version of the model: a hand goes by what it feels.
    knots: [Vec<Knot>; 2],
    /// Numbers of the knots that can be come down to from free space, on both versions; ascending.
    open: Vec<u64>,
}

/// Outward normal of a triangle; up where it has none.
fn normal_of(version: &Version, triangle: u32) -> DVec3 {
    let [a, b, c] = version.full.triangles()[triangle as usize];
    (b - a).cross(c - a).try_normalize().unwrap_or(DVec3::Z)
}

/// Whether a hand may come down to a knot from free space: all the way from where it waits for its
/// object down to the surface nothing else of it is nearer than half of the height, and its tool is
/// clear of it where it waits.
fn is_open(version: &Version, knot: &Knot, tool: Option<&StandingTool>) -> bool {
    let metres_per_unit = metres_per_unit(version);
    let has_room = (1..=WAYPOINTS).all(|k| {
        let share = f64::from(k) / f64::from(WAYPOINTS);
        let height = share * (START_M + HOVER_M) / metres_per_unit;
        let near = version.full.nearest(knot.point + height * knot.normal, 0);
        near.distance >= 0.5 * height
    });
    has_room && tool.is_none_or(|tool| !knot.is_met(version, tool, knot.height_m + HOVER_M))
}

/// Whether the last press over a knot begins clear of the object and ends in it. A ring may go
/// around a peak that the device's position goes into.
fn can_press(version: &Version, knot: &Knot, tool: Option<&StandingTool>, depth_m: f64) -> bool {
    tool.is_none_or(|tool| {
        !knot.is_met(version, tool, HOVER_M) && knot.is_met(version, tool, -0.5 * depth_m)
    })
}

/// Draws a path; what it stands on and how far it has come.
struct Walk<'a> {
    version: &'a Version,
    tool: Option<&'a StandingTool>,
    random: &'a mut Random,
    triangle: u32,
    now: Knot,
    knots: Vec<Knot>,
}

impl Walk<'_> {
    /// So many knots at the same place, the height going there.
    fn go_to_height(&mut self, height_m: f64, knots: u64) {
        let from = self.now.height_m;
        for k in 1..=knots {
            let share = k as f64 / knots as f64;
            // Slow at both ends.
            let eased = share * share * (3.0 - 2.0 * share);
            self.now.height_m = from + (height_m - from) * eased;
            self.knots.push(self.now);
        }
    }

    /// Along the surface towards a place, in so many knots.
    fn slide(&mut self, to: DVec3, knots: u64) {
        let from = self.now.point;
        let to = self.version.within_rim(to);
        for k in 1..=knots {
            let along = from.lerp(to, k as f64 / knots as f64);
            let near = self.version.full.nearest(along, self.triangle);
            self.triangle = near.triangle;
            self.now.point = near.point;
            // The hand turns with the surface, but not at once at an edge.
            let normal = self.now.normal * 2.0 + normal_of(self.version, near.triangle);
            self.now.normal = normal.try_normalize().unwrap_or(self.now.normal);
            self.knots.push(self.now);
        }
    }

    /// Begins over an open place, and does so many knots of what hands do.
    fn touch(&mut self, depth_m: f64, count: usize) {
        let triangles = self.version.full.triangles();
        self.triangle = loop {
            let triangle = self.random.below(triangles.len() as u64) as u32;
            let [a, b, c] = triangles[triangle as usize];
            let middle = (a + b + c) / 3.0;
            self.now = Knot {
                point: middle,
                normal: normal_of(self.version, triangle),
                height_m: START_M,
            };
            if self.version.within_rim(middle) == middle
                && is_open(self.version, &self.now, self.tool)
            {
                break triangle;
            }
        };
        self.knots.clear();
        self.knots.push(self.now);
        self.go_to_height(-0.5 * depth_m, 10);
        let diagonal = self.version.model.file.model_header().diagonal;
        while self.knots.len() <= count {
            self.act(depth_m, diagonal);
        }
        self.knots.truncate(count + 1);
        self.now = self.knots[count];
    }

    /// Goes up, waits there and presses once more.
    fn press_again(&mut self, depth_m: f64) {
        self.go_to_height(HOVER_M, LIFT_TICKS / KNOT_TICKS);
        self.go_to_height(HOVER_M, HOVER_TICKS / KNOT_TICKS);
        self.go_to_height(-0.5 * depth_m, PRESS_TICKS / KNOT_TICKS);
    }

    /// One of the things that hands do.
    fn act(&mut self, depth_m: f64, diagonal: f64) {
        let pressed = -depth_m * (0.3 + 0.7 * self.random.unit());
        match self.random.below(12) {
            0..=2 => {
                self.go_to_height(pressed, 6);
                let knots = 10 + self.random.below(20);
                self.go_to_height(pressed, knots);
            }
            3..=7 => {
                self.go_to_height(pressed, 4);
                let to = self.now.point + self.random.vector() * 0.25 * diagonal;
                let knots = 10 + self.random.below(40);
                self.slide(to, knots);
            }
            8..=9 => {
                let knots = 5 + self.random.below(30);
                self.go_to_height(self.now.height_m, knots);
            }
            10 => {
                let knots = 3 + self.random.below(6);
                let height_m = 1e-3 + 4e-3 * self.random.unit();
                self.go_to_height(height_m, knots);
            }
            _ => {
                self.go_to_height(LEAVE_M, 8);
                let to = self.now.point + self.random.vector() * 0.1 * diagonal;
                self.slide(to, 3);
                self.go_to_height(0.5 * pressed, 8);
            }
        }
    }
}

/// The same path over another version: beside the same places, as high over its surface.
fn moved_over(knots: &[Knot], from: &Version, to: &Version) -> Vec<Knot> {
    let origin_of = |of: &Version| DVec3::from_array(of.model.file.model_header().origin);
    let offset = origin_of(from) - origin_of(to);
    let mut hint = 0;
    let moved = knots.iter().map(|knot| {
        let near = to.full.nearest(to.within_rim(knot.point + offset), hint);
        hint = near.triangle;
        Knot {
            point: near.point,
            normal: normal_of(to, near.triangle),
            height_m: knot.height_m,
        }
    });
    moved.collect()
}

impl HandPath {
    /// A path over an object for so many ticks, which then goes up and presses once more. The depth
    /// is in metres. It is drawn over the first version of the object's model; `tool`: that of the
    /// probe, if it has one.
    #[must_use]
    pub fn draw(
        object: usize,
        [version, rebuilt]: [&Version; 2],
        tool: Option<&StandingTool>,
        depth_m: f64,
        ticks: u64,
        random: &mut Random,
    ) -> Self {
        let mut walk = Walk {
            version,
            tool,
            triangle: 0,
            now: Knot {
                point: DVec3::ZERO,
                normal: DVec3::Z,
                height_m: START_M,
            },
            knots: Vec::new(),
            random,
        };
        // The last press too comes from free space: a hand that would wait inside the object for it
        // says nothing about a controller that begins then.
        loop {
            walk.touch(depth_m, (ticks / KNOT_TICKS) as usize);
            let last = walk.knots.len() - 1;
            let over_rebuilt = moved_over(&walk.knots, version, rebuilt);
            let over = |k: usize| [(version, &walk.knots[k]), (rebuilt, &over_rebuilt[k])];
            let may_come_down = |k: usize| over(k).iter().all(|(of, knot)| is_open(of, knot, tool));
            let can_press = |k: usize| {
                let mut both = over(k).into_iter();
                both.all(|(of, knot)| can_press(of, knot, tool, depth_m))
            };
            if !may_come_down(last) || !can_press(last) {
                continue;
            }
            let open = (0..=last).filter(|&k| may_come_down(k));
            let open = open.map(|k| k as u64).collect();
            walk.press_again(depth_m);
            let over_rebuilt = moved_over(&walk.knots, version, rebuilt);
            return Self {
                object,
                depth_m,
                knots: [walk.knots, over_rebuilt],
                open,
            };
        }
    }

    /// The same, but in the air until the last press.
    #[cfg(test)]
    pub(super) fn hovering(mut self) -> Self {
        let press = (PRESS_TICKS / KNOT_TICKS) as usize;
        for knots in &mut self.knots {
            let in_the_air = knots.len() - press;
            for knot in &mut knots[..in_the_air] {
                knot.height_m = HOVER_M;
            }
        }
        self
    }

    /// The tick, this one or a later one, of the next knot that can be come down to from free
    /// space; of this tick itself after the last.
    #[must_use]
    pub fn next_open(&self, tick: u64) -> u64 {
        let next = self.open.partition_point(|&knot| knot * KNOT_TICKS < tick);
        self.open.get(next).map_or(tick, |knot| knot * KNOT_TICKS)
    }

    /// The pose of the device at a tick, world, metres. `tip_m`: depth of the probe's tip below the
    /// device's position, and by how much higher the hand stays; `turns`: whether the device turns
    /// with the surface; `is_rebuilt`: whether it is over the second version of the model, in whose
    /// frame it goes then.
    #[must_use]
    pub fn pose(
        &self,
        tick: u64,
        (frame, is_rebuilt): (&ModelFrame, bool),
        tip_m: f64,
        turns: bool,
    ) -> Pose {
        let knots = &self.knots[usize::from(is_rebuilt)];
        let last = knots.len() - 1;
        let k = ((tick / KNOT_TICKS) as usize).min(last);
        let (one, next) = (knots[k], knots[(k + 1).min(last)]);
        let share = (tick % KNOT_TICKS) as f64 / KNOT_TICKS as f64;
        let point = frame.to_world(one.point.lerp(next.point, share));
        let normal = one.normal.lerp(next.normal, share);
        let normal = frame.vector_to_world(normal).normalize_or(DVec3::Z);
        let height = one.height_m + (next.height_m - one.height_m) * share;
        Pose {
            position: point + normal * (tip_m + height),
            orientation: if turns {
                DQuat::from_rotation_arc(DVec3::Z, normal)
            } else {
                DQuat::IDENTITY
            },
        }
    }
}
