use crate::{Effect, NoFiles, Overrides, SceneError, ScenePlan, parse};
use std::path::Path;

fn with(text: &str) -> Result<ScenePlan, SceneError> {
    parse(
        text,
        "test.toml",
        Path::new("/nonexistent"),
        &Overrides::default(),
        &NoFiles,
    )
}

const OBJECT: &str = "[[object]]\ngenerate = { shape = \"relief\", faces = 1000 }\nsize_m = 0.15\n";
const PROBE: &str = "[[probe]]\n";

/// An entry of an object's list, on line 4.
fn on_object(entry: &str) -> String {
    format!("{OBJECT}effects = [{{ {entry} }}]\n{PROBE}")
}

/// An entry of the scene's list, on line 1.
fn of_scene(entry: &str) -> String {
    format!("effects = [{{ {entry} }}]\n{OBJECT}{PROBE}")
}

#[test]
fn the_bundled_scene_lists_every_effect_once() {
    let text = include_str!("../../../../config/scenes/effects.toml");
    let plan = with(text).unwrap();
    let mut kinds: Vec<usize> = plan.objects[0]
        .effects
        .iter()
        .chain(&plan.effects)
        .map(|effect| effect.effect.index())
        .collect();
    kinds.sort_unstable();
    assert_eq!(kinds, (0..Effect::NAMES.len()).collect::<Vec<_>>());
}

#[test]
fn a_wrong_parameter_is_refused_with_its_line_and_a_remedy() {
    for (entry, says) in [
        ("friction = { static = -0.1 }", "static is -0.1"),
        ("friction = { static = 3.5 }", "static is 3.5"),
        ("friction = { static = 0.2, dynamic = 0.3 }", "at most 0.2"),
        ("friction = { static = nan }", "static is NaN"),
        ("shading = { radius_m = 0.0 }", "radius_m is 0"),
        (
            "shading = { radius_m = 0.001, max_turn_deg = 90 }",
            "max_turn_deg is 90",
        ),
        // At 0.1 m/s a loop of 1 kHz renders waves above 0.2 mm.
        (
            "texture = { amplitude_m = 1e-6, grating = { wavelength_m = 2e-4 } }",
            "no waves shorter than 0.0002",
        ),
        (
            "texture = { amplitude_m = 1e-3, noise = { wavelength_m = 1e-3 } }",
            "steeper than 45",
        ),
        ("texture = { amplitude_m = 1e-5 }", "exactly one of them"),
        (
            "texture = { amplitude_m = 1e-5, grating = { wavelength_m = 1e-3, direction = [0, 0, 0] } }",
            "direction",
        ),
        (
            "texture = { amplitude_m = 1e-5, height_map = { file = \"no.png\", width_m = 0.1 } }",
            "no.png cannot be used",
        ),
        ("magnet = { force_n = 20, reach_m = 0.01 }", "force_n is 20"),
        (
            "magnet = { force_n = 1, reach_m = 0.001 }",
            "write at least 0.004",
        ),
        (
            "viscosity = { damping_ns_per_m = 0.1 }",
            "at the top of the scene",
        ),
        (
            "friction = { static = 0.2 }, magnet = { force_n = 0.1, reach_m = 0.01 }",
            "is one effect",
        ),
        ("from_s = 1.0", "is one effect"),
        (
            "friction = { static = 0.2 }, from_s = 2.0, until_s = 1.0",
            "not after from_s",
        ),
        ("friction = { static = 0.2 }, fade_s = 0.0", "fade_s is 0"),
        ("friktion = { static = 0.2 }", "friktion"),
        (
            "friction = { static = 0.2 } }, { friction = { static = 0.1 }",
            "already",
        ),
    ] {
        let error = with(&on_object(entry)).unwrap_err().to_string();
        assert!(
            error.contains(says) && error.starts_with("test.toml, line 4: "),
            "{entry}: {error}"
        );
    }
    for (entry, says) in [
        (
            "viscosity = { damping_ns_per_m = -1 }",
            "damping_ns_per_m is -1",
        ),
        // Half a mass of 0.1 kg a tick.
        ("viscosity = { damping_ns_per_m = 51 }", "at most 50"),
        (
            "spring = { point_m = [0, 0, 0], stiffness_n_per_m = -5 }",
            "stiffness_n_per_m is -5",
        ),
        (
            "spring = { point_m = [0, 0, 0], stiffness_n_per_m = 1001 }",
            "at most 1000",
        ),
        ("spring = { stiffness_n_per_m = 5 }", "one of the two"),
        (
            "spring = { path_m = [[0, 0, 0]], stiffness_n_per_m = 5 }",
            "one of the two",
        ),
        (
            "spring = { point_m = [0, inf, 0], stiffness_n_per_m = 5 }",
            "three finite numbers",
        ),
        (
            "vibration = { frequency_hz = 300, amplitude_n = 0.1 }",
            "frequency_hz is 300",
        ),
        (
            "vibration = { frequency_hz = 250, amplitude_n = 5 }",
            "amplitude_n is 5",
        ),
        ("gravity = { mass_kg = 1.0 }", "mass_kg is 1"),
        ("inertia = { mass_kg = 0.0 }", "mass_kg is 0"),
        (
            "inertia = { mass_kg = 0.001, stiffness_n_per_m = 300 }",
            "at most 250",
        ),
        ("boundary = { stiffness_n_per_m = 100 }", "one of the two"),
        (
            "boundary = { box = { lower_m = [0, 0, 0], upper_m = [1, 0, 1] } }",
            "upper_m",
        ),
    ] {
        let error = with(&of_scene(entry)).unwrap_err().to_string();
        assert!(
            error.contains(says) && error.starts_with("test.toml, line 1: "),
            "{entry}: {error}"
        );
    }
}

#[test]
fn the_amplitude_that_a_refusal_names_is_let_in() {
    // Waves from 0.3 mm up, 0.0019 m among them.
    for k in 3..1000 {
        let wavelength_m = f64::from(k) / 10_000.0;
        let texture = |amplitude_m: &str| {
            let waves = format!("grating = {{ wavelength_m = {wavelength_m} }}");
            with(&on_object(&format!(
                "texture = {{ amplitude_m = {amplitude_m}, {waves} }}"
            )))
        };
        let refused = texture("1.0").unwrap_err().to_string();
        let named = refused.split("write at most ").nth(1).expect(&refused);
        assert!(texture(named).is_ok(), "{refused}");
    }
}

#[test]
fn the_speed_that_counts_for_a_texture_is_the_one_that_runs() {
    let text = on_object("texture = { amplitude_m = 1e-5, grating = { wavelength_m = 1e-3 } }");
    assert!(with(&text).is_ok());
    let faster = Overrides {
        speed_m_per_s: Some(1.0),
        ..Overrides::default()
    };
    let error = parse(&text, "test.toml", Path::new(""), &faster, &NoFiles).unwrap_err();
    assert!(
        error.to_string().contains("line 4: wavelength_m"),
        "{error}"
    );
}

#[test]
fn a_surface_effect_of_the_scene_is_every_objects_unless_it_has_its_own() {
    let text = format!(
        "effects = [{{ friction = {{ static = 0.2 }} }}, {{ gravity = {{ mass_kg = 0.1 }} }}]\n{OBJECT}{OBJECT}effects = [{{ friction = {{ static = 0.4 }} }}]\n{PROBE}"
    );
    let plan = with(&text).unwrap();
    assert_eq!(plan.effects.len(), 1);
    let coefficients = plan.objects.iter().map(|object| match &object.effects[..] {
        [only] => match &only.effect {
            Effect::Friction(friction) => friction.static_,
            _ => f64::NAN,
        },
        _ => f64::NAN,
    });
    assert_eq!(coefficients.collect::<Vec<_>>(), [0.2, 0.4]);
}

#[test]
fn friction_of_nothing_is_no_effect() {
    let plan = with(&on_object("friction = { static = 0.0 }")).unwrap();
    assert!(plan.objects[0].effects.is_empty());
}

/// A file of a scene, whatever its name.
struct OneFile(Vec<u8>);

impl crate::Files for OneFile {
    fn read(&self, _: &Path) -> std::io::Result<Vec<u8>> {
        Ok(self.0.clone())
    }

    fn absolute(&self, path: &Path) -> std::io::Result<std::path::PathBuf> {
        Ok(path.to_path_buf())
    }
}

/// A step from black to white within a tenth of its width.
fn step_picture() -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 10, 1);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().unwrap();
    writer
        .write_image_data(&[0, 0, 0, 0, 0, 255, 255, 255, 255, 255])
        .unwrap();
    drop(writer);
    file
}

/// Files that count what is read of them.
struct CountedFiles(OneFile, std::cell::Cell<usize>);

impl crate::Files for CountedFiles {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        self.1.set(self.1.get() + 1);
        self.0.read(path)
    }

    fn absolute(&self, path: &Path) -> std::io::Result<std::path::PathBuf> {
        self.0.absolute(path)
    }
}

#[test]
fn a_picture_is_read_once_for_all_that_name_it() {
    let entry = |file: &str| {
        format!(
            "{OBJECT}effects = [{{ texture = {{ amplitude_m = 1e-5, height_map = {{ file = \"{file}\", width_m = 0.01 }} }} }}]\n"
        )
    };
    let text = entry("map.png").repeat(5) + &entry("other.png") + PROBE;
    let files = CountedFiles(OneFile(step_picture()), std::cell::Cell::new(0));
    let none = Overrides::default();
    let plan = parse(&text, "test.toml", Path::new("/"), &none, &files).unwrap();
    let maps = plan.objects.iter().map(|object| {
        let Effect::Texture(texture) = &object.effects[0].effect else {
            panic!("{:?}", object.effects);
        };
        let crate::Pattern::HeightMap { map, .. } = &texture.pattern else {
            panic!("{:?}", texture.pattern);
        };
        std::sync::Arc::as_ptr(map)
    });
    let maps: Vec<_> = maps.collect();
    assert!(maps[..5].iter().all(|&map| map == maps[0]));
    assert_ne!(maps[0], maps[5]);
    assert_eq!(files.1.get(), 2);
}

#[test]
fn a_height_map_is_no_steeper_than_waves_may_be() {
    let file = step_picture();
    // At 1 mm a sample, of heights from -1 to 1, 0.5 mm are a slope of 1.
    let with_amplitude = |amplitude_m: f64| {
        let text = on_object(&format!(
            "texture = {{ amplitude_m = {amplitude_m}, height_map = {{ file = \"map.png\", width_m = 0.01 }} }}"
        ));
        let none = Overrides::default();
        parse(
            &text,
            "test.toml",
            Path::new("/"),
            &none,
            &OneFile(file.clone()),
        )
    };
    assert!(with_amplitude(0.49e-3).is_ok());
    let error = with_amplitude(0.51e-3).unwrap_err().to_string();
    assert!(
        error.starts_with("test.toml, line 4: amplitude_m is 0.00051"),
        "{error}"
    );
    assert!(error.contains("steeper than 45 degrees"), "{error}");
}

#[test]
fn effects_that_act_at_once_are_stable_together() {
    let spring = |from: &str| {
        format!("{{ spring = {{ point_m = [0, 0, 0], stiffness_n_per_m = 600 }}{from} }}")
    };
    let inertia = "{ inertia = { mass_kg = 0.2, stiffness_n_per_m = 600 } }";
    let magnet = "{ magnet = { force_n = 0.15, reach_m = 0.001 } }";
    let scene = |scene: &[&str], object: &str| {
        let (scene, object) = (scene.join(", "), format!("effects = [{object}]\n"));
        with(&format!("effects = [{scene}]\n{OBJECT}{object}{PROBE}"))
    };
    // Of 1000 N/m on the default device each takes 60 %, and the inertia a little less.
    for alone in [&spring("")[..], inertia, magnet] {
        assert!(scene(&[alone], "").is_ok(), "{alone}");
    }
    for (effects, object, line) in [
        (vec![&spring("")[..], inertia], "", 1),
        (vec![&spring("")[..], magnet], "", 1),
        (vec![&spring("")[..]], magnet, 5),
    ] {
        let error = scene(&effects, object).unwrap_err().to_string();
        let start = format!("test.toml, line {line}: ");
        assert!(
            error.starts_with(&start) && error.contains("spring"),
            "{error}"
        );
        assert!(error.contains("times the stiffness"), "{error}");
    }
    // An object's own magnet takes the place of the scene's.
    let weak = "{ magnet = { force_n = 0.01, reach_m = 0.001 } }";
    assert!(scene(&[&spring("")[..], weak], magnet).is_err());
    // One after the other is stable, but not while the first fades.
    let first = spring(", until_s = 2.0, fade_s = 0.5");
    for (from_s, fits) in [(2.6, true), (2.4, false)] {
        let later = inertia.replace("} }", &format!("}}, from_s = {from_s} }}"));
        assert_eq!(
            scene(&[&first[..], &later[..]], "").is_ok(),
            fits,
            "{from_s}"
        );
    }
    // Drag adds up too: at most 50 N s/m on a mass of 0.1 kg.
    let drag = "{ viscosity = { damping_ns_per_m = 30 } }";
    let damped =
        "{ spring = { point_m = [0, 0, 0], stiffness_n_per_m = 5, damping_ns_per_m = 30 } }";
    assert!(scene(&[drag], "").is_ok() && scene(&[damped], "").is_ok());
    let error = scene(&[drag, damped], "").unwrap_err().to_string();
    assert!(
        error.contains("viscosity, spring together take 1.20 times the damping"),
        "{error}"
    );
}

#[test]
fn a_spring_without_damping_may_be_written_as_such() {
    let spring = |damping: &str| {
        let place = "point_m = [0, 0, 0], stiffness_n_per_m = 500";
        with(&of_scene(&format!("spring = {{ {place}{damping} }}")))
    };
    let plan = spring("").unwrap();
    assert_eq!(spring(", damping_ns_per_m = 0.0"), Ok(plan));
    let refused = spring(", damping_ns_per_m = -0.1").unwrap_err();
    assert!(refused.0.contains("a number from 0 to 50"), "{refused}");
}

#[test]
fn on_a_device_without_damping_only_a_spring_with_damping_is_stable() {
    let probe = "[[probe]]\ndevice = { simulated = { damping_ns_per_m = 0.0 } }\n";
    let scene = |effects: &[&str]| {
        let effects = effects.join(", ");
        with(&format!("effects = [{effects}]\n{OBJECT}{probe}"))
    };
    for effect in [
        "{ spring = { point_m = [0, 0, 0], stiffness_n_per_m = 5 } }",
        "{ spring = { point_m = [0, 0, 0], stiffness_n_per_m = 5, damping_ns_per_m = 0 } }",
        "{ magnet = { force_n = 1, reach_m = 0.01 } }",
    ] {
        let error = scene(&[effect]).unwrap_err().to_string();
        assert!(
            error.starts_with("test.toml, line 1: ") && error.contains("no damping"),
            "{error}"
        );
        assert!(
            !error.contains("at most 0") && !error.contains("inf"),
            "{error}"
        );
    }
    // An effect without stiffness does not hide what others take together.
    let weight = "{ gravity = { mass_kg = 0.1 } }";
    let spring =
        "{ spring = { point_m = [0, 0, 0], stiffness_n_per_m = 4000, damping_ns_per_m = 10 } }";
    let inertia =
        "{ inertia = { mass_kg = 0.2, stiffness_n_per_m = 4000, damping_ns_per_m = 10 } }";
    assert!(scene(&[spring, weight]).is_ok() && scene(&[inertia, weight]).is_ok());
    for effects in [&[spring, inertia][..], &[weight, spring, inertia]] {
        let error = scene(effects).unwrap_err().to_string();
        assert!(error.contains("1.60 times the stiffness"), "{error}");
    }
}
