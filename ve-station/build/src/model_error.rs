//! The errors of a model.
//!
//! | error | module | is |
//! |---|---|---|
//! | certified, R | `certified` | a bound of every front, both ways |
//! | expected, E | `expected` | sampled while simplifying; drives the dial |

mod certified;
mod expected;
mod full_surface;
mod triangle;

pub use certified::descendant_radius;
pub use expected::ExpectedErrors;
