//! The body in its hand, and the loop that is closed through it.

use super::*;
use scene::HandImpedance;

const PLAN: SimulatedDevicePlan = SimulatedDevicePlan {
    mass_kg: 0.1,
    damping_ns_per_m: 1.0,
    encoder_m: 0.0,
    hand: HandImpedance {
        stiffness_n_per_m: 200.0,
        damping_ns_per_m: 2.0,
    },
    rotation: None,
    senses_rotation: true,
};
const PERIOD_S: f64 = 1e-3;

/// The rotation of the default handle, without encoder steps.
fn rotation() -> DeviceRotationPlan {
    DeviceRotationPlan::of_handle(&PLAN)
}

fn turning(rotation: DeviceRotationPlan) -> SimulatedDevicePlan {
    SimulatedDevicePlan {
        rotation: Some(rotation),
        ..PLAN
    }
}

fn still(position: DVec3) -> Intent {
    Intent::still(Pose::at(position))
}

fn turned(orientation: DQuat) -> Intent {
    Intent::still(Pose {
        position: DVec3::ZERO,
        orientation,
    })
}

/// A command of this force along x, newtons.
fn push(force_n: f64) -> WrenchCommand {
    WrenchCommand::unlimited(Wrench {
        force: DVec3::X * force_n,
        torque: DVec3::ZERO,
    })
}

/// A command of this torque, newton metres.
fn twist(torque: DVec3) -> WrenchCommand {
    WrenchCommand::unlimited(Wrench {
        force: DVec3::ZERO,
        torque,
    })
}

fn read(device: &mut SimulatedDevice) -> Pose {
    device.read(TickTime::default()).unwrap().pose
}

/// A sampled wall in the loop, from a contact at 0.1 m/s; the largest |x| in the last half
/// second.
fn rebound(stiffness: f64) -> f64 {
    let mut device = SimulatedDevice::new(PLAN, 1e-3);
    device.intend(still(DVec3::ZERO));
    device.state.velocity = DVec3::X * 0.1;
    let mut largest: f64 = 0.0;
    for tick in 0..2000 {
        let x = device.read(TickTime::default()).unwrap().pose.position.x;
        device.write(push(-stiffness * x));
        if tick > 1500 {
            largest = largest.max(x.abs());
        }
    }
    largest
}

#[test]
fn the_loop_is_closed_so_too_stiff_a_wall_is_unstable() {
    // b + b_hand = 3 N s/m: passive up to 2 b / T = 6000 N/m, and far beyond that it diverges.
    assert!(rebound(2000.0) < 1e-4);
    assert!(rebound(40_000.0) > 1.0);
}

#[test]
fn the_encoder_quantises_and_the_state_does_not() {
    let mut device = SimulatedDevice::new(
        SimulatedDevicePlan {
            encoder_m: 1e-5,
            ..PLAN
        },
        1e-3,
    );
    assert!(device.read(TickTime::default()).is_none());
    device.intend(still(DVec3::new(1.234_567e-3, 0.0, 0.0)));
    let x = device.read(TickTime::default()).unwrap().pose.position.x;
    assert!((x / 1e-5 - (x / 1e-5).round()).abs() < 1e-9);
    assert!((device.state().pose.position.x - 1.234_567e-3).abs() < 1e-12);
}

/// Position after ten periods, m, of a device that a force holds against its hand.
fn pushed(valid_until_ns: u64, is_off: bool) -> f64 {
    let mut device = SimulatedDevice::new(PLAN, 1e-3);
    device.intend(still(DVec3::ZERO));
    device.write(WrenchCommand {
        valid_until_ns,
        ..push(1.0)
    });
    if is_off {
        device.safe_off();
        device.safe_off();
    }
    let time = TickTime {
        start_ns: 20_000_000,
        periods: 10,
    };
    device.read(time).unwrap().pose.position.x
}

#[test]
fn a_force_ends_with_its_validity_and_by_safe_off() {
    let whole = pushed(u64::MAX, false);
    let half = pushed(15_000_000, false);
    assert!(0.0 < half && half < whole, "{half} {whole}");
    assert_eq!(
        pushed(10_000_000, false),
        0.0,
        "ended before the first period"
    );
    assert_eq!(pushed(u64::MAX, true), 0.0);
}

/// The same with a torsional wall, from a contact at 3 rad/s.
fn torsional_rebound(stiffness: f64) -> f64 {
    let mut device = SimulatedDevice::new(turning(rotation()), PERIOD_S);
    device.intend(still(DVec3::ZERO));
    device.state.angular_velocity = DVec3::X * 3.0;
    let mut largest: f64 = 0.0;
    for tick in 0..2000 {
        let angle = rotation_vector(read(&mut device).orientation).x;
        device.write(twist(DVec3::X * (-stiffness * angle)));
        if tick > 1500 {
            largest = largest.max(angle.abs());
        }
    }
    largest
}

#[test]
fn the_loop_is_closed_in_rotation_too() {
    let rotation = rotation();
    // The same ratios as in translation.
    let bound = 2.0 * (rotation.damping_nms_per_rad + rotation.hand_damping_nms_per_rad) / PERIOD_S;
    assert!(torsional_rebound(bound / 3.0) < 1e-3);
    assert!(torsional_rebound(bound * 7.0) > 0.5);
}

/// A hand and a torque about any axis: where it comes to rest, and how long its swing takes.
#[test]
fn a_hand_holds_the_orientation_by_a_spring_of_the_rotation_vector() {
    let plan = rotation();
    for axis in [DVec3::X, DVec3::new(1.0, -2.0, 0.5).normalize()] {
        for (start, angle) in [(0.0, 0.0), (2.5, 1.5), (-3.0, 0.4)] {
            let wanted = DQuat::from_axis_angle(axis, start);
            let mut device = SimulatedDevice::new(turning(plan), PERIOD_S);
            device.intend(turned(wanted));
            let torque = axis * (plan.hand_stiffness_nm_per_rad * angle);
            device.write(twist(torque));
            for tick in 0..3000 {
                // The quaternion of either sign is the same orientation.
                device.intend(turned(if tick % 2 == 0 { wanted } else { -wanted }));
                read(&mut device);
            }
            let rest = DQuat::from_axis_angle(axis, start + angle);
            let apart = rotation_vector(device.state().pose.orientation * rest.conjugate());
            assert!(apart.length() < 1e-9, "{axis} {start} {angle}: {apart}");
        }
    }
    // Without damping: ω² = k / I, and the swing keeps its size.
    let mut device = SimulatedDevice::new(
        turning(DeviceRotationPlan {
            damping_nms_per_rad: 0.0,
            hand_damping_nms_per_rad: 0.0,
            ..plan
        }),
        PERIOD_S,
    );
    device.intend(turned(DQuat::from_rotation_z(0.5)));
    device.intend(turned(DQuat::IDENTITY));
    let (mut crossings, mut before, mut largest) = (0, 0.5, 0.0f64);
    let ticks = 100_000;
    for tick in 0..ticks {
        let angle = rotation_vector(read(&mut device).orientation).z;
        crossings += u32::from((angle > 0.0) != (before > 0.0));
        before = angle;
        if tick > ticks - 1000 {
            largest = largest.max(angle.abs());
        }
    }
    let rate = (plan.hand_stiffness_nm_per_rad / plan.inertia_kgm2).sqrt();
    let due = rate * f64::from(ticks) * PERIOD_S / std::f64::consts::PI;
    assert!(
        (f64::from(crossings) - due).abs() < 2.0,
        "{crossings}, {due}"
    );
    assert!((largest - 0.5).abs() < 5e-3, "{largest}");
}

#[test]
fn a_hand_that_turns_leads_the_device_at_its_rate() {
    let rate = DVec3::new(0.3, -1.0, 0.6);
    let mut device = SimulatedDevice::new(turning(rotation()), PERIOD_S);
    let mut last = DVec3::ZERO;
    for tick in 0..1500 {
        let orientation = DQuat::from_scaled_axis(rate * (f64::from(tick) * PERIOD_S));
        device.intend(Intent {
            angular_velocity: rate,
            ..turned(orientation)
        });
        read(&mut device);
        last = rotation_vector(orientation * device.state().pose.orientation.conjugate());
    }
    // Behind by what the device's own damping asks of the spring.
    let plan = rotation();
    let behind = rate * (plan.damping_nms_per_rad / plan.hand_stiffness_nm_per_rad);
    let a_step = rate.length() * PERIOD_S / f64::from(device_steps(PERIOD_S));
    assert!(last.distance(behind) < 1.01 * a_step, "{last} {behind}");
    assert!(device.state().angular_velocity.distance(rate) < 1e-6);
}

/// Wrenches that change at random: the work is that of force over displacement and torque over
/// turn, as far as steps are small; what came in is stored or damped.
#[test]
fn the_work_of_the_wrench_is_stored_or_damped() {
    let plan = turning(rotation());
    let free = SimulatedDevicePlan {
        hand: HandImpedance {
            stiffness_n_per_m: 0.0,
            damping_ns_per_m: 0.0,
        },
        rotation: plan.rotation.map(|rotation| DeviceRotationPlan {
            hand_stiffness_nm_per_rad: 0.0,
            hand_damping_nms_per_rad: 0.0,
            ..rotation
        }),
        ..plan
    };
    let mut device = SimulatedDevice::new(free, PERIOD_S);
    device.intend(still(DVec3::ZERO));
    let (mut work, mut before) = (0.0, device.state());
    for tick in 0..2000u32 {
        let any = |k: u32| f64::from((tick / 7 + 1) * (k + 3) % 11) / 11.0 - 0.45;
        let wrench = Wrench {
            force: DVec3::new(any(1), any(2), any(3)),
            torque: DVec3::new(any(4), any(5), any(6)) * 0.02,
        };
        device.write(WrenchCommand::unlimited(wrench));
        read(&mut device);
        let now = device.state();
        let angle = rotation_vector(now.pose.orientation * before.pose.orientation.conjugate());
        work +=
            wrench.force.dot(now.pose.position - before.pose.position) + wrench.torque.dot(angle);
        before = now;
    }
    let state = device.state();
    let kinetic = 0.5 * 0.1 * state.velocity.length_squared()
        + 0.5 * rotation().inertia_kgm2 * state.angular_velocity.length_squared();
    assert!(
        work > 1e-3 && state.damped_j > 0.1 * work,
        "{work} {state:?}"
    );
    assert!(
        (state.work_j - work).abs() < 1e-3 * work,
        "{work} {state:?}"
    );
    let rest = state.work_j - state.damped_j - kinetic;
    // Where a force jumps the method itself takes m Δv² / 2 of a step.
    assert!((0.0..0.15 * work).contains(&rest), "{rest} of {work}");
}

#[test]
fn the_encoder_of_the_orientation_is_within_a_step_of_the_truth() {
    let step = 1e-3;
    let plan = turning(DeviceRotationPlan {
        encoder_rad: step,
        ..rotation()
    });
    let mut changes = 0;
    let mut before = DQuat::IDENTITY;
    let mut device = SimulatedDevice::new(plan, PERIOD_S);
    for tick in 0..5000 {
        // Through half a turn, where the rotation vector jumps.
        let angle = 1e-3 * f64::from(tick);
        let true_ = DQuat::from_axis_angle(DVec3::new(2.0, 1.0, -1.0).normalize(), angle);
        device.state.pose.orientation = true_;
        let sensed = device.sample().pose.orientation;
        let apart = rotation_vector(sensed * true_.conjugate()).length();
        assert!(apart <= 0.87 * step, "{angle}: {apart}");
        changes += u32::from(sensed != before);
        before = sensed;
    }
    assert!(changes > 1000);
}

#[test]
fn a_device_has_the_degrees_of_freedom_that_its_plan_says() {
    let six = turning(rotation());
    let three = turning(DeviceRotationPlan {
        is_rendered: false,
        ..rotation()
    });
    let blind = SimulatedDevicePlan {
        senses_rotation: false,
        ..three
    };
    let wanted = DQuat::from_rotation_y(0.3);
    for (plan, sensed, rendered) in [
        (six, DegreesOfFreedom::Six, DegreesOfFreedom::Six),
        (three, DegreesOfFreedom::Six, DegreesOfFreedom::Three),
        (blind, DegreesOfFreedom::Three, DegreesOfFreedom::Three),
        (PLAN, DegreesOfFreedom::Six, DegreesOfFreedom::Three),
    ] {
        let mut device = SimulatedDevice::new(plan, PERIOD_S);
        let capabilities = device.capabilities();
        assert_eq!(
            (capabilities.sensed, capabilities.rendered),
            (sensed, rendered)
        );
        device.intend(turned(wanted));
        device.write(twist(DVec3::X * 0.01));
        for _ in 0..300 {
            let _ = device.read(TickTime::default());
        }
        let is_turned = device.state().pose.orientation.angle_between(wanted) > 1e-3;
        assert_eq!(is_turned, rendered == DegreesOfFreedom::Six, "{plan:?}");
        assert_eq!(device.state().work_j > 0.0, is_turned);
        let sample = device.sample().pose.orientation;
        let expected = if sensed == DegreesOfFreedom::Six {
            device.state().pose.orientation
        } else {
            DQuat::IDENTITY
        };
        assert!(sample.angle_between(expected) < 1e-3, "{plan:?}");
    }
    // A ball's orientation is the hand's, to the bit.
    let mut device = SimulatedDevice::new(PLAN, PERIOD_S);
    device.intend(turned(wanted));
    device.intend(turned(DQuat::from_rotation_x(1.1)));
    assert_eq!(read(&mut device).orientation, DQuat::from_rotation_x(1.1));
}
