use super::*;
use crate::{NoFiles, Overrides, parse};
use std::path::Path;

/// A scene of one movable object, on its sixth line.
fn scene(movable: &str) -> Result<ScenePlan, SceneError> {
    parse(
        &text(movable, "size_m = 0.1"),
        "test.toml",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
}

fn text(movable: &str, size: &str) -> String {
    format!(
        "[loop]\nrate_hz = 1000\n[[object]]\nmodel = \"m.spm\"\n{size}\nmovable = {{ {movable} }}\n[[probe]]\n"
    )
}

fn refusal(movable: &str) -> String {
    let message = scene(movable).expect_err(movable).to_string();
    assert!(
        !message.contains('\n') && message.starts_with("test.toml, line 6:"),
        "{message}"
    );
    message
}

/// Its squares are beyond the largest number, or vanish.
#[test]
fn an_axis_of_any_length_is_a_direction() {
    for length in ["1e200", "1e-200", "5e-324"] {
        let axis = format!("axis = [0, 0, {length}], mass_kg = 20");
        for kind in ["hinge", "rail"] {
            let plan = scene(&format!("{kind} = {{ {axis} }}")).unwrap();
            let axis = match plan.objects[0].movable.unwrap() {
                MovablePlan::Hinge(hinge) => hinge.axis,
                MovablePlan::Rail(rail) => rail.axis,
                other => panic!("{other:?}"),
            };
            assert_eq!(axis, DVec3::Z, "{kind} {length}");
        }
    }
}

#[test]
fn each_kind_is_read_with_its_defaults() {
    let read = |movable| scene(movable).unwrap().objects[0].movable.unwrap();
    let MovablePlan::Free(free) = read("free = { mass_kg = 0.2 }") else {
        panic!("it is free");
    };
    let at_rest = SpringDamperPlan {
        spring: 0.0,
        damping: None,
    };
    assert_eq!((free.linear, free.angular), (at_rest, at_rest));
    assert_eq!(free.mass.inertia_kgm2, None);
    let hinge = "hinge = { axis = [0, 0, 2], anchor_m = [0.05, 0, 0], mass_kg = 0.2, damping_nms_per_rad = 0.01, limits_deg = [0, 90] }";
    let MovablePlan::Hinge(hinge) = read(hinge) else {
        panic!("it is on a hinge");
    };
    assert_eq!((hinge.axis, hinge.angular.damping), (DVec3::Z, Some(0.01)));
    assert_eq!(hinge.limits_rad, Some([0.0, std::f64::consts::FRAC_PI_2]));
    let rail =
        "rail = { axis = [1, 0, 0], mass_kg = 0.2, spring_n_per_m = 50, limits_m = [-0.1, 0.1] }";
    let MovablePlan::Rail(rail) = read(rail) else {
        panic!("it is on a rail");
    };
    assert_eq!(
        (rail.linear.spring, rail.limits_m),
        (50.0, Some([-0.1, 0.1]))
    );
    let driven = "driven = { angular_rad_per_s = [0, 0, 10], period_s = 2 }";
    let MovablePlan::Driven(driven) = read(driven) else {
        panic!("it is driven");
    };
    assert_eq!(
        (driven.angular_rad_per_s.z, driven.period_s),
        (10.0, Some(2.0))
    );
}

#[test]
fn a_wrong_number_is_refused_with_its_line() {
    for (movable, key) in [
        ("free = { mass_kg = -0.2 }", "mass_kg"),
        ("free = { mass_kg = nan }", "mass_kg"),
        (
            "free = { mass_kg = 0.2, damping_ns_per_m = -1 }",
            "damping_ns_per_m",
        ),
        (
            "free = { mass_kg = 0.2, spring_nm_per_rad = inf }",
            "spring_nm_per_rad",
        ),
        (
            "free = { mass_kg = 0.2, gravity_m_per_s2 = [0, 0, nan] }",
            "gravity_m_per_s2",
        ),
        (
            "free = { mass_kg = 0.2, inertia_kgm2 = [0.1, 0, 0.1] }",
            "inertia_kgm2",
        ),
        (
            "free = { mass_kg = 0.2, inertia_kgm2 = [0.1, 0.1, 0.3] }",
            "inertia_kgm2",
        ),
        ("hinge = { axis = [0, 0, 0], mass_kg = 0.2 }", "axis"),
        (
            "hinge = { axis = [0, nan, 1], mass_kg = 0.2 }",
            "axis needs three finite numbers",
        ),
        (
            "hinge = { axis = [0, 0, 1], mass_kg = 0.2, anchor_m = [inf, 0, 0] }",
            "anchor_m",
        ),
        (
            "hinge = { axis = [0, 0, 1], mass_kg = 0.2, limits_deg = [90, 0] }",
            "limits_deg",
        ),
        (
            "hinge = { axis = [0, 0, 1], mass_kg = 0.2, limits_deg = [10, 90] }",
            "limits_deg",
        ),
        (
            "rail = { axis = [1, 0, 0], mass_kg = 0.2, limits_m = [0.1, -0.1] }",
            "limits_m",
        ),
        (
            "rail = { axis = [1, 0, 0], mass_kg = 0.2, limits_m = [nan, 0.1] }",
            "limits_m",
        ),
        ("driven = { period_s = 0 }", "period_s"),
        (
            "driven = { angular_rad_per_s = [0, 0, 501] }",
            "angular_rad_per_s",
        ),
        ("driven = { mass_kg = 1 }", "mass_kg"),
        ("swinging = { mass_kg = 1 }", "swinging"),
    ] {
        let message = refusal(movable);
        assert!(message.contains(key), "{movable}: {message}");
    }
}

#[test]
fn a_body_too_light_for_its_surface_is_refused_with_its_smallest_mass() {
    // 800 N/m, 0.5 N s/m: m' = 1e-3 (0.8 + 1.0) = 1.8 g, so 12.6 g for a box.
    for (kind, least) in [("free", 12.6e-3), ("hinge", 12.6e-3), ("rail", 1.8e-3)] {
        let axis = if kind == "free" {
            ""
        } else {
            "axis = [1, 0, 0], "
        };
        let with = |mass: f64| format!("{kind} = {{ {axis}mass_kg = {mass} }}");
        scene(&with(1.001 * least)).unwrap();
        let message = refusal(&with(0.999 * least));
        let named = named(&message);
        assert!(named >= least && named < 1.002 * least, "{message}");
    }
    // With a given inertia the size matters, also that of the command line.
    let given = "free = { mass_kg = 0.1, inertia_kgm2 = [2e-5, 2e-5, 2e-5] }";
    scene(given).unwrap();
    let larger = Overrides {
        size_m: Some(0.2),
        ..Overrides::default()
    };
    let parsed = |size: &str, overrides| {
        parse(
            &text(given, size),
            "test.toml",
            Path::new(""),
            overrides,
            &NoFiles,
        )
    };
    let message = parsed("size_m = 0.1", &larger).unwrap_err().to_string();
    assert!(
        message.contains("line 6:") && message.contains("inertia_kgm2"),
        "{message}"
    );
    let unknown = parsed("metres_per_unit = 1.0", &Overrides::default())
        .unwrap_err()
        .to_string();
    assert!(unknown.contains("size_m"), "{unknown}");
}

/// The number that a refusal tells to write.
fn named(message: &str) -> f64 {
    let told = message.rsplit("write ").next().unwrap_or_default();
    let told = told.trim_start_matches("mass_kg = ");
    let number = told.split(' ').next().unwrap_or_default();
    number.parse().expect(message)
}

#[test]
fn the_mass_that_a_refusal_names_is_let_in() {
    let stiffer = "size_m = 0.1\nsurface = { stiffness_n_per_m = 800.3 }";
    let read = |movable: &str| {
        let none = Overrides::default();
        parse(
            &text(movable, stiffer),
            "test.toml",
            Path::new(""),
            &none,
            &NoFiles,
        )
    };
    // The least: 12.6021 g, 1.8003 g and 1.530255 times both, which four digits would round down.
    let free = |mass: f64| format!("free = {{ mass_kg = {mass:?} }}");
    let rail = |mass: f64| format!("rail = {{ axis = [1, 0, 0], mass_kg = {mass:?} }}");
    let both = |times: f64| {
        let (mass, inertia) = (0.01 * times, 1e-5 * times);
        format!(
            "free = {{ mass_kg = {mass:?}, inertia_kgm2 = [{inertia:?}, {inertia:?}, {inertia:?}] }}"
        )
    };
    let kinds: [(&dyn Fn(f64) -> String, f64); 3] = [(&free, 1e-3), (&rail, 1e-3), (&both, 1.0)];
    for (with, light) in kinds {
        let message = read(&with(light)).unwrap_err().to_string();
        let named = named(&message);
        assert!(read(&with(named)).is_ok(), "{message}");
        assert!(read(&with(0.998 * named)).is_err(), "{message}");
    }
}

#[test]
fn a_driven_object_has_a_few_ticks_a_period() {
    let with = |period_s: f64, rate_hz: f64| {
        let overrides = Overrides {
            rate_hz: Some(rate_hz),
            ..Overrides::default()
        };
        let driven = format!("driven = {{ linear_m_per_s = [1, 0, 0], period_s = {period_s:?} }}");
        let text = text(&driven, "size_m = 0.1");
        parse(&text, "test.toml", Path::new(""), &overrides, &NoFiles)
    };
    for (period_s, rate_hz, least) in [
        (1e-308, 1000.0, "at least 0.004"),
        (0.0039, 1000.0, "at least 0.004"),
        (0.0039, 100.0, "at least 0.04"),
    ] {
        let message = with(period_s, rate_hz).unwrap_err().to_string();
        assert!(
            message.starts_with("test.toml, line 6: period_s") && message.ends_with(least),
            "{message}"
        );
    }
    assert!(with(0.004, 1000.0).is_ok() && with(0.0039, 2000.0).is_ok());
}

#[test]
fn errors_name_the_line_of_the_table_that_made_the_copies() {
    let many = "size_m = 0.1\ngrid = { counts = [129, 1, 1], spacing_m = 1 }";
    let many = parse(
        &text("free = { mass_kg = 0.2 }", many),
        "test.toml",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    );
    let message = many.unwrap_err().to_string();
    assert!(
        message.starts_with("test.toml, line 7:") && message.contains("128"),
        "{message}"
    );
    let mut text = text(
        "free = { mass_kg = 0.2 }",
        "size_m = 0.1\ngrid = { counts = [2, 2, 1], spacing_m = 1 }",
    );
    text += "[[object]]\nmodel = \"n.spm\"\nsize_m = 0.1\nmovable = { rail = { axis = [1, 0, 0], mass_kg = 1e-3 } }\n";
    let message = parse(
        &text,
        "test.toml",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
    .unwrap_err();
    assert!(
        message.to_string().starts_with("test.toml, line 12:"),
        "{message}"
    );
}
