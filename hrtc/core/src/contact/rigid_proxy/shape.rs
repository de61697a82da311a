//! The geometry of a tool's mesh about its centre: size, and the edges and corners that can be
//! nearest.

use crate::contact::tool::{Blocks, Tool};
use glam::DVec3;
use spm::{Handle, NONE};
use std::collections::BTreeMap;
use thiserror::Error;

/// Reason why a tool cannot be a probe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ToolProxyError {
    /// The tool has no length to measure by.
    #[error("the tool has no extent, or the scale is not a positive number")]
    NoExtent,
}

/// Slope along which a neighbour counts as no nearer: the rounding of f64, with a margin.
pub(super) const FLAT: f64 = 1e-9;
/// Rounding of a vertex to f32, as a share of its distance from the origin.
pub(super) const ROUNDED: f64 = 0.5 * f32::EPSILON as f64;

/// An edge of a face, opposite the corner of the same index.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct ToolEdge {
    /// The corner beyond it; [`NONE`] at a boundary.
    pub beyond: u32,
    /// Whether this face owns the edge and the edge is not within a plane.
    pub is_asked: bool,
    /// Whether this face owns the edge.
    pub is_owned: bool,
}

/// A face of the tool.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct ToolFace {
    pub vertices: [u32; 3],
    /// Unit normal in the tool's axes; zero without area.
    pub normal: DVec3,
    pub edges: [ToolEdge; 3],
    /// The corners that this face owns.
    pub owns: [bool; 3],
}

/// The mesh about its centre, in units of the model.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct ToolShape {
    /// Vertices about the centre.
    pub(super) points: Vec<DVec3>,
    pub(super) faces: Vec<ToolFace>,
    /// Neighbours of vertex v: `around[first[v]..first[v + 1]]`.
    first: Vec<u32>,
    around: Vec<u32>,
    /// Whether the rim of an open mesh turns at a vertex.
    is_boundary_corner: Vec<bool>,
    /// Boxes of the faces about the centre.
    pub(super) blocks: Blocks,
    /// The centre in the tool's own frame, units of the model.
    pub(super) centre: DVec3,
    /// The vertex of a face that is nearest to the centre.
    pub(super) anchor: u32,
    /// Distance of the farthest vertex from the centre.
    pub(super) radius: f64,
    /// Radius of gyration of its surface about the centre.
    pub(super) gyration: f64,
    /// Centre and radius of gyration in units of the tool.
    moments: (DVec3, f64),
}

impl ToolShape {
    /// The shape of a tool; `scale`: model units per unit of the tool.
    pub fn new(tool: &Tool, scale: f64) -> Self {
        let local: Vec<DVec3> = tool.local_vertices().iter().map(|&p| p * scale).collect();
        let triangles: Vec<[u32; 3]> = (0..tool.faces()).map(|f| tool.triangle(f)).collect();
        let own = tool.local_vertices();
        let moments = moments(own.len(), |k| own[k], || triangles.iter().copied());
        let (centre, gyration) = (moments.0 * scale, moments.1 * scale);
        let points: Vec<DVec3> = local.iter().map(|&p| p - centre).collect();
        let radius = points.iter().fold(0.0f64, |most, p| most.max(p.length()));

        let on_faces = triangles.iter().flatten().copied();
        let by_distance = |v: u32| points[v as usize].length_squared();
        let anchor = on_faces.min_by(|&u, &v| by_distance(u).total_cmp(&by_distance(v)));

        let sides = faces_at_edges(&triangles);
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); points.len()];
        for &[a, b] in sides.keys() {
            neighbours[a as usize].push(b);
            neighbours[b as usize].push(a);
        }
        let is_boundary_corner = boundary_corners(&points, &sides);
        let faces = (0u32..)
            .zip(&triangles)
            .map(|(face, &vertices)| {
                let edge = |k: usize| {
                    let (a, b) = (vertices[(k + 1) % 3], vertices[(k + 2) % 3]);
                    let about = &sides[&[a.min(b), a.max(b)]];
                    let other = about.iter().find(|&&(f, _)| f != face);
                    let beyond = other.map_or(NONE, |&(f, l)| triangles[f as usize][l]);
                    let is_owned = about[0].0 == face;
                    // With three faces at an edge, it is in no plane.
                    let flat = about.len() == 2
                        && beyond != NONE
                        && is_flat(vertices.map(|v| local[v as usize]), local[beyond as usize]);
                    ToolEdge {
                        beyond: if about.len() == 2 { beyond } else { NONE },
                        is_asked: is_owned && !flat,
                        is_owned,
                    }
                };
                let [a, b, c] = vertices.map(|v| points[v as usize]);
                ToolFace {
                    vertices,
                    normal: (b - a).cross(c - a).normalize_or_zero(),
                    edges: [edge(0), edge(1), edge(2)],
                    owns: tool.samples(face),
                }
            })
            .collect();
        let mut first = vec![0];
        let mut around = Vec::new();
        for of_vertex in neighbours {
            around.extend(of_vertex);
            first.push(around.len() as u32);
        }
        let mut blocks = Blocks::new(tool.order());
        blocks.refit(|face| triangles[face as usize].map(|v| points[v as usize]));
        Self {
            blocks,
            points,
            faces,
            first,
            around,
            is_boundary_corner,
            centre,
            anchor: anchor.unwrap_or(0),
            radius,
            gyration,
            moments,
        }
    }

    /// Rescales the tool.
    pub(super) fn rescale(&mut self, tool: &Tool, scale: f64) {
        let (centre, gyration) = (self.moments.0 * scale, self.moments.1 * scale);
        for (k, point) in self.points.iter_mut().enumerate() {
            *point = tool.local_vertices()[k] * scale - centre;
        }
        (self.centre, self.gyration) = (centre, gyration);
        self.radius = self.points.iter().fold(0.0, |most, p| p.length().max(most));
        let (faces, points) = (&self.faces, &self.points);
        self.blocks
            .refit(|face| faces[face as usize].vertices.map(|v| points[v as usize]));
    }

    /// Whether the rim of an open mesh turns at a vertex.
    pub(super) fn is_boundary_corner(&self, vertex: u32) -> bool {
        self.is_boundary_corner[vertex as usize]
    }

    /// Vertices that share an edge with a vertex.
    pub(super) fn around(&self, vertex: u32) -> &[u32] {
        let [from, to] = [vertex, vertex + 1].map(|v| self.first[v as usize] as usize);
        &self.around[from..to]
    }
}

/// The faces at each edge, by the edge's vertices, each with the corner opposite the edge.
type FacesAtEdges = BTreeMap<[u32; 2], Vec<(Handle, usize)>>;

fn faces_at_edges(triangles: &[[u32; 3]]) -> FacesAtEdges {
    let mut sides = FacesAtEdges::new();
    for (face, t) in (0u32..).zip(triangles) {
        for k in 0..3 {
            let (a, b) = (t[(k + 1) % 3], t[(k + 2) % 3]);
            let edge = [a.min(b), a.max(b)];
            sides.entry(edge).or_default().push((face, k));
        }
    }
    sides
}

/// Whether the rim of an open mesh turns at each of these vertices. Where it goes straight on, both
/// neighbours on it hold a tool that lies flat as well: gap and lever arm are the weighted means of
/// theirs.
fn boundary_corners(points: &[DVec3], sides: &FacesAtEdges) -> Vec<bool> {
    let mut boundary: Vec<Vec<u32>> = vec![Vec::new(); points.len()];
    for (&[a, b], _) in sides.iter().filter(|(_, faces)| faces.len() == 1) {
        boundary[a as usize].push(b);
        boundary[b as usize].push(a);
    }
    let turns = |(at, on_boundary): (&DVec3, &Vec<u32>)| match on_boundary[..] {
        [] => false,
        [a, b] => {
            let [u, w] = [a, b].map(|v| points[v as usize] - *at);
            !(u.dot(w) < 0.0 && u.cross(w).length() <= FLAT * u.length() * w.length())
        }
        // More than one rim, or its end.
        _ => true,
    };
    points.iter().zip(&boundary).map(turns).collect()
}

/// Whether a point is in the plane of a triangle, as far as vertices in f32 can tell: its height is
/// no more than their rounding. A triangle without area is in every plane.
pub(super) fn is_flat([a, b, c]: [DVec3; 3], beyond: DVec3) -> bool {
    let normal = (b - a).cross(c - a);
    // The height changes with the point as it is, with each corner by its weight at the foot.
    let weight = |p: DVec3, q: DVec3| normal.dot((p - beyond).cross(q - beyond)).abs();
    let weights = normal.length_squared() + weight(a, b) + weight(b, c) + weight(c, a);
    let farthest = [a, b, c, beyond].map(DVec3::length);
    let rounded = ROUNDED * farthest.into_iter().fold(0.0, f64::max);
    normal.dot(beyond - a).abs() * normal.length() <= rounded * weights
}

/// Centre and radius of gyration of the surface, or of the vertices if there is no area.
fn moments<T: Iterator<Item = [u32; 3]>>(
    count: usize,
    point: impl Fn(usize) -> DVec3,
    triangles: impl Fn() -> T,
) -> (DVec3, f64) {
    let corners = |t: [u32; 3]| t.map(|v| point(v as usize));
    let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
    let whole: f64 = triangles().map(|t| area(corners(t))).sum();
    if whole > 0.0 {
        let weighted = |t| corners(t).iter().sum::<DVec3>() / 3.0 * area(corners(t));
        let centre = triangles().map(weighted).sum::<DVec3>() / whole;
        // Midpoints of edges integrate a square over a triangle exactly.
        let square = |t| {
            let [a, b, c] = corners(t).map(|p| p - centre);
            let sum =
                (a + b).length_squared() + (b + c).length_squared() + (c + a).length_squared();
            area([a, b, c]) * sum / 12.0
        };
        let square = triangles().map(square).sum::<f64>() / whole;
        return (centre, square.sqrt());
    }
    let points = || (0..count).map(&point);
    let centre = points().sum::<DVec3>() / count as f64;
    let square: f64 = points().map(|p| p.distance_squared(centre)).sum();
    (centre, (square / count as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    /// A sheet of two by two squares, and a round one of many sides: of the first the four corners,
    /// of the second all.
    #[test]
    fn the_corners_of_a_rim_are_where_it_turns() {
        const SIDES: u32 = 2000;
        let place = |k: u32| DVec3::new(f64::from(k % 3), f64::from(k / 3), 0.0) * 0.1;
        let points: Vec<DVec3> = (0..9).map(place).collect();
        let squares = [0u32, 1, 3, 4].map(|a| [[a, a + 1, a + 4], [a, a + 4, a + 3]]);
        let corners = boundary_corners(&points, &faces_at_edges(&squares.concat()));
        let expected = [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|k| [0, 2, 6, 8].contains(&k));
        assert_eq!(corners, expected);
        let angle = |k: u32| std::f64::consts::TAU * f64::from(k) / f64::from(SIDES);
        let mut points: Vec<DVec3> = (0..SIDES)
            .map(|k| DQuat::from_rotation_z(angle(k)) * DVec3::X)
            .collect();
        points.push(DVec3::ZERO);
        let fan: Vec<[u32; 3]> = (0..SIDES).map(|k| [k, (k + 1) % SIDES, SIDES]).collect();
        let corners = boundary_corners(&points, &faces_at_edges(&fan));
        assert_eq!(corners.iter().filter(|&&of| of).count(), SIDES as usize);
        assert!(!corners[SIDES as usize], "the middle is within");
    }

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        /// Four points of a plane, anywhere, in any direction and at any scale, in f32.
        #[test]
        fn a_plane_is_flat_in_f32_and_a_bend_is_not(
            corners in prop::array::uniform4(prop::array::uniform2(-1.0..1.0f64)),
            axis in vector(), place in vector(), exponent in -4..5i32,
        ) {
            let turn = DQuat::from_scaled_axis(3.0 * axis);
            let scale = 10f64.powi(exponent);
            let at = |[x, y]: [f64; 2], z: f64| {
                let point = scale * (place + turn * DVec3::new(x, y, z));
                point.as_vec3().as_dvec3()
            };
            let [a, b, c, beyond] = corners.map(|corner| at(corner, 0.0));
            prop_assert!(is_flat([a, b, c], beyond));
            // A bend beyond the rounding of both: the height that it takes, and as much again.
            let normal = turn * DVec3::Z;
            let area = (b - a).cross(c - a).length();
            let weight = |p: DVec3, q: DVec3| (p - beyond).cross(q - beyond).length() / area;
            let weights = 1.0 + weight(a, b) + weight(b, c) + weight(c, a);
            let farthest = [a, b, c, beyond].map(DVec3::length).into_iter().fold(0.0, f64::max);
            prop_assume!(area > 1e-3 * scale * scale);
            let height = 4.0 * ROUNDED * farthest * weights;
            prop_assert!(!is_flat([a, b, c], beyond + normal * height));
        }
    }
}
