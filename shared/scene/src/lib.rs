//! Scenes: a TOML file becomes a validated, immutable [`ScenePlan`]. The crate opens no file; its
//! host hands files in as values ([`Files`]).
//!
//! | module | content |
//! |---|---|
//! | `files` | access to the files that a scene names |
//! | `source` | text, errors with line numbers, reading of single numbers |
//! | `limits` | limits and shared defaults of the numbers |
//! | `typed` | the scene as typed, read by serde |
//! | `plan` | the validated plan, SI units |
//! | `portable` | the text of a scene for a machine without its files |
//! | `validate` | from the scene as typed to the plan |
//! | `wording` | what serde refuses, in the words of a scene |
//! | `bytes` | sizes such as `16MiB` |
//!
//! ```
//! use scene::{NoFiles, Overrides, parse};
//! use std::path::Path;
//!
//! let text = "[[object]]\nmodel = \"bunny.spm\"\nsize_m = 0.15\n[[probe]]\n";
//! let plan = parse(text, "touch", Path::new(""), &Overrides::default(), &NoFiles).unwrap();
//! assert_eq!(plan.loop_.rate_hz, 1000.0);
//! assert_eq!(plan.objects.len(), 1);
//!
//! let text = "[loop]\nrate_hz = 1\n";
//! let error = parse(text, "touch", Path::new(""), &Overrides::default(), &NoFiles);
//! assert!(error.is_err());
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod bytes;
mod files;
mod limits;
mod passivity;
mod plan;
mod portable;
mod source;
mod typed;
mod validate;
mod wording;

pub use bytes::parse_bytes;
pub use files::{Files, NoFiles};
pub use limits::MAX_TOUR_SIDES_PER_S;
pub use passivity::ActiveSurface;
pub use plan::*;
pub use portable::{FileKind, NamedFile, portable};
pub use source::SceneError;
pub use validate::{load, parse};
