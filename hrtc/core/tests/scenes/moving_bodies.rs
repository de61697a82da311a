//! The integrator of what moves, against mechanics.

use geometry::{Pose, Wrench};
use glam::{DMat3, DQuat, DVec3};
use hrtc_core::bodies::{Body, Extent, material_motion};
use proptest::prelude::*;
use scene::{
    DrivenPlan, FreePlan, HingePlan, MassPlan, MovablePlan, RailPlan, SpringDamperPlan,
    min_coupled_mass,
};
use std::f64::consts::TAU;

const PERIOD_S: f64 = 1e-3;
/// Without friction.
const LOOSE: SpringDamperPlan = SpringDamperPlan {
    spring: 0.0,
    damping: Some(0.0),
};
const AS_USUAL: SpringDamperPlan = SpringDamperPlan {
    spring: 0.0,
    damping: None,
};

fn mass(mass_kg: f64, gravity_m_per_s2: DVec3) -> MassPlan {
    MassPlan {
        mass_kg,
        inertia_kgm2: None,
        gravity_m_per_s2,
    }
}

fn free(mass_kg: f64, rest: SpringDamperPlan) -> MovablePlan {
    MovablePlan::Free(FreePlan {
        mass: mass(mass_kg, DVec3::ZERO),
        linear: rest,
        angular: rest,
    })
}

fn rail(mass_kg: f64, linear: SpringDamperPlan, limits_m: Option<[f64; 2]>) -> MovablePlan {
    MovablePlan::Rail(RailPlan {
        mass: mass(mass_kg, DVec3::ZERO),
        axis: DVec3::X,
        linear,
        limits_m,
    })
}

/// A brick whose middle is not at its origin.
fn brick(size: f64) -> Extent {
    Extent {
        middle: DVec3::new(0.2, -0.1, 0.3) * size,
        sides: DVec3::new(1.0, 0.6, 0.3) * size,
    }
}

fn home() -> Pose {
    Pose {
        position: DVec3::new(0.3, -0.2, 0.1),
        orientation: DQuat::from_scaled_axis(DVec3::new(0.4, -0.7, 0.2)),
    }
}

fn body(plan: MovablePlan, extent: Extent) -> Body {
    let mut body = Body::new(plan, home(), PERIOD_S);
    body.set_extent(extent);
    body
}

fn push(force: DVec3) -> Wrench {
    Wrench {
        force,
        torque: DVec3::ZERO,
    }
}

#[test]
fn a_free_body_under_a_constant_force_goes_half_a_t_squared() {
    let extent = brick(0.1);
    let mut body = body(free(0.2, LOOSE), extent);
    let force = DVec3::new(0.3, -0.1, 0.2);
    let start = home().transform_point(extent.middle);
    for tick in 1..=1000u32 {
        // In its middle, so that it does not turn.
        let middle = body.pose().transform_point(extent.middle);
        body.push(&push(force), middle);
        body.step(u64::from(tick), 1);
        let t = f64::from(tick) * PERIOD_S;
        // The semi-implicit sum, n (n + 1) / 2 steps, to rounding; half a T t from the motion
        // itself.
        let due = force / 0.2 * (0.5 * t * (t + PERIOD_S));
        let went = body.pose().transform_point(extent.middle) - start;
        assert!(went.distance(due) <= 1e-12, "tick {tick}: {went} {due}");
    }
    assert!(body.pose().orientation.angle_between(home().orientation) < 1e-9);
}

#[test]
fn a_hinge_under_gravity_swings_as_a_pendulum() {
    let extent = brick(0.2);
    let (anchor, axis) = (DVec3::new(0.3, 0.0, 0.0), DVec3::Y);
    // Its middle hangs straight below the axis when it is turned by 0.05 rad.
    let arm = (extent.middle - anchor).reject_from_normalized(axis);
    let down = home().orientation * (DQuat::from_axis_angle(axis, 0.05) * arm).normalize();
    let plan = MovablePlan::Hinge(HingePlan {
        mass: mass(0.5, down * 9.81),
        axis,
        anchor_m: anchor,
        angular: LOOSE,
        limits_rad: None,
    });
    let mut body = body(plan, extent);
    assert!(body.is_awake(), "what hangs loose falls");
    let moment = extent.moments(0.5).y + 0.5 * arm.length_squared();
    let period = TAU * (moment / (0.5 * 9.81 * arm.length())).sqrt();
    // Of a pendulum that swings by 0.05 rad it is longer by a sixteenth of the square.
    let period = period * (1.0 + 0.05f64.powi(2) / 16.0);
    let angle = |pose: &Pose| {
        let turn = home().orientation.conjugate() * pose.orientation;
        2.0 * turn.xyz().dot(axis).atan2(turn.w) - 0.05
    };
    let (mut crossings, mut largest) = (Vec::new(), 0.0f64);
    let mut last = angle(&body.pose());
    for tick in 1..40_000u32 {
        body.step(u64::from(tick), 1);
        let now = angle(&body.pose());
        if last < 0.0 && now >= 0.0 {
            crossings.push((f64::from(tick) - now / (now - last)) * PERIOD_S);
        }
        largest = largest.max(now.abs());
        last = now;
        // The anchor stays where it is.
        let held = body.pose().transform_point(anchor);
        assert!(held.distance(home().transform_point(anchor)) < 1e-14);
    }
    let swings = (crossings.len() - 1) as f64;
    let seen = (crossings[crossings.len() - 1] - crossings[0]) / swings;
    println!("{swings} swings of {seen} s, {period} s due; {largest} rad");
    assert!(swings > 30.0 && (seen / period - 1.0).abs() < 1e-4);
    // Forty seconds without friction neither feed nor eat it.
    assert!((largest / 0.05 - 1.0).abs() < 0.01);
}

#[test]
fn a_rail_ends_at_its_stops_and_its_spring_leads_back() {
    let mut stopped = body(rail(0.1, AS_USUAL, Some([-0.01, 0.02])), brick(0.1));
    let along = home().orientation * DVec3::X;
    let way = |body: &Body| (body.pose().position - home().position).dot(along);
    let mut tick = 0;
    for (force, stop) in [(5.0, 0.02), (-5.0, -0.01), (5.0, 0.02)] {
        for _ in 0..500 {
            tick += 1;
            // Whatever lies across does nothing.
            stopped.push(
                &push(along * force + home().orientation * DVec3::Y * 7.0),
                DVec3::ONE,
            );
            stopped.step(tick, 1);
            assert!((-0.01 - 1e-15..=0.02 + 1e-15).contains(&way(&stopped)));
            assert_eq!(stopped.pose().orientation, home().orientation);
        }
        assert!((way(&stopped) - stop).abs() < 1e-15, "{}", way(&stopped));
        // A stop takes all of the speed.
        assert_eq!(stopped.before(), None);
    }
    let sprung = SpringDamperPlan {
        spring: 50.0,
        damping: None,
    };
    let mut back = body(rail(0.1, sprung, None), brick(0.1));
    let mut farthest = 0.0f64;
    for tick in 0..4000 {
        if tick < 100 {
            back.push(&push(along), DVec3::ZERO);
        }
        back.step(tick, 1);
        // It does not swing through.
        assert!(way(&back) >= -1e-12);
        farthest = farthest.max(way(&back));
    }
    assert!(farthest > 1e-3 && way(&back).abs() < 1e-4 * 0.1 && !back.is_awake());
}

#[test]
fn what_tumbles_keeps_its_angular_momentum_and_its_energy_between_two_bounds() {
    let extent = brick(0.1);
    let mut body = body(free(0.2, LOOSE), extent);
    let moments = DMat3::from_diagonal(extent.moments(0.2));
    let spin = Wrench {
        force: DVec3::ZERO,
        torque: DVec3::new(0.02, 0.3, 0.01),
    };
    body.push(&spin, DVec3::ZERO);
    body.step(0, 1);
    let due = spin.torque * PERIOD_S;
    let mut energies = Vec::new();
    for tick in 1..60_000 {
        body.step(tick, 1);
        let before = body.before().expect("it turns");
        let turning = material_motion(&before, &body.pose(), DVec3::ZERO).angular / PERIOD_S;
        // Of the middle of the step.
        let middle = before.orientation.slerp(body.pose().orientation, 0.5);
        let rotation = DMat3::from_quat(middle);
        let momentum = rotation * moments * rotation.transpose() * turning;
        assert!(momentum.distance(due) <= 1e-4 * due.length(), "tick {tick}");
        energies.push(0.5 * momentum.dot(turning));
    }
    let (first, last) = (energies[0], energies[energies.len() - 1]);
    let most = energies.iter().fold(0.0, |most, e| f64::max(most, *e));
    println!("energy {first} J, {last} J after a minute, at most {most} J");
    assert!((last / first - 1.0).abs() < 0.01 && most < 1.01 * first);
    let radius = body
        .pose()
        .transform_point(extent.middle)
        .distance(home().transform_point(extent.middle));
    assert!(radius < 1e-9, "what is only turned stays where it is");
}

#[test]
fn a_driven_object_is_where_its_tick_says() {
    let plan = DrivenPlan {
        linear_m_per_s: DVec3::new(1.0, 0.0, 0.0),
        angular_rad_per_s: DVec3::new(0.0, 0.0, 10.0),
        anchor_m: DVec3::new(0.1, 0.0, 0.0),
        period_s: None,
    };
    let mut steady = body(MovablePlan::Driven(plan), brick(0.1));
    let there_and_back = DrivenPlan {
        period_s: Some(2.0),
        ..plan
    };
    let mut swinging = body(MovablePlan::Driven(there_and_back), brick(0.1));
    let anchor = home().transform_point(plan.anchor_m);
    let along = home().orientation * DVec3::X;
    for tick in 0..4000u64 {
        steady.step(tick, 1);
        swinging.step(tick, 1);
        let t = tick as f64 * PERIOD_S;
        let held = steady.pose().transform_point(plan.anchor_m);
        assert!(held.distance(anchor + along * t) < 1e-12);
        let turn = DQuat::from_rotation_z(10.0 * t);
        let due = home().orientation * turn;
        assert!(steady.pose().orientation.angle_between(due) < 1e-7);
        if let Some(before) = swinging.before() {
            // Never faster than it says.
            let held = material_motion(
                &before,
                &swinging.pose(),
                swinging.pose().transform_point(plan.anchor_m),
            );
            assert!(
                held.linear.length() <= PERIOD_S * (1.0 + 1e-3)
                    && held.angular.length() <= 10.0 * PERIOD_S * (1.0 + 1e-9)
            );
        }
        if tick % 1000 == 0 {
            assert!(
                swinging.pose().position.distance(home().position) < 1e-9,
                "half a period"
            );
        }
        // Nothing pushes it.
        swinging.push(&push(DVec3::splat(1e9)), DVec3::ZERO);
    }
    // In whichever order and however often it is asked.
    steady.step(17, 1);
    let again = steady.pose();
    steady.step(4000, 20);
    steady.step(17, 3);
    assert_eq!(steady.pose(), again);
}

#[test]
fn what_sleeps_keeps_its_bits_and_how_long_it_takes_depends_on_no_length() {
    let mut fell_asleep = Vec::new();
    for exponent in [-4, -2, 0, 2, 4] {
        let scale = 10f64.powi(exponent);
        let extent = brick(0.1 * scale);
        let mut body = body(free(0.2, AS_USUAL), extent);
        let middle = body.pose().transform_point(extent.middle);
        let mut tick = 0u64;
        for _ in 0..50 {
            // A force at an arm: both of the size of the object.
            let arm = DVec3::new(0.02, 0.01, 0.0) * scale;
            body.push(&push(DVec3::new(0.1, 0.0, 0.3) * scale), middle + arm);
            body.step(tick, 1);
            tick += 1;
        }
        let way = (body.pose().position - home().position) / scale;
        while body.is_awake() {
            body.step(tick, 1);
            tick += 1;
            assert!(tick < 20_000, "it comes to rest");
        }
        let asleep = body.clone();
        assert_eq!((asleep.before(), asleep.max_displacement()), (None, 0.0));
        fell_asleep.push((tick, way));
        // A touch wakes it.
        body.push(&push(DVec3::X * scale), DVec3::ZERO);
        assert!(body.is_awake());
        body.step(tick, 1);
        assert_ne!(body.pose(), asleep.pose());
    }
    println!("asleep after {fell_asleep:?}");
    let (tick, way) = fell_asleep[2];
    for (other, there) in &fell_asleep {
        // The place of the object is not scaled: it rounds.
        assert!(
            other.abs_diff(tick) <= 1 && there.distance(way) <= 1e-7 * way.length(),
            "{fell_asleep:?}"
        );
    }
}

#[test]
fn at_the_lightest_that_is_let_in_a_touch_does_not_throw_a_body_off() {
    // A surface of 800 N/m and 0.5 N s/m against a probe that is held.
    let (stiffness, damping) = (800.0, 0.5);
    let least = min_coupled_mass(stiffness, damping, PERIOD_S, 1);
    // How many ticks it touches in a row, at the least, when it was pressed in at rest; and whether
    // it ever is farther out than it was in.
    let pressed = |mass_kg: f64| {
        let mut body = body(rail(mass_kg, LOOSE, None), brick(0.1));
        let along = home().orientation * DVec3::X;
        let way = |body: &Body| (body.pose().position - home().position).dot(along);
        let (mut touched, mut last) = (0, 0.0);
        for tick in 0..1000 {
            let depth = 1e-3 - way(&body);
            if depth <= 0.0 {
                return touched;
            }
            let speed = (way(&body) - last) / PERIOD_S;
            last = way(&body);
            let force = (stiffness * depth - damping * speed).max(0.0);
            body.push(&push(along * force), DVec3::ZERO);
            body.step(tick, 1);
            touched += 1;
        }
        touched
    };
    assert!(pressed(least) >= 2, "{}", pressed(least));
    assert_eq!(
        pressed(0.3 * least),
        1,
        "below it, a single tick throws it off"
    );
    // The bound for boxes holds for every brick, place and direction, and is nearly met.
    let mut most = 0.0f64;
    for k in 0..20_000u32 {
        let unit = |n: u32| {
            f64::from(k.wrapping_mul(2_654_435_761).wrapping_mul(2 * n + 1) >> 8)
                / f64::from(1 << 24)
        };
        let sides = DVec3::new(1.0, unit(1), unit(2) * unit(3));
        let extent = Extent {
            middle: DVec3::ZERO,
            sides: sides.max(DVec3::splat(0.01)),
        };
        let normal = (DVec3::new(unit(4), unit(5), unit(6)) - 0.5).normalize();
        let corner = extent.sides * 0.5;
        let turned = corner.cross(normal);
        most = most.max(1.0 + (turned * turned / extent.moments(1.0)).element_sum());
    }
    println!("1/m' of boxes: at most {most}/m");
    assert!(most <= 7.0 && most > 4.0);
    assert_eq!(free(7.0, LOOSE).min_effective_mass(0.1), 1.0);
}

fn vector() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
}

proptest! {
    /// Forces of any size, at any place, even no numbers: it stays within its greatest speeds, and
    /// comes to rest.
    #[test]
    fn nothing_makes_a_body_faster_than_it_may_be(
        kind in 0..3u32,
        pushes in prop::collection::vec((vector(), vector(), -3..12i32, 0..20u32), 1..60),
    ) {
        let extent = brick(0.1);
        let plan = match kind {
            0 => free(1e-3, AS_USUAL),
            1 => rail(1e-3, AS_USUAL, Some([-0.1, 0.1])),
            _ => MovablePlan::Hinge(HingePlan {
                mass: mass(1e-3, DVec3::ZERO),
                axis: DVec3::Z,
                anchor_m: DVec3::ZERO,
                angular: AS_USUAL,
                limits_rad: Some([-1.0, 2.0]),
            }),
        };
        let mut body = body(plan, extent);
        let mut tick = 0;
        for (force, at, exponent, odd) in pushes {
            let size = match odd { 0 => f64::NAN, 1 => f64::INFINITY, _ => 10f64.powi(exponent) };
            body.push(&push(force * size), at * size.min(1e3));
            body.step(tick, 1 + odd);
            tick += u64::from(1 + odd);
            let pose = body.pose();
            prop_assert!(pose.is_finite());
            prop_assert!((pose.orientation.length() - 1.0).abs() < 1e-12);
            if let Some(before) = body.before() {
                let middle = |pose: &Pose| pose.transform_point(extent.middle);
                let went = middle(&pose).distance(middle(&before));
                let motion = material_motion(&before, &pose, middle(&pose));
                let periods = f64::from(1 + odd);
                // A tenth of its size and of a radian in each.
                prop_assert!(went <= 0.0101 * periods);
                prop_assert!(motion.angular.length() <= (0.1001 * periods).min(3.2));
            }
        }
        for _ in 0..20_000 {
            if !body.is_awake() {
                break;
            }
            body.step(tick, 1);
            tick += 1;
        }
        prop_assert!(!body.is_awake());
    }

    /// A step gives a body no more energy than its force times the way that it goes.
    #[test]
    fn no_step_gives_a_body_more_than_its_force_does_on_the_way(
        forces in prop::collection::vec(-3.0..3.0f64, 1..300),
        spring in 0.0..2000.0f64,
        mass_kg in 0.002..0.5f64,
    ) {
        let rest = SpringDamperPlan { spring, damping: Some(0.01) };
        let mut body = body(rail(mass_kg, rest, None), brick(1.0));
        let along = home().orientation * DVec3::X;
        let mut work = 0.0;
        for (tick, force) in (0..).zip(forces) {
            let at = home().position;
            body.push(&push(along * force), at);
            body.step(tick, 1);
            work += body.work_of(&push(along * force), at).total();
            let way = (body.pose().position - home().position).dot(along);
            let speed = body.before().map_or(0.0, |before| {
                (body.pose().position - before.position).dot(along) / PERIOD_S
            });
            let energy = 0.5 * mass_kg * speed * speed + 0.5 * spring * way * way;
            prop_assert!(
                energy <= work + 1e-9 * (1.0 + energy),
                "tick {}: {} of {}", tick, energy, work
            );
        }
    }

    /// What turns under a resting place moves across its radius: a force along the radius does no
    /// work.
    #[test]
    fn a_force_along_the_radius_does_no_work_on_what_turns(
        axis in vector(), anchor in vector(), angle in 1e-4..0.2f64, place in vector(),
    ) {
        prop_assume!(axis.length() > 0.1);
        let turn = DQuat::from_axis_angle(axis.normalize(), angle);
        let moved = Pose {
            position: anchor + turn * (home().position - anchor),
            orientation: turn * home().orientation,
        };
        let motion = material_motion(&home(), &moved, place);
        let radius = (place - anchor).reject_from(axis);
        let across = motion.linear.dot(radius.normalize_or_zero());
        prop_assert!(across.abs() <= angle.powi(3) * 3.0, "{}", across);
        let error = (motion.linear.length() / angle - radius.length()).abs();
        prop_assert!(error <= 3.0 * angle * angle + 1e-12);
    }
}
