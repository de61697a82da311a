//! The errors of a model.
//!
//! | error | module | is |
//! |---|---|---|
//! | certified, R | `certified` | a bound of every front, both ways |
//! | certified, C | `close` | a tighter one, of the fronts {E > t} |
//! | quarters | `close::parts`, `choice` | of the points of some faces, one way |
//! | expected, E | `expected` | sampled while simplifying; drives the dial |

mod certified;
mod choice;
mod close;
mod descendants;
mod expected;
mod fronts;
mod full_surface;
mod triangle;

pub use certified::descendant_radius;
pub use choice::{candidates, quarter_bounds};
pub use close::{LargeFace, Patches, close_bounds};
pub use descendants::Descendants;
pub use expected::ExpectedErrors;
pub use fronts::Fronts;
