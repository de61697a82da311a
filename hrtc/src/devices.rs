//! The registry of devices: a scene names a device, the registry makes it.

use haptic_device::{Device, GuardedDevice};
use scene::{ProbePlan, SceneError};
use simulated_device::SimulatedDevice;
use std::collections::BTreeMap;
use std::path::Path;

pub use toml::Table;

/// Arguments of a device's constructor.
#[derive(Debug, Clone, Copy)]
pub struct DeviceRequest<'a> {
    /// The keys of the device's table in the scene, without `name`.
    pub settings: &'a Table,
    /// Index of the probe that the device moves.
    pub probe: usize,
    /// Period of the loop, seconds.
    pub period_s: f64,
}

/// Makes a device, or says in a sentence why not.
type Constructor = Box<dyn Fn(&DeviceRequest<'_>) -> Result<Box<dyn Device>, String>>;

/// Constructors of devices by name. The simulated device is always there.
///
/// A scene names a device of the registry and gives it settings of its own:
/// ```toml
/// [[probe]]
/// device = { custom = { name = "my-device", port = "/dev/ttyUSB0" } }
/// ```
/// The stability limits of a scene's effects take the simulated device's default mass and damping
/// for a custom device: the scene cannot state those of the device itself.
#[derive(Default)]
pub struct DeviceRegistry {
    constructors: BTreeMap<String, Constructor>,
}

impl DeviceRegistry {
    /// The simulated device only.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a device under a name, in place of an earlier one of the same name.
    #[must_use]
    pub fn with(
        mut self,
        name: &str,
        constructor: impl Fn(&DeviceRequest<'_>) -> Result<Box<dyn Device>, String> + 'static,
    ) -> Self {
        self.constructors
            .insert(name.to_owned(), Box::new(constructor));
        self
    }

    /// Names that a scene may give to `custom`, in alphabetical order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.constructors.keys().map(String::as_str)
    }

    /// Makes the device of a probe. `scene` stands for the file in messages.
    ///
    /// # Errors
    /// When the name is unknown or the constructor fails: one sentence with the scene's line.
    pub fn make(
        &self,
        scene: &Path,
        index: usize,
        probe: &ProbePlan,
        period_s: f64,
    ) -> Result<GuardedDevice, SceneError> {
        let Some(custom) = &probe.custom_device else {
            let device = SimulatedDevice::new(probe.device, period_s);
            return Ok(GuardedDevice::new(Box::new(device)));
        };
        let refuse = |sentence: String| {
            let file = custom.file.as_deref().unwrap_or(scene).display();
            SceneError(format!("{file}, line {}: {sentence}", custom.line))
        };
        let name = &custom.name;
        let constructor = self.constructors.get(name).ok_or_else(|| {
            let known: Vec<String> = self.names().map(|known| format!("\"{known}\"")).collect();
            refuse(if known.is_empty() {
                format!(
                    "there is no device \"{name}\", this program has only the simulated one; write device = {{ simulated = {{}} }} or register it with DeviceRegistry::with"
                )
            } else {
                format!(
                    "there is no device \"{name}\"; this program knows {}",
                    known.join(", ")
                )
            })
        })?;
        let request = DeviceRequest {
            settings: &custom.settings,
            probe: index,
            period_s,
        };
        let cannot = |why: String| refuse(format!("the device \"{name}\" cannot be used: {why}"));
        // Guarded from here on: one that is refused is switched off too.
        let device = GuardedDevice::new(constructor(&request).map_err(cannot)?);
        match device.capabilities().fault() {
            Some(fault) => Err(cannot(fault)),
            None => Ok(device),
        }
    }
}

impl std::fmt::Debug for DeviceRegistry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_set().entries(self.names()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haptic_device::{Capabilities, Sample, TickTime, WrenchCommand};
    use scene::{NoFiles, Overrides, parse};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// A device with a force below 0, and how often it was switched off.
    struct Unfit(Arc<AtomicU32>);

    impl Device for Unfit {
        fn capabilities(&self) -> Capabilities {
            Capabilities::translational("unfit", -1.0)
        }
        fn read(&mut self, _: TickTime) -> Option<Sample> {
            None
        }
        fn write(&mut self, _: WrenchCommand) {}
        fn safe_off(&mut self) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn a_device_that_is_refused_after_it_was_made_is_switched_off() {
        let text = "[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[[probe]]\n\
                    device = { custom = { name = \"unfit\" } }\n";
        let overrides = Overrides::default();
        let plan = parse(text, "unfit", Path::new(""), &overrides, &NoFiles).unwrap();
        let offs = Arc::new(AtomicU32::new(0));
        let made = Arc::clone(&offs);
        let registry =
            DeviceRegistry::new().with("unfit", move |_| Ok(Box::new(Unfit(Arc::clone(&made)))));
        let refused = registry.make(Path::new("unfit.toml"), 0, &plan.probes[0], 1e-3);
        let sentence = refused.unwrap_err().to_string();
        assert!(sentence.contains("max_force_n is -1"), "{sentence}");
        assert_eq!(offs.load(Ordering::Relaxed), 1);
    }
}
