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
use std::path::PathBuf;

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
        let mut typed = Vec::new();
        if let Some(model) = &self.model {
            typed.push("--model".into());
            typed.push(model.into());
        }
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
}
