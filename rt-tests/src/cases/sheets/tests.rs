use super::*;
use hrtc_core::record::CoreRecord;
use rand::SeedableRng;
use spm_builder::SoupMesh;

/// Passes found where the upper side of a sheet of this thickness, metres, is not there: of as
/// many from above as from below, where the lower side is met as it should be.
fn passes(mut lower_side: SoupMesh, sheet: &Sheet) -> (f64, u64) {
    let setup = Setup::default();
    for place in &mut lower_side.positions {
        place[2] -= sheet.thickness * UNITS / setup.size_m;
    }
    let bytes = model(lower_side, true).unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut found = Found::new(0.0);
    sheet
        .pass_each(&bytes, (setup, 0.0), 4, &mut random, &mut found)
        .unwrap();
    (found.value, found.passes)
}

#[test]
fn a_ball_that_rests_on_the_other_side_has_passed_the_first() {
    for thickness in [1e-4, 1e-3] {
        let flat = Sheet {
            thickness,
            height: |_, _| 0.0,
            lower: 0.0,
            certified: None,
        };
        assert_eq!(passes(shapes::plate(), &flat), (12.0, 24), "{thickness}");
        let waved = Sheet {
            height: shapes::wave,
            lower: LOWER_ON_WAVE,
            ..flat
        };
        let mesh = shapes::waved_sheets(0.0, 64);
        assert_eq!(passes(mesh, &waved), (12.0, 24), "{thickness}");
    }
}

/// A front that may be off by more than half of the thickness says nothing of the side.
#[test]
fn on_a_coarse_front_a_ball_may_be_as_much_lower_as_is_certified() {
    let (setup, up) = (Setup::default(), DVec3::Z);
    let sheet = Sheet {
        thickness: 1e-3,
        height: |_, _| 0.0,
        lower: LOWER_ON_WAVE,
        certified: None,
    };
    let keeps = |height: f64, error: Option<f64>| {
        let response = Response {
            force: DVec3::ZERO,
            torque: DVec3::ZERO,
            proxy: DVec3::Z * height,
            record: CoreRecord {
                contact_bounded: error.is_some(),
                certified_error_m: error.unwrap_or(f64::NAN),
                ..CoreRecord::default()
            },
        };
        sheet.keeps(&setup, &response, up)
    };
    for (height, error, expected) in [
        (1e-3, Some(0.0), true),
        (0.9e-3, Some(0.0), false),
        (0.9e-3, Some(1e-4), true),
        (0.0, Some(4e-4), false),
        (0.0, Some(6e-4), true),
        (0.0, None, true),
        (-0.6e-3, None, false),
        (-0.6e-3, Some(6e-4), false),
        (f64::NAN, Some(0.0), false),
    ] {
        assert_eq!(keeps(height, error), expected, "{height} {error:?}");
    }
}
