//! What is seen as shapes of rerun.

use super::super::legend::of_fineness;
use super::super::moment::{Fineness, ShownFace};
use geometry::Pose;
use glam::DVec3;
use picture::{Color, mix};
use rerun::{LineStrips3D, Mesh3D, Transform3D};

/// Edges of refined faces.
const EDGE: [u8; 3] = [60, 50, 30];
/// Width of lines, points of the screen.
const EDGE_POINTS: f32 = 0.8;
/// Certified errors are coloured by their logarithm, over so many powers of ten from the largest.
const DECADES: f64 = 3.0;
/// Bytes of a face in a mesh: three corners, each with a place, a normal and a colour.
pub const FACE_BYTES: usize = 3 * (12 + 12 + 4);
/// Bytes of its edges: a strip through four points.
pub const EDGE_BYTES: usize = 4 * 12;

/// Where a front's colours begin: its largest certified error, metres.
#[must_use]
pub fn largest_error(faces: &[ShownFace]) -> f64 {
    let bounds = faces.iter().map(|face| face.certified_m);
    bounds.filter(|m| m.is_finite()).fold(0.0, f64::max)
}

/// The colour of a face: original ones stand out, and the larger the certified error, the more like
/// the base mesh.
#[must_use]
pub fn color(face: &ShownFace, largest_m: f64) -> Color {
    let [base, refined, original] =
        [Fineness::Base, Fineness::Refined, Fineness::Original].map(of_fineness);
    match face.fineness {
        Fineness::Original => original,
        Fineness::Refined if largest_m > 0.0 && face.certified_m.is_finite() => {
            let share = 1.0 + (face.certified_m / largest_m).log10() / DECADES;
            mix(mix(original, refined, 0.6), refined, share)
        }
        Fineness::Refined => refined,
        Fineness::Base => base,
    }
}

/// Faces of one colour each.
#[must_use]
pub fn mesh(faces: impl Iterator<Item = ([DVec3; 3], Color)>) -> Mesh3D {
    let (mut positions, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for ([a, b, c], color) in faces {
        let normal = (b - a).cross(c - a).normalize_or_zero();
        positions.extend([a, b, c].map(point));
        normals.extend([point(normal); 3]);
        colors.extend([rgb(color); 3]);
    }
    Mesh3D::new(positions)
        .with_vertex_normals(normals)
        .with_vertex_colors(colors)
}

/// Edges of faces.
#[must_use]
pub fn edges<'a>(faces: impl Iterator<Item = &'a [DVec3; 3]>) -> LineStrips3D {
    let strips = faces.map(|&[a, b, c]| [a, b, c, a].map(point));
    LineStrips3D::new(strips)
        .with_colors([rgb(EDGE)])
        .with_radii([rerun::Radius::new_ui_points(EDGE_POINTS)])
}

/// A pose.
#[must_use]
pub fn transform(pose: &Pose) -> Transform3D {
    let turn = pose.orientation.as_quat().to_array();
    Transform3D::from_translation_rotation(point(pose.position), rerun::Quaternion::from_xyzw(turn))
}

/// A point or a vector.
#[must_use]
pub fn point(point: DVec3) -> [f32; 3] {
    point.as_vec3().to_array()
}

/// A colour.
#[must_use]
pub fn rgb([r, g, b]: Color) -> rerun::Color {
    rerun::Color::from_rgb(r, g, b)
}
