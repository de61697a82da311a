//! The device of a probe.

use crate::files::{Files, read_text};
use crate::limits::{MAX_COEFFICIENT, NOT_NEGATIVE, Range};
use crate::plan::{CustomDevicePlan, HandImpedance, SimulatedDevicePlan};
use crate::source::{SceneError, Source, key};
use crate::typed::{DeviceFileTyped, DeviceTyped, SimulatedTyped};
use std::path::Path;
use toml::Spanned;

/// The mechanics of a device, and the custom device if it is one. The defaults stand for the
/// mechanics of a custom device.
pub(super) fn device_plan(
    source: &Source,
    typed: Option<&DeviceTyped>,
) -> Result<(SimulatedDevicePlan, Option<CustomDevicePlan>), SceneError> {
    let default = || simulated(source, &SimulatedTyped::default());
    match typed {
        Some(DeviceTyped::Simulated(device)) => Ok((simulated(source, device)?, None)),
        Some(DeviceTyped::Custom(table)) => Ok((default()?, Some(custom(source, table)?))),
        None => Ok((default()?, None)),
    }
}

/// The device that a file of the command line describes.
pub(super) fn device_of_file(
    files: &dyn Files,
    file: &Path,
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
    };
    let typed: DeviceFileTyped = source.typed()?;
    let (device, mut custom) = device_plan(&source, Some(&typed.device))?;
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

fn simulated(source: &Source, typed: &SimulatedTyped) -> Result<SimulatedDevicePlan, SceneError> {
    let hand = &typed.hand;
    let hand_stiffness = ("hand's stiffness_n_per_m", &hand.stiffness_n_per_m);
    let hand_damping = ("hand's damping_ns_per_m", &hand.damping_ns_per_m);
    let mass_kg = Range::Within(1e-6, MAX_COEFFICIENT);
    Ok(SimulatedDevicePlan {
        mass_kg: source.number(key!(typed.mass_kg), 0.1, mass_kg)?,
        damping_ns_per_m: source.number(key!(typed.damping_ns_per_m), 1.0, NOT_NEGATIVE)?,
        encoder_m: source.number(key!(typed.encoder_m), 1e-5, NOT_NEGATIVE)?,
        hand: HandImpedance {
            stiffness_n_per_m: source.number(hand_stiffness, 200.0, NOT_NEGATIVE)?,
            damping_ns_per_m: source.number(hand_damping, 2.0, NOT_NEGATIVE)?,
        },
    })
}

#[cfg(test)]
mod tests {
    use crate::files::{Files, NoFiles};
    use crate::plan::Overrides;
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
}
