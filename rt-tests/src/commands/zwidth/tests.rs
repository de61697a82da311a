//! Verdicts on limits, and the limits of made-up loops.

use super::*;

fn loop_of(period_s: f64, whole_ticks: usize, work_s: f64) -> RealLoop {
    RealLoop {
        period_s,
        longest_period_s: period_s,
        whole_ticks,
        work_s,
        work_p99_s: work_s,
        stamps: 1,
    }
}

#[test]
fn the_first_wall_with_the_account_is_tried_too() {
    let up_to = |most: f64| stiffest_by_doubling(100.0, |stiffness| Ok(stiffness <= most));
    assert_eq!(up_to(10.0), Ok(0.0));
    assert_eq!(up_to(50.0), Ok(50.0));
    assert_eq!(up_to(500.0), Ok(400.0));
    // A device without damping has no limit in theory, and no wall is tried.
    let untried = stiffest_by_doubling(0.0, |_| Err(Failure::Run("tried".to_string())));
    assert_eq!(untried, Ok(0.0));
}

#[test]
fn a_command_that_is_to_end_says_so() {
    let device = SimulatedDevicePlan::default();
    let stop = AtomicBool::new(true);
    let ended = curve(&loop_of(1e-3, 0, 0.0), &device, &stop);
    let ended = ended.map(|limits| limits.len());
    let on_request = Failure::Run("ended on request".to_string());
    assert_eq!(ended, Err(on_request.clone()));
    let ended = simulate(loop_of(1e-3, 0, 0.0), &device, &stop);
    assert_eq!(ended.err(), Some(on_request));
}

#[test]
fn a_limit_above_theory_and_its_uncertainty_is_beyond() {
    assert!(!is_beyond([990.0, 1000.0, 5.0]) && !is_beyond([1005.0, 1000.0, 5.0]));
    assert!(is_beyond([1006.0, 1000.0, 5.0]));
    for k in 0..3 {
        let mut of = [990.0, 1000.0, 5.0];
        of[k] = f64::NAN;
        assert!(is_beyond(of), "{of:?}");
    }
}

/// Against moving and against turning; without delay, and with part of a tick.
#[test]
fn the_limit_is_that_of_theory_within_its_uncertainty() {
    for of in [loop_of(1e-3, 0, 0.0), loop_of(5e-4, 0, 1e-4)] {
        let device = SimulatedDevicePlan::default();
        let found = simulate(of, &device, &AtomicBool::new(false));
        let found = found.expect("the walls are there");
        for [measured, theory, uncertainty] in [
            [
                found.k_max_measured,
                found.k_max_theory,
                found.k_max_uncertainty,
            ],
            [
                found.k_max_torsion_measured,
                found.k_max_torsion_theory,
                found.k_max_torsion_uncertainty,
            ],
        ] {
            println!("{measured} {theory} {uncertainty}");
            assert!(measured <= theory + uncertainty, "{found:?}");
            assert!(measured >= 0.99 * theory, "{found:?}");
            assert!(uncertainty < 0.05 * theory, "{found:?}");
        }
        assert_eq!(found.judge(), Ok(()));
        // The account takes a force to act at once.
        assert!(
            of.work_s > 0.0 || found.k_max_with_account > 4.0 * found.k_max_theory,
            "{found:?}"
        );
        let above = Zwidth {
            k_max_torsion_measured: 2.0 * found.k_max_torsion_theory,
            ..found
        };
        assert_eq!(above.beyond(), ["k_max_torsion_measured"]);
        assert!(above.judge().is_err());
    }
}

/// Limits of a device, against moving and against turning: simulated and in theory.
fn limits([own, own_theory]: [f64; 2], [turning, turning_theory]: [f64; 2]) -> Zwidth {
    Zwidth {
        k_max_measured: own,
        k_max_theory: own_theory,
        k_max_uncertainty: 5.0,
        period_s: 1e-3,
        delay_ticks: 0.0,
        damping: 1.0,
        k_max_torsion_measured: turning,
        k_max_torsion_theory: turning_theory,
        k_max_torsion_uncertainty: 0.05,
        damping_torsion: 1e-4,
        mass_kg: 0.1,
        inertia_kgm2: 1e-4,
        k_max_longest_period_theory: own_theory,
        k_max_with_account: own,
        k_max_torsion_with_account: turning,
        measured: loop_of(1e-3, 0, 0.0),
        simulated: [""; 5],
        curve: Vec::new(),
    }
}

#[test]
fn a_limit_far_below_theory_is_a_failure() {
    let (moving, turning) = ([2000.0, 2000.0], [0.2, 0.2]);
    // A hundredth of 2000 N/m and 5 N/m of uncertainty; of 0.2 N m/rad and 0.05.
    assert_eq!(limits([1976.0, 2000.0], turning).judge(), Ok(()));
    for (found, name) in [
        (limits([1974.0, 2000.0], turning), "k_max_measured"),
        (limits([667.0, 2000.0], turning), "k_max_measured"),
        (limits(moving, [0.067, 0.2]), "k_max_torsion_measured"),
    ] {
        let said = found.judge().expect_err("it is below").to_string();
        assert!(
            said.contains("below theory") && said.ends_with(name),
            "{said}"
        );
    }
}

#[test]
fn no_wall_where_theory_has_one_is_a_failure_and_none_without_damping_is_not() {
    let (moving, turning) = ([2000.0, 2000.0], [0.2, 0.2]);
    assert_eq!(limits(moving, turning).judge(), Ok(()));
    assert_eq!(limits([0.0; 2], turning).judge(), Ok(()));
    for (found, name) in [
        (limits([0.0, 2000.0], turning), "k_max_measured"),
        (limits(moving, [0.0, 0.2]), "k_max_torsion_measured"),
        (limits([f64::NAN, 2000.0], turning), "k_max_measured"),
    ] {
        let said = found.judge().expect_err("there is no wall").to_string();
        assert!(said.ends_with(&format!(": {name}")), "{said}");
    }
}

#[test]
fn the_file_of_the_device_names_any_path() {
    let scene = Path::new("/cafe\u{301}/\u{2764}\u{fe0f}.toml");
    let stamps = Path::new("/a \"b\" \\c/stamps");
    let text = stamped_device(scene, stamps).expect("they are UTF-8");
    let table: toml::Table = text.parse().unwrap_or_else(|error| panic!("{error}"));
    let custom = &table["device"]["custom"];
    let read = ["scene", "stamps"].map(|key| custom[key].as_str().map(Path::new));
    assert_eq!(read, [Some(scene), Some(stamps)]);
}
