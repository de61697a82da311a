//! Command-line options that replace values of a scene, the same for all programs.
//!
//! ```
//! use clap::Parser;
//!
//! #[derive(Parser)]
//! struct Program {
//!     #[command(flatten)]
//!     overrides: scene_args::OverrideArgs,
//! }
//!
//! let program = Program::parse_from(["program", "--tolerance=1e-4"]);
//! assert_eq!(program.overrides.overrides().tolerance_m, Some(1e-4));
//! assert_eq!(program.overrides.typed(), ["--tolerance=0.0001"]);
//! ```

#![forbid(unsafe_code)]

use clap::Args;
use scene::Overrides;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Options of the command line that replace values of the scene.
#[derive(Debug, Clone, Default, Args)]
pub struct OverrideArgs {
    /// Another model for the first object: an SPM or mesh file; the scene's size is kept
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Longest side of the first object, metres
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub size: Option<f64>,
    /// Speed of the tour, metres a second
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    pub speed: Option<f64>,
    /// Seed of the tour
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<u64>,
    /// Limit of the controller's cache, such as 16MiB
    #[arg(long, value_name = "BYTES", allow_negative_numbers = true)]
    pub cache: Option<String>,
    /// Wanted error at the contact, metres; 0 is the full mesh
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
}

impl OverrideArgs {
    /// As the scene takes them.
    #[must_use]
    pub fn overrides(&self) -> Overrides {
        Overrides {
            model: self.model.clone(),
            size_m: self.size,
            speed_m_per_s: self.speed,
            seed: self.seed,
            cache: self.cache.clone(),
            tolerance_m: self.tolerance,
            ..Overrides::default()
        }
    }

    /// As arguments of another process; `=` keeps a negative number from being read as an option.
    #[must_use]
    pub fn typed(&self) -> Vec<OsString> {
        let model = self.model.iter().map(|model| typed_path("model", model));
        let mut typed: Vec<OsString> = model.collect();
        let numbers = [
            ("size", self.size.map(|v| v.to_string())),
            ("speed", self.speed.map(|v| v.to_string())),
            ("seed", self.seed.map(|v| v.to_string())),
            ("cache", self.cache.clone()),
            ("tolerance", self.tolerance.map(|v| v.to_string())),
        ];
        for (name, value) in numbers {
            if let Some(value) = value {
                typed.push(format!("--{name}={value}").into());
            }
        }
        typed
    }
}

/// The option `--name` with a file, as one argument of another process: a path that begins with a
/// hyphen is not read as an option either, and none needs to be UTF-8.
#[must_use]
pub fn typed_path(name: &str, path: &Path) -> OsString {
    let mut typed = OsString::from(format!("--{name}="));
    typed.push(path);
    typed
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use clap::error::ErrorKind;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        overrides: OverrideArgs,
    }

    #[test]
    fn a_negative_number_is_a_value_and_no_option() {
        let typed = |option: &str| Program::try_parse_from(["program", option, "-1"]);
        let refused = typed("--seed").map_err(|error| error.kind());
        assert_eq!(refused.err(), Some(ErrorKind::ValueValidation));
        let cache = typed("--cache").map(|program| program.overrides.cache);
        assert_eq!(cache.ok().flatten().as_deref(), Some("-1"));
    }

    #[test]
    fn what_is_typed_for_another_process_is_read_again() {
        let read = |typed: Vec<OsString>| {
            let typed = [OsString::from("program")].into_iter().chain(typed);
            Program::try_parse_from(typed).map(|program| program.overrides)
        };
        for model in ["-m.spm", "--size", "a=b c.spm"] {
            let given = vec![format!("--model={model}").into(), "--seed=3".into()];
            let given = read(given).unwrap();
            assert_eq!(given.model.as_deref(), Some(Path::new(model)));
            let again = read(given.typed()).unwrap();
            assert_eq!(again.overrides(), given.overrides());
        }
    }
}
