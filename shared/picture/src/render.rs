//! Solids as pixels: projected, cut, filled and hidden by retrofire's pipeline, with several
//! samples a pixel.

use crate::camera::{Camera, EYE_DISTANCE};
use crate::canvas::Canvas;
use crate::color::{Color, mix};
use crate::solid::{Solids, Triangle};
use glam::DVec3;
use retrofire_core::geom::{Tri, Vertex3, tri, vertex};
use retrofire_core::math::color::{Color3f, Color4, rgb, rgba};
use retrofire_core::math::{ProjMat3, Vec3, perspective, pt3, vec3, viewport};
use retrofire_core::render::{Colorbuf, Context, Frag, Framebuf, View, shader};
use retrofire_core::util::pixfmt::Rgba8888;
use retrofire_core::util::{Buf2, Dims};

/// Samples a pixel, along each axis.
const SAMPLES: u32 = 2;
/// Width of an edge, samples.
const EDGE: f64 = 1.1 * SAMPLES as f64;
/// Height of a face below which its edges are drawn fainter, samples: or small faces were all edge.
const CLEAR_HEIGHT: f64 = 5.0 * EDGE;
/// Light on a face that the lamp does not reach.
const AMBIENT: f64 = 0.45;
/// The lamp is beside the eye: so much of the distance to the left and upwards, so that faces of
/// any direction differ.
const LAMP: [f64; 2] = [0.45, 0.65];
/// Bits of a channel that are left out: with them edges have so many colours that a file is twice
/// as large.
const DROPPED_BITS: u32 = 3;
/// Share of a mark that shines through what hides it.
const SHINE: f64 = 0.3;
/// Nearest and farthest distances from the eye that are drawn, half widths.
const DEPTHS: std::ops::Range<f32> = 0.05..400.0;

/// What varies over a face: its colour, and the distances from its edges in samples.
type Varying = (Color3f, Vec3);
type Frame = Framebuf<Colorbuf<Buf2<[u8; 4]>, Rgba8888>, Buf2<f32>>;

/// Draws solids as a camera sees them, lit from the eye.
#[must_use]
pub fn render(
    solids: &Solids,
    camera: &Camera,
    width: u32,
    height: u32,
    background: Color,
) -> Canvas {
    let dims = Dims(width * SAMPLES, height * SAMPLES);
    let mut scene = frame(dims, background);
    draw(&solids.opaque, camera, dims, &mut scene);
    // The marks alone: where the scene's depth is another, something hides them.
    let mut marks = frame(dims, background);
    draw(&solids.marks, camera, dims, &mut marks);
    draw(&solids.marks, camera, dims, &mut scene);
    let mut signs = frame(dims, background);
    draw(&solids.signs, camera, dims, &mut signs);
    let sample = |at: usize| {
        let [shown, mark, sign] = [&scene, &marks, &signs].map(|frame| {
            let [r, g, b, _] = frame.color_buf.buf.data()[at];
            ([r, g, b], frame.depth_buf.data()[at])
        });
        match () {
            () if sign.1 > 0.0 => sign.0,
            () if mark.1 > 0.0 && mark.1 < shown.1 => mix(shown.0, mark.0, SHINE),
            () => shown.0,
        }
    };
    let mut canvas = Canvas::new(width, height, background);
    for y in 0..height {
        for x in 0..width {
            canvas.set(x, y, average(x, y, dims.0, &sample));
        }
    }
    canvas
}

/// The mean of a pixel's samples.
fn average(x: u32, y: u32, row: u32, sample: &impl Fn(usize) -> Color) -> Color {
    let mut sums = [0u32; 3];
    for k in 0..SAMPLES * SAMPLES {
        let (sx, sy) = (x * SAMPLES + k % SAMPLES, y * SAMPLES + k / SAMPLES);
        let color = sample((sy * row + sx) as usize);
        for (sum, channel) in sums.iter_mut().zip(color) {
            *sum += u32::from(channel);
        }
    }
    let count = SAMPLES * SAMPLES;
    sums.map(|sum| {
        let high = ((sum / count) >> DROPPED_BITS) as u8;
        high << DROPPED_BITS | high >> (8 - 2 * DROPPED_BITS)
    })
}

/// An empty frame; its depths are reciprocal, so that nothing is as far as 0.
fn frame(dims: Dims, [r, g, b]: Color) -> Frame {
    Framebuf {
        color_buf: Colorbuf::new(Buf2::new_with(dims, |_, _| [r, g, b, 255])),
        depth_buf: Buf2::new_with(dims, |_, _| 0.0),
    }
}

fn draw(triangles: &[Triangle], camera: &Camera, dims: Dims, frame: &mut Frame) {
    let mut vertices: Vec<Vertex3<Varying, View>> = Vec::with_capacity(3 * triangles.len());
    let mut faces: Vec<Tri<usize>> = Vec::with_capacity(triangles.len());
    for triangle in triangles {
        let views = triangle.corners.map(|corner| camera.view(corner));
        let distances = edge_distances(views, dims, triangle.edges);
        for k in 0..3 {
            let [x, y, z] = views[k].as_vec3().to_array();
            let color = lit(triangle.color, triangle.normals[k], camera);
            vertices.push(vertex(pt3(x, y, z), (color, distances[k])));
        }
        let first = vertices.len() - 3;
        faces.push(tri(first, first + 1, first + 2));
    }
    let shader = shader::new(
        |v: Vertex3<Varying, View>, projection: &ProjMat3<View>| {
            vertex(projection.apply(&v.pos), v.attrib)
        },
        |frag: Frag<Varying>, _: &ProjMat3<View>| edged(&frag.var),
    );
    let context = Context {
        face_cull: None,
        ..Context::default()
    };
    let projection = perspective(EYE_DISTANCE as f32, dims.aspect(), DEPTHS);
    let screen = viewport(dims.into());
    retrofire_core::render::render(
        faces,
        vertices,
        &shader,
        &projection,
        screen,
        frame,
        &context,
    );
}

/// The colour of a surface in the light of the lamp; of both sides the one that is seen is lit.
fn lit(color: Color, normal: DVec3, camera: &Camera) -> Color3f {
    let lamp = camera.eye() + camera.along(-LAMP[0], -LAMP[1]);
    let seen = normal.normalize_or_zero() * normal.dot(camera.eye()).signum();
    let facing = seen.dot(lamp.normalize()).max(0.0);
    let light = AMBIENT + (1.0 - AMBIENT) * facing;
    let [r, g, b] = color.map(|channel| (light * f64::from(channel) / 255.0) as f32);
    rgb(r, g, b)
}

/// At each corner of a face the distances from its three edges in samples. They are larger by as
/// much as its edges are to be fainter.
fn edge_distances(views: [DVec3; 3], dims: Dims, edges: f64) -> [Vec3; 3] {
    let half = 0.5 * f64::from(dims.0);
    let [a, b, c] = views.map(|v| (v / v.z).truncate() * EYE_DISTANCE * half);
    let area = (b - a).perp_dot(c - a).abs();
    let heights = [(b, c), (c, a), (a, b)].map(|(p, q)| area / p.distance(q).max(1.0));
    let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let fainter = EDGE * (1.0 - edges * (lowest / CLEAR_HEIGHT).min(1.0));
    [0, 1, 2].map(|corner| {
        let mut distances = [fainter; 3];
        distances[corner] += heights[corner];
        let [x, y, z] = distances.map(|distance| distance as f32);
        vec3(x, y, z)
    })
}

/// The colour of a fragment, darker near an edge.
fn edged((color, distances): &Varying) -> Color4 {
    let nearest = distances.0.iter().copied().fold(f32::INFINITY, f32::min);
    let darkness = (1.0 - nearest / EDGE as f32).clamp(0.0, 1.0);
    let [r, g, b] = color
        .0
        .map(|channel| (255.0 * channel * (1.0 - darkness)) as u8);
    rgba(r, g, b, 255)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WHITE;

    const RED: Color = [255, 0, 0];
    const BLUE: Color = [0, 0, 255];

    fn square(solids: &mut Solids, z: f64, color: Color) {
        let at = |x: f64, y: f64| DVec3::new(x, y, z);
        let [a, b, c, d] = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
        solids.face([a, b, c], color, 0.0);
        solids.face([a, c, d], color, 0.0);
    }

    #[test]
    fn the_nearer_face_hides_the_other_and_a_mark_shines_through() {
        let camera = Camera::new(DVec3::ZERO, DVec3::Z, DVec3::Y, 2.0);
        let mut solids = Solids::default();
        square(&mut solids, 0.1, BLUE);
        square(&mut solids, 0.0, RED);
        let picture = render(&solids, &camera, 40, 40, WHITE);
        let [r, g, b] = picture.pixel(20, 20);
        assert!(r == 0 && g == 0 && b > 180, "{:?}", picture.pixel(20, 20));
        assert_eq!(picture.pixel(2, 2), WHITE);
        solids.begin_marks();
        square(&mut solids, -0.1, RED);
        let picture = render(&solids, &camera, 40, 40, WHITE);
        let [r, g, b] = picture.pixel(20, 20);
        assert!(r > 40 && g == 0 && b > r, "{:?}", picture.pixel(20, 20));
        solids.begin_signs();
        square(&mut solids, -0.2, RED);
        let picture = render(&solids, &camera, 40, 40, WHITE);
        let [r, g, b] = picture.pixel(20, 20);
        assert!(r > 180 && g == 0 && b == 0, "{:?}", picture.pixel(20, 20));
    }

    #[test]
    fn faces_beyond_the_picture_and_behind_the_eye_are_cut() {
        let camera = Camera::new(DVec3::ZERO, DVec3::Z, DVec3::Y, 0.01);
        let mut solids = Solids::default();
        square(&mut solids, 0.0, RED);
        solids.face([DVec3::X, DVec3::Y, DVec3::Z * 50.0], BLUE, 1.0);
        let picture = render(&solids, &camera, 31, 17, WHITE);
        let corners = [picture.pixel(0, 0), picture.pixel(30, 16)];
        assert!(
            corners
                .iter()
                .all(|[r, g, b]| *r > 180 && *g == 0 && *b == 0)
        );
    }
}
