//! The device of a probe.

use crate::files::{Files, read_text};
use crate::limits::{
    ENCODER_M, ENCODER_RAD, MAX_COEFFICIENT, MAX_ENCODER_RAD, NOT_NEGATIVE, Range, rounded_up,
};
use crate::plan::{
    CustomDevicePlan, DeviceRotationPlan, HandImpedance, ProbeShape, ScenePlan,
    SimulatedDevicePlan, device_steps,
};
use crate::source::{SceneError, Source, key};
use crate::typed::{DeviceFileTyped, DeviceTyped, ProbeTyped, SimulatedTyped, Whole};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// The mechanics of the device of a probe of this shape, and the custom device if it is one. The
/// defaults stand for the mechanics of a custom device.
pub(super) fn device_plan(
    source: &Source,
    typed: Option<&DeviceTyped>,
    shape: &ProbeShape,
) -> Result<(SimulatedDevicePlan, Option<CustomDevicePlan>), SceneError> {
    let default = || simulated(source, &SimulatedTyped::default(), shape);
    match typed {
        Some(DeviceTyped::Simulated(device)) => Ok((simulated(source, device, shape)?, None)),
        Some(DeviceTyped::Custom(table)) => Ok((default()?, Some(custom(source, table)?))),
        None => Ok((default()?, None)),
    }
}

/// The device that a file of the command line describes.
pub(super) fn device_of_file(
    files: &dyn Files,
    file: &Path,
    shape: &ProbeShape,
) -> Result<(SimulatedDevicePlan, Option<CustomDevicePlan>), SceneError> {
    let shown = file.display().to_string();
    let text = read_text(files, file).map_err(|error| {
        SceneError(format!(
            "--device {shown}: cannot be read ({error}); name a file with a line such as device = {{ custom = {{ name = \"...\" }} }}"
        ))
    })?;
    let source = Source {
        shown: &shown,
        text: &text,
        folder: Path::new(""),
        files,
        maps: RefCell::default(),
    };
    let typed: DeviceFileTyped = source.typed()?;
    let (device, mut custom) = device_plan(&source, Some(&typed.device), shape)?;
    if let Some(custom) = &mut custom {
        custom.file = Some(file.to_owned());
    }
    Ok((device, custom))
}

fn custom(source: &Source, table: &Spanned<toml::Table>) -> Result<CustomDevicePlan, SceneError> {
    let mut settings = table.get_ref().clone();
    let Some(toml::Value::String(name)) = settings.remove("name") else {
        return Err(source.value(
            table,
            "a custom device has no name; write custom = { name = \"...\" } with the name that the program registers",
        ));
    };
    Ok(CustomDevicePlan {
        name,
        file: None,
        line: source.line(table.span().start),
        settings,
    })
}

fn simulated(
    source: &Source,
    typed: &SimulatedTyped,
    shape: &ProbeShape,
) -> Result<SimulatedDevicePlan, SceneError> {
    let hand = &typed.hand;
    let hand_stiffness = ("hand's stiffness_n_per_m", &hand.stiffness_n_per_m);
    let hand_damping = ("hand's damping_ns_per_m", &hand.damping_ns_per_m);
    let mass_kg = Range::Within(1e-6, MAX_COEFFICIENT);
    let default = SimulatedDevicePlan::default();
    let of_hand = default.hand;
    let mut device = SimulatedDevicePlan {
        mass_kg: source.number(key!(typed.mass_kg), default.mass_kg, mass_kg)?,
        damping_ns_per_m: source.number(
            key!(typed.damping_ns_per_m),
            default.damping_ns_per_m,
            NOT_NEGATIVE,
        )?,
        encoder_m: source.number(key!(typed.encoder_m), default.encoder_m, ENCODER_M)?,
        hand: HandImpedance {
            stiffness_n_per_m: source.number(
                hand_stiffness,
                of_hand.stiffness_n_per_m,
                NOT_NEGATIVE,
            )?,
            damping_ns_per_m: source.number(
                hand_damping,
                of_hand.damping_ns_per_m,
                NOT_NEGATIVE,
            )?,
        },
        rotation: None,
        senses_rotation: is_six(source, ("senses", &typed.senses), true)?,
    };
    // A ball has no torque: its orientation is as the hand wants it unless the scene says more.
    if typed.has_rotation() || !matches!(shape, ProbeShape::Sphere { .. }) {
        device.rotation = Some(rotation(source, typed, &device)?);
    }
    Ok(device)
}

fn rotation(
    source: &Source,
    typed: &SimulatedTyped,
    device: &SimulatedDevicePlan,
) -> Result<DeviceRotationPlan, SceneError> {
    let hand = &typed.hand;
    let hand_stiffness = ("hand's stiffness_nm_per_rad", &hand.stiffness_nm_per_rad);
    let hand_damping = ("hand's damping_nms_per_rad", &hand.damping_nms_per_rad);
    let inertia = Range::Within(1e-12, MAX_COEFFICIENT);
    let default = DeviceRotationPlan::of_handle(device);
    let is_rendered = is_six(source, ("renders", &typed.renders), device.senses_rotation)?;
    if let (true, false, Some(renders)) = (is_rendered, device.senses_rotation, &typed.renders) {
        return Err(source.value(
            renders,
            "a device that senses 3 degrees of freedom renders 3: the work of a torque is not known without the turn; write renders = 3 or senses = 6",
        ));
    }
    let number = |key, default, range| source.number(key, default, range);
    Ok(DeviceRotationPlan {
        inertia_kgm2: number(key!(typed.inertia_kgm2), default.inertia_kgm2, inertia)?,
        damping_nms_per_rad: number(
            key!(typed.damping_nms_per_rad),
            default.damping_nms_per_rad,
            NOT_NEGATIVE,
        )?,
        encoder_rad: number(
            key!(typed.encoder_rad),
            default.encoder_rad.min(MAX_ENCODER_RAD),
            ENCODER_RAD,
        )?,
        hand_stiffness_nm_per_rad: number(
            hand_stiffness,
            default.hand_stiffness_nm_per_rad,
            NOT_NEGATIVE,
        )?,
        hand_damping_nms_per_rad: number(
            hand_damping,
            default.hand_damping_nms_per_rad,
            NOT_NEGATIVE,
        )?,
        is_rendered,
    })
}

/// Whether a number of degrees of freedom is 6, not 3.
fn is_six(
    source: &Source,
    (key, typed): (&str, &Whole),
    default: bool,
) -> Result<bool, SceneError> {
    match typed.as_ref().map(|typed| (typed, *typed.get_ref())) {
        None => Ok(default),
        Some((_, 6)) => Ok(true),
        Some((_, 3)) => Ok(false),
        Some((typed, other)) => Err(source.value(
            typed,
            &format!("{key} is {other}; write 3 (translation) or 6 (rotation too)"),
        )),
    }
}

/// Refuses a simulated device whose hand its integrator cannot hold at the rate of the loop. With
/// the step h, the semi-implicit Euler method is stable for `k h² + 2 b h < 4 m`, and for `k h² < 4
/// I` where its damping is implicit. `files` of the command line describe the first devices.
pub(super) fn check(
    source: &Source,
    typed: &[Spanned<ProbeTyped>],
    files: &[PathBuf],
    plan: &ScenePlan,
) -> Result<(), SceneError> {
    let period_s = 1.0 / plan.loop_.rate_hz;
    let step = period_s / f64::from(device_steps(period_s));
    for (k, (typed, probe)) in typed.iter().zip(&plan.probes).enumerate() {
        let device = &probe.device;
        let damping = device.damping_ns_per_m + device.hand.damping_ns_per_m;
        let spring = device.hand.stiffness_n_per_m * step * step;
        let least_kg = 0.25 * (spring + 2.0 * damping * step);
        let refuse = |key: &str, value: f64, least: f64| {
            let sentence = format!(
                "{key} of the simulated device is {value}: its hand would shake it apart at this rate; write {:.3e} or more, or a softer hand",
                rounded_up(least)
            );
            match files.get(k) {
                Some(file) => SceneError(format!("--device {}: {sentence}", file.display())),
                None => source.value(typed, &sentence),
            }
        };
        if device.mass_kg <= least_kg {
            return Err(refuse("mass_kg", device.mass_kg, least_kg));
        }
        if let Some(rotation) = &device.rotation {
            let least = 0.25 * rotation.hand_stiffness_nm_per_rad * step * step;
            if rotation.inertia_kgm2 <= least {
                return Err(refuse("inertia_kgm2", rotation.inertia_kgm2, least));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::files::{Files, NoFiles};
    use crate::plan::{DeviceRotationPlan, Overrides, SimulatedDevicePlan};
    use crate::validate::parse;
    use std::io;
    use std::path::{Path, PathBuf};

    /// The file arm.toml in the current folder.
    struct Arm<'a>(&'a str);

    impl Files for Arm<'_> {
        fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
            if path == Path::new("arm.toml") {
                Ok(self.0.into())
            } else {
                NoFiles.read(path)
            }
        }

        fn absolute(&self, path: &Path) -> io::Result<PathBuf> {
            NoFiles.absolute(path)
        }
    }

    #[test]
    fn a_device_of_the_command_line_replaces_the_scenes() {
        let text = "[[object]]\nmodel = \"a.spm\"\nsize_m = 1.0\n[[probe]]\ndevice = { simulated = { mass_kg = 2.0 } }\n[[probe]]\n";
        let with = |content: &str, count: usize| {
            let files = Arm(content);
            let overrides = Overrides {
                devices: vec!["arm.toml".into(); count],
                ..Overrides::default()
            };
            parse(text, "test.toml", Path::new("far"), &overrides, &files)
        };
        let plan = with("device = { simulated = { mass_kg = 0.5 } }", 1).unwrap();
        assert_eq!(plan.probes[0].device.mass_kg, 0.5);
        assert_eq!(plan.probes[1].device.mass_kg, 0.1);
        let plan = with("\n[device.custom]\nname = \"arm\"\nport = 3\n", 2).unwrap();
        let custom = plan.probes[1].custom_device.as_ref().unwrap();
        assert_eq!(custom.name, "arm");
        assert_eq!(custom.file.as_deref(), Some(Path::new("arm.toml")));
        assert_eq!(custom.line, 2);
        for (content, count, named) in [
            ("device = {}", 1, "arm.toml, line 1"),
            (
                "\ndevice = { custom = { port = 3 } }",
                1,
                "arm.toml, line 2",
            ),
            (
                "device = { simulated = { mass_kg = -1.0 } }",
                1,
                "arm.toml, line 1",
            ),
            (
                "device = { simulated = {} }",
                3,
                "--device is given 3 times",
            ),
            // Too light for its hand, which is known with the rate of the scene.
            (
                "device = { simulated = { mass_kg = 2e-6 } }",
                2,
                "--device arm.toml: mass_kg",
            ),
        ] {
            let refused = with(content, count).unwrap_err().0;
            assert!(refused.contains(named), "{refused}");
        }
        let missing = Overrides {
            devices: vec!["none.toml".into()],
            ..Overrides::default()
        };
        let refused = parse(text, "test.toml", Path::new(""), &missing, &NoFiles).unwrap_err();
        assert!(refused.0.contains("--device none.toml"), "{refused}");
    }

    /// A scene of a probe, the keys of its shape and its simulated device.
    fn device(shape: &str, keys: &str) -> Result<SimulatedDevicePlan, String> {
        let text = format!(
            "[[object]]\nmodel = \"a.spm\"\nsize_m = 1.0\n[[probe]]\nshape = {shape}\ndevice = {{ simulated = {{ {keys} }} }}\n"
        );
        let none = Overrides::default();
        let plan = parse(&text, "test.toml", Path::new(""), &none, &NoFiles);
        plan.map(|plan| plan.probes[0].device)
            .map_err(|error| error.0)
    }

    const BALL: &str = "{ sphere = {} }";
    const ROD: &str = "{ cylinder = { radius_m = 0.004, length_m = 0.06 } }";

    #[test]
    fn a_tool_turns_as_its_handle_does_and_a_ball_as_its_hand() {
        assert_eq!(device(BALL, "").unwrap(), SimulatedDevicePlan::default());
        let plan = device(ROD, "mass_kg = 0.2, encoder_m = 3e-5").unwrap();
        let rotation = plan.rotation.unwrap();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12 * b;
        assert!(close(rotation.inertia_kgm2, 0.2 * 9e-4));
        assert!(close(rotation.encoder_rad, 1e-3));
        assert!(close(rotation.hand_stiffness_nm_per_rad, 0.18));
        assert!(rotation.is_rendered && plan.renders_torque() && plan.senses_rotation);
        let keys = "inertia_kgm2 = 1e-4, damping_nms_per_rad = 2e-3, encoder_rad = 0.0, renders = 3, hand = { stiffness_nm_per_rad = 0.5, damping_nms_per_rad = 3e-3 }";
        for shape in [BALL, ROD] {
            let plan = device(shape, keys).unwrap();
            let expected = DeviceRotationPlan {
                inertia_kgm2: 1e-4,
                damping_nms_per_rad: 2e-3,
                encoder_rad: 0.0,
                hand_stiffness_nm_per_rad: 0.5,
                hand_damping_nms_per_rad: 3e-3,
                is_rendered: false,
            };
            assert_eq!(plan.rotation, Some(expected));
            assert!(!plan.renders_torque());
        }
        let blind = device(ROD, "senses = 3").unwrap();
        assert!(!blind.senses_rotation && !blind.renders_torque());
        assert!(device(BALL, "senses = 3").unwrap().rotation.is_none());
    }

    #[test]
    fn a_device_that_cannot_be_so_is_refused_with_its_line() {
        for (keys, line, named) in [
            ("inertia_kgm2 = 0.0", 6, "inertia_kgm2 is 0"),
            ("encoder_rad = 2.0", 6, "encoder_rad is 2"),
            // So small that a place is no finite number of steps.
            ("encoder_rad = 1e-310", 6, "encoder_rad is 1e-310"),
            ("encoder_m = 1e-310", 6, "encoder_m is 1e-310"),
            ("senses = 4", 6, "senses is 4"),
            ("renders = 0", 6, "renders is 0"),
            ("senses = 3, renders = 6", 6, "senses 3"),
            (
                "hand = { stiffness_nm_per_rad = -1.0 }",
                6,
                "stiffness_nm_per_rad is -1",
            ),
            // Unstable: k h² = 4 I, and 2 b h = 4 m, with a step of 62.5 µs.
            (
                "inertia_kgm2 = 1e-9, hand = { stiffness_nm_per_rad = 1.03 }",
                4,
                "inertia_kgm2",
            ),
            ("mass_kg = 9e-5", 4, "mass_kg"),
        ] {
            let refused = device(ROD, keys).unwrap_err();
            let at = format!("test.toml, line {line}:");
            assert!(
                refused.contains(&at) && refused.contains(named),
                "{refused}"
            );
        }
        assert!(
            device(
                ROD,
                "inertia_kgm2 = 1e-9, hand = { stiffness_nm_per_rad = 1.02 }"
            )
            .is_ok()
        );
        assert!(device(ROD, "mass_kg = 1e-4").is_ok());
        assert!(device(ROD, "encoder_m = 1e-12, encoder_rad = 1e-12").is_ok());
        let three = SimulatedDevicePlan::default();
        let stiff = 4.0 * three.mass_kg / (6.25e-5 * 6.25e-5);
        let hand = format!("hand = {{ stiffness_n_per_m = {stiff} }}");
        assert!(device(BALL, &hand).unwrap_err().contains("mass_kg"));
    }

    #[test]
    fn the_number_that_a_refusal_names_is_let_in() {
        // The least: 7.83203e-5 kg and 9.86328e-10 kg m², which four digits would round down.
        for (key, light, hand) in [
            ("mass_kg", 5e-5, "damping_ns_per_m = 1.5"),
            ("inertia_kgm2", 9e-10, "stiffness_nm_per_rad = 1.01"),
        ] {
            let keys = |number: f64| format!("{key} = {number:?}, hand = {{ {hand} }}");
            let refused = device(ROD, &keys(light)).unwrap_err();
            let named = refused.split("write ").nth(1).unwrap_or_default();
            let named = named.split(' ').next().unwrap_or_default();
            let named: f64 = named.parse().expect(&refused);
            assert!(device(ROD, &keys(named)).is_ok(), "{refused}");
            assert!(device(ROD, &keys(0.998 * named)).is_err(), "{refused}");
        }
    }
}
