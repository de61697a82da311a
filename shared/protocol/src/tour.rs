//! What both sides know of a tour before it is made: how fast it may go, and from how high it comes
//! down.

/// The highest speed, longest sides of the model a second: beyond it a period passes whole touches.
pub const FASTEST_SIDES_PER_S: f64 = 20.0;
/// Height above the surface for moves between touches at the most, as a share of the longest side
/// ...
pub const HOVER_SIDES: f64 = 0.12;
/// ... and no more than a tour comes down from in so many seconds: a slow one is to touch too ...
const HOVER_S: f64 = 0.5;
/// ... but at least so many radii of the ball: lower down, hardly any straight way to the next
/// touch is free.
const HOVER_RADII: f64 = 4.0;
/// Radius of the ball that is rolled over the model at least, as a share of the longest side.
const MIN_BALL_SIDES: f64 = 0.004;

/// Radius of the ball that is rolled over a model of this longest side for a probe of this radius.
#[must_use]
pub fn ball_radius(size: f64, radius: f64) -> f64 {
    radius.max(MIN_BALL_SIDES * size)
}

/// Height above the surface at which a tour begins and moves between touches: for a model of this
/// longest side, a speed a second, and a probe of this radius, all in one unit of length. A tour
/// that is no longer touches nothing.
///
/// ```
/// // 0.15 m, 0.1 m/s, 1 mm: as high as the share of the longest side allows.
/// assert_eq!(protocol::tour::hover_height(0.15, 0.1, 0.001), 0.12 * 0.15);
/// assert_eq!(protocol::tour::hover_height(0.15, 1e-4, 0.001), 0.004);
/// ```
#[must_use]
pub fn hover_height(size: f64, speed: f64, radius: f64) -> f64 {
    let hover = (HOVER_S * speed).max(HOVER_RADII * ball_radius(size, radius));
    hover.min(HOVER_SIDES * size)
}
