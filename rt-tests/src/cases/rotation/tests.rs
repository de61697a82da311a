use super::super::case::Size;
use super::super::setup::Setup;
use super::*;
use rand::SeedableRng;

/// The energy account of the product, the work at the samples, and the work at the device, of a
/// device that renders six, and of one that renders three.
#[test]
fn the_account_books_what_the_device_renders_and_nothing_else() {
    for (renders, is_six) in [(6, true), (3, false)] {
        let tool = box_tool(DVec3::new(1e-2, 1e-2, 5e-3));
        let keys = format!("renders = {renders}, encoder_m = 0.0, encoder_rad = 0.0");
        let plan = plan(&tool, [800.0, 0.5], &keys).unwrap();
        let mesh = extruded(&[[-25.0, 0.0], [25.0, 0.0]], 50.0);
        let over = |z: f64, tilt: f64| Pose {
            position: DVec3::Z * z,
            orientation: DQuat::from_rotation_x(tilt),
        };
        let mut held = HeldTool::new(&plan, &Setup::default(), mesh, over(0.01, 0.0)).unwrap();
        let (mut rendered, mut torque) = (DVec3::ZERO, 0.0f64);
        let mut before = held.device().pose.position;
        let mut of_forces = 0.0;
        for tick in 0..3000 {
            let t = f64::from(tick) * 1e-3;
            let wrench = held.lead(over(0.006 + 0.004 * (5.0 * t).cos(), 0.2 * (3.0 * t).sin()));
            let now = held.device().pose.position;
            of_forces += rendered.dot(now - before);
            (rendered, before) = (wrench.force, now);
            torque = torque.max(wrench.torque.length());
        }
        let (account, at_device) = (held.record().energy_j, held.device().work_j);
        assert_eq!(torque > 1e-3, is_six, "{torque}");
        assert!(account < -1e-5, "{account}");
        assert!(
            (account - at_device).abs() < 1e-6 * account.abs(),
            "{account} {at_device}"
        );
        let is_of_forces = (of_forces - at_device).abs() < 1e-9 * account.abs();
        assert_eq!(is_of_forces, !is_six, "{of_forces} {at_device}");
    }
}

#[test]
fn a_case_that_turns_nothing_shows_nothing() {
    let held = Held {
        mesh: extruded(&[[-25.0, 0.0], [25.0, 0.0]], 50.0),
        tool: box_tool(DVec3::splat(5e-3)),
        at: DVec3::Z * 0.05,
        swings: [DVec3::splat(1e-3), DVec3::splat(0.1)],
        lift_m: 0.01,
        upright: 1.0,
    };
    let trial = Trial {
        size: &Size {
            full: false,
            rate_hz: 1e3,
        },
        random: &mut Xoshiro256PlusPlus::seed_from_u64(1),
        defaults: Setup::default(),
    };
    let found = passivity(trial, &held, SOFT).unwrap();
    assert_eq!(found.value, f64::INFINITY);
}

/// Two touches: the first takes a joule in, the second puts a thousandth out.
#[test]
fn what_a_touch_dissipates_hides_nothing_of_the_next() {
    let mut touch = Touch::default();
    let mut found = Found::new(f64::NEG_INFINITY);
    let ticks = [
        (0.0, true),
        (-0.5, false),
        (-1.0, false),
        (-1.0, true),
        (-0.999, false),
        (-1.2, false),
    ];
    for (work_j, is_off) in ticks {
        found.most(touch.put_out_j(work_j, is_off));
    }
    assert!((found.value - 1e-3).abs() < 1e-12, "{}", found.value);
    found.most(touch.put_out_j(f64::NAN, false));
    assert_eq!(found.value, f64::INFINITY);
}

#[test]
fn a_force_counts_by_its_size_and_a_third_of_each_is_too_little() {
    let share = |ticks: &[(f64, f64)]| {
        let mut sums = Withheld::default();
        for &(wanted, rendered) in ticks {
            sums.add(wanted, rendered);
        }
        sums.share()
    };
    // All of many small forces is less than half of a large one; more than is wanted is none.
    assert_eq!(share(&[(0.1, 0.0); 4]), 1.0);
    assert!((share(&[(0.1, 0.0), (0.1, 0.3), (3.8, 1.9)]) - 0.5).abs() < 1e-12);
    let third = share(&[(3.0, 1.0), (1.5, 0.5)]);
    assert!(third > MAX_WITHHELD && (third - 2.0 / 3.0).abs() < 1e-12);
    assert!(share(&[]).is_nan());
}

#[test]
fn a_ball_in_a_hand_keeps_most_of_its_force() {
    let run = (
        &Size {
            full: false,
            rate_hz: 1e3,
        },
        &mut Xoshiro256PlusPlus::seed_from_u64(1),
        Setup::default(),
    );
    let share = withheld_of(&ball(), run).unwrap();
    assert!(share > 0.0 && share < 0.1, "{share}");
}

/// The whole energy of its spring comes back before it leaves the walls, 9 mm high.
#[test]
fn a_blade_that_is_turned_back_is_upright_before_it_leaves_the_slot() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let is_turned = |held: &Held, random: &mut Xoshiro256PlusPlus| {
        let mut hand = Swings::new(held, random);
        let poses = (0..4000).map(|tick| hand.pose(f64::from(tick) * 1e-3));
        let mut out = poses.filter(|pose| pose.position.z > 2.6e-3);
        out.any(|pose| pose.orientation != DQuat::IDENTITY)
    };
    assert!(!is_turned(&slot_turned_back(), &mut random));
    assert!(is_turned(&slot(), &mut random));
}
