use super::*;

#[test]
fn a_plate_that_goes_away_shows_nothing() {
    let sheet = model(shapes::sheets(0.0), true).unwrap();
    for (case, is_free) in CASES.iter().zip([false, true]) {
        for (speed, value) in [(1.0, 0.0), (-1.0, f64::INFINITY)] {
            let setup = Setup {
                movable: Some(driven(DVec3::Z * speed, DVec3::ZERO)),
                departs: case.departs,
                ..Setup::default()
            };
            let mut found = Found::new(0.0);
            met_once(&sheet, (setup, is_free), 0.061, &mut found).unwrap();
            let name = case.name;
            assert_eq!(
                (found.value, found.measured()),
                (value, 0.0),
                "{name}, {speed}"
            );
        }
    }
}
