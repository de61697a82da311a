//! Pictures of meshes without a screen, a window or a graphics card: for reports, and for files of
//! meshes.
//!
//! | module | content |
//! |---|---|
//! | `color` | colours, and the scale that shows a number as one |
//! | `camera` | where a picture is seen from |
//! | `solid` | triangles, and balls, tubes and arrows made of them |
//! | `render` | solids as pixels |
//! | `canvas` | a picture to write and draw on |
//! | `file` | PNG files and animations |
//!
//! ```
//! use glam::DVec3;
//! use picture::{Camera, Canvas, Solids, WHITE, render};
//!
//! let mut solids = Solids::default();
//! solids.ball(DVec3::ZERO, 0.01, [200, 60, 60]);
//! let camera = Camera::new(DVec3::ZERO, DVec3::ONE, DVec3::Z, 0.02);
//! let mut canvas = Canvas::new(320, 240, WHITE);
//! canvas.paste(&render(&solids, &camera, 320, 240, WHITE), 0, 0);
//! assert_eq!(canvas.pixel(0, 0), WHITE);
//! assert_ne!(canvas.pixel(160, 120), WHITE);
//! assert!(canvas.to_png().unwrap().starts_with(b"\x89PNG"));
//! ```

#![forbid(unsafe_code)]

mod camera;
mod canvas;
mod color;
mod file;
mod render;
mod solid;

pub use camera::Camera;
pub use canvas::{Align, Canvas, Size};
pub use color::{Color, ColorScale, WHITE, mix};
pub use file::{PictureError, animation};
pub use render::render;
pub use solid::{Solids, Triangle};
