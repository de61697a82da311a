use super::super::case::Size;
use super::*;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

#[test]
fn a_boundary_that_hardly_pushes_shows_nothing() {
    let of = |ticks: &[(f64, f64)]| {
        let mut push = Push::default();
        for &(force_n, due_n) in ticks {
            push.add(force_n, due_n);
        }
        push.is_whole()
    };
    assert!(of(&[(0.0, -1.0), (0.6, 1.0), (0.0, 0.5)]));
    assert!(!of(&[(0.4, 1.0)]) && !of(&[(0.0, -1.0)]) && !of(&[]));
    assert!(!of(&[(f64::NAN, 1.0)]) && !of(&[(1.0, f64::NAN)]));
}

#[test]
fn a_magnet_that_does_not_pull_does_not_pass() {
    let size = Size {
        full: false,
        rate_hz: 1e3,
    };
    // Once with the plate out of reach.
    for (height, is_there) in [(0.0, true), (-1.0, false)] {
        let found = magnet_loop(Trial {
            size: &size,
            random: &mut Xoshiro256PlusPlus::seed_from_u64(1),
            defaults: Setup {
                pose: Pose::at(DVec3::Z * height),
                ..Setup::default()
            },
        })
        .unwrap();
        assert_eq!(found.value.is_finite(), is_there, "{}", found.value);
        assert!(found.measured() <= 1.1, "{}", found.measured());
    }
}
