//! Where the tool is nearest to the surface: the local minima of the distance of two meshes.
//!
//! A minimum lies between a corner and a face, edge or corner, or between two edges; and it is one only where no
//! neighbour of either feature is nearer (Johnson and Willemsen 2003). Others would be too strict: a tool sliding
//! over a plate would halve its way to every edge. Each pair of features is looked at once, by the two faces that
//! answer for them. Features within a plane are left out where the corners of the plane tell as much.

use super::neighbourhood::{MAX_PAIRS, Neighbourhood, SurfaceFace};
use super::projection::MAX_HALF_SPACES;
use super::shape::{FLAT, ToolShape};
use crate::contact::motion::Placement;
use crate::contact::query::Surface;
use geometry::closest_point_on_triangle;
use glam::{DMat3, DVec3};
use spm::{Handle, NONE};

/// Slope up to which what is around a corner may be nearer, where the corner is over the inside of a face: a turn of the
/// tool soon brings the corner down, and the plane of a face is never too strict.
const SLOPE: f64 = 0.05;
/// What a pair looked at costs, in pairs of nodes (measured).
const LOOK: u32 = 6;
/// What a pair passed costs, in pairs of nodes (measured).
pub(super) const PASSED: u32 = 2;
/// Faces around a corner at the most; beyond, only those met first are asked.
const MAX_AROUND: usize = 128;

/// A place where tool and surface are near.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolContact {
    /// The face of the surface.
    pub face: Handle,
    /// The point on it, model units.
    pub point: DVec3,
    /// Unit direction from there to the tool.
    pub normal: DVec3,
    /// How far the tool is from there, model units.
    pub gap: f64,
    /// The tool's point, from the tool's centre, model units.
    pub arm: DVec3,
}

impl ToolContact {
    /// None: what an output is filled with.
    pub const NONE: Self = Self {
        face: NONE,
        point: DVec3::ZERO,
        normal: DVec3::ZERO,
        gap: 0.0,
        arm: DVec3::ZERO,
    };

    /// Between a point of the surface and one of the tool, along the unit direction from the one to the other.
    pub(super) fn between(
        face: Handle,
        [point, tool]: [DVec3; 2],
        normal: DVec3,
        centre: DVec3,
    ) -> Self {
        Self {
            face,
            point,
            normal,
            gap: normal.dot(tool - point),
            arm: tool - centre,
        }
    }
}

/// The contacts of one placement.
#[derive(Debug, Clone)]
pub struct Contacts {
    all: Vec<ToolContact>,
    /// Pairs that were looked at for them.
    is_looked: Vec<bool>,
    /// Where the tool is for them.
    at: Placement,
    dropped: u32,
    high_water: usize,
}

/// Whether a corner is nearest among what is around it.
#[derive(Clone, Copy, PartialEq)]
enum Corner {
    /// Something beside it is nearer.
    Beaten,
    /// Everything around it is as near.
    Flat,
    Nearest,
}

/// Judges a corner by the ways from it to what is around it, seen along the direction in which the other body lies;
/// what is nearer by no more than a slope does not beat it.
fn judge(displacements: impl Iterator<Item = DVec3>, towards: DVec3, slope: f64) -> Corner {
    let mut flat = true;
    for displacement in displacements {
        let (along, length) = (towards.dot(displacement), displacement.length());
        if along > slope * length {
            return Corner::Beaten;
        }
        flat &= along.abs() <= FLAT * length;
    }
    if flat { Corner::Flat } else { Corner::Nearest }
}

impl Contacts {
    /// None.
    pub fn new() -> Self {
        Self {
            all: Vec::with_capacity(MAX_HALF_SPACES),
            is_looked: vec![false; MAX_PAIRS],
            at: Placement::NOWHERE,
            dropped: 0,
            high_water: 0,
        }
    }

    /// None are left.
    pub fn clear(&mut self) {
        self.all.clear();
    }

    /// Takes them along to where the tool is now, as if it had touched the planes through their points.
    pub fn carry(&mut self, at: &Placement) {
        let turn = at.rotation() * self.at.rotation().transpose();
        for contact in &mut self.all {
            contact.arm = turn * contact.arm;
            let tool = at.centre + contact.arm;
            contact.gap = contact.normal.dot(tool - contact.point);
        }
        self.at = *at;
    }

    /// The contacts.
    pub fn all(&self) -> &[ToolContact] {
        &self.all
    }

    /// Contacts that did not fit beside nearer ones.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// The most that there ever were.
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Adds one; when full, the one with the most room makes place.
    pub fn add(&mut self, contact: ToolContact) {
        if self.all.len() < MAX_HALF_SPACES {
            self.all.push(contact);
            self.high_water = self.high_water.max(self.all.len());
            return;
        }
        self.dropped += 1;
        let farthest =
            (0..self.all.len()).max_by(|&a, &b| self.all[a].gap.total_cmp(&self.all[b].gap));
        if let Some(farthest) = farthest
            && self.all[farthest].gap > contact.gap
        {
            self.all[farthest] = contact;
        }
    }

    /// Local minima below `limit`, of the tool where the neighbourhood was placed: of the faces that are within `near_by`
    /// there, or where the motion to the ends that were placed leads; anew, or those that were not looked at for another
    /// motion from the same place. Returns what it cost, in pairs of nodes, and whether it is all that there is: it ends
    /// when `most` is spent.
    pub fn collect(
        &mut self,
        near: &mut Neighbourhood,
        shape: &ToolShape,
        surface: Surface<'_>,
        (at, anew): (&Placement, bool),
        [near_by, limit]: [f64; 2],
        most: u32,
    ) -> (u32, bool) {
        if anew {
            self.all.clear();
            self.at = *at;
            self.dropped = 0;
            self.is_looked[..near.pairs.len()].fill(false);
        }
        let (centre, rotation) = (at.centre, at.rotation());
        let mut spent = PASSED * near.pairs.len() as u32;
        let back = rotation.transpose();
        for k in 0..near.pairs.len() {
            if self.is_looked[k] || near.is_known_beyond(k, limit) {
                continue;
            }
            let pair = near.pairs[k];
            let corners = near.corners(shape, pair.tool);
            let now = near.apart_now(&pair, corners);
            if now > limit {
                near.saw(k, now);
                continue;
            }
            if now > near_by && near.apart_then(&pair, near.end_corners(shape, pair.tool)) > near_by
            {
                continue;
            }
            self.is_looked[k] = true;
            spent += LOOK;
            if spent > most {
                return (spent, false);
            }
            let mut look = PairLook {
                shape,
                surface,
                rotation,
                back,
                tool: pair.tool,
                corners,
                face: &near.faces[pair.surface as usize],
                limit,
            };
            let face = look.face.face;
            let mut found = |points: [DVec3; 2], normal: DVec3| {
                self.add(ToolContact::between(face, points, normal, centre));
            };
            look.tool_corners(&mut found);
            look.surface_corners(&mut found);
            look.edges(&mut found);
        }
        (spent, true)
    }
}

/// Two faces and what decides about their features.
struct PairLook<'a> {
    shape: &'a ToolShape,
    surface: Surface<'a>,
    /// From the tool's axes to the model's, and back.
    rotation: DMat3,
    back: DMat3,
    tool: u32,
    corners: [DVec3; 3],
    face: &'a SurfaceFace,
    limit: f64,
}

impl PairLook<'_> {
    /// Corners of the tool against the face, its edges and corners.
    fn tool_corners(&mut self, found: &mut impl FnMut([DVec3; 2], DVec3)) {
        let tool = &self.shape.faces[self.tool as usize];
        for k in 0..3 {
            let corner = self.corners[k];
            let height = self.face.normal.dot(corner - self.face.corners[0]);
            if !tool.owns[k] || height.abs() > self.limit {
                continue;
            }
            let closest = closest_point_on_triangle(self.face.corners, corner);
            if closest.distance_squared > self.limit * self.limit {
                continue;
            }
            let inside = closest.weights.iter().all(|&w| w > 0.0);
            let at_corner = closest.weights.iter().filter(|&&w| w > 0.0).count() == 1;
            // Over the inside the normal is good however near they are.
            let towards = if inside {
                self.face.normal * height.signum()
            } else {
                (corner - closest.point) / closest.distance_squared.sqrt()
            };
            let nearest = match closest.weights.map(|w| w > 0.0) {
                [true, true, true] => true,
                [false, true, true] => self.edge_is_nearest(0, towards),
                [true, false, true] => self.edge_is_nearest(1, towards),
                [true, true, false] => self.edge_is_nearest(2, towards),
                [true, ..] => self.corner_is_nearest(0, towards),
                [_, true, _] => self.corner_is_nearest(1, towards),
                _ => self.corner_is_nearest(2, towards),
            };
            if !(nearest && towards.is_finite()) {
                continue;
            }
            let slope = if inside { SLOPE } else { FLAT };
            let judged = self.judge_tool_corner(tool.vertices[k], towards, slope);
            if judged == Corner::Nearest || (judged == Corner::Flat && at_corner) {
                found([closest.point, corner], towards);
            }
        }
    }

    /// Corners of the surface against the tool's face and its edges.
    fn surface_corners(&mut self, found: &mut impl FnMut([DVec3; 2], DVec3)) {
        if self.face.owns == [false; 3] {
            return;
        }
        let normal = self.rotation * self.shape.faces[self.tool as usize].normal;
        for k in 0..3 {
            let corner = self.face.corners[k];
            let height = normal.dot(corner - self.corners[0]);
            if !self.face.owns[k] || height.abs() > self.limit {
                continue;
            }
            let closest = closest_point_on_triangle(self.corners, corner);
            if closest.distance_squared > self.limit * self.limit {
                continue;
            }
            let inside = closest.weights.iter().all(|&w| w > 0.0);
            let towards = if inside {
                normal * -height.signum()
            } else {
                (closest.point - corner) / closest.distance_squared.sqrt()
            };
            let nearest = match closest.weights.map(|w| w > 0.0) {
                [true, true, true] => true,
                [false, true, true] => self.tool_edge_is_nearest(0, towards),
                [true, false, true] => self.tool_edge_is_nearest(1, towards),
                [true, true, false] => self.tool_edge_is_nearest(2, towards),
                // Two corners were met with the tool's.
                _ => false,
            };
            if !(nearest && towards.is_finite()) {
                continue;
            }
            let slope = if inside { SLOPE } else { FLAT };
            if self.judge_surface_corner(k, towards, slope) == Corner::Nearest {
                found([corner, closest.point], towards);
            }
        }
    }

    /// Inner points of two edges.
    fn edges(&mut self, found: &mut impl FnMut([DVec3; 2], DVec3)) {
        let tool = &self.shape.faces[self.tool as usize];
        for k in 0..3 {
            if !tool.edges[k].is_asked {
                continue;
            }
            let edge = [self.corners[(k + 1) % 3], self.corners[(k + 2) % 3]];
            for l in 0..3 {
                if !self.face.asks_edge[l] {
                    continue;
                }
                let other = [
                    self.face.corners[(l + 1) % 3],
                    self.face.corners[(l + 2) % 3],
                ];
                let Some((points, across)) = inner_points(other, edge, self.limit) else {
                    continue;
                };
                let [on_surface, on_tool] = points;
                let displacement = on_tool - on_surface;
                if displacement.length_squared() > self.limit * self.limit {
                    continue;
                }
                let towards = across * across.dot(displacement).signum();
                let is_nearest = |beyond: DVec3| {
                    let displacement = beyond - on_surface;
                    towards.dot(displacement) <= FLAT * displacement.length()
                };
                if is_nearest(self.face.corners[l])
                    && is_nearest(self.face.beyond[l])
                    && self.tool_edge_is_nearest(k, towards)
                {
                    found(points, towards);
                }
            }
        }
    }

    /// Whether the neighbours at an edge of the surface's face are no nearer, and this face answers for it.
    fn edge_is_nearest(&self, edge: usize, towards: DVec3) -> bool {
        let start = self.face.corners[(edge + 1) % 3];
        let is_no_nearer = |beyond: DVec3| {
            let displacement = beyond - start;
            towards.dot(displacement) <= FLAT * displacement.length()
        };
        self.face.owns_edge[edge]
            && is_no_nearer(self.face.corners[edge])
            && is_no_nearer(self.face.beyond[edge])
    }

    /// Whether nothing around a corner of the surface's face is nearer, and this face answers for it.
    fn corner_is_nearest(&self, corner: usize, towards: DVec3) -> bool {
        self.face.owns[corner] && self.judge_surface_corner(corner, towards, FLAT) != Corner::Beaten
    }

    fn judge_surface_corner(&self, corner: usize, towards: DVec3, slope: f64) -> Corner {
        let (mesh, vertex) = (self.surface.mesh, self.face.vertices[corner]);
        let at = self.face.corners[corner];
        let mut flat = true;
        // Once round, or to a rim and then the other way from the start.
        for side in [1, 2] {
            let (mut face, mut index) = (self.face.face, corner);
            for _ in 0..MAX_AROUND {
                let corners = mesh.corners(face);
                let displacements = [1, 2].map(|k| corners[(index + k) % 3] - at);
                match judge(displacements.into_iter(), towards, slope) {
                    Corner::Beaten => return Corner::Beaten,
                    judged => flat &= judged == Corner::Flat,
                }
                let next = mesh.face(face).neighbours[(index + side) % 3];
                if next == NONE {
                    break;
                }
                let Some(there) = mesh.face(next).corners.iter().position(|&v| v == vertex) else {
                    break;
                };
                if next == self.face.face {
                    return if flat { Corner::Flat } else { Corner::Nearest };
                }
                (face, index) = (next, there);
            }
        }
        // A rim ends its plane: the corner may be the plane's own.
        Corner::Nearest
    }

    fn judge_tool_corner(&self, vertex: u32, towards: DVec3, slope: f64) -> Corner {
        let at = self.shape.points[vertex as usize];
        let around = self.shape.around(vertex).iter();
        judge(
            around.map(|&v| self.shape.points[v as usize] - at),
            self.back * -towards,
            slope,
        )
    }

    /// Whether the neighbours at an edge of the tool's face are no nearer, and this face answers for it.
    fn tool_edge_is_nearest(&self, edge: usize, towards: DVec3) -> bool {
        let tool = &self.shape.faces[self.tool as usize];
        if !tool.edges[edge].is_owned {
            return false;
        }
        let [start, own] =
            [(edge + 1) % 3, edge].map(|k| self.shape.points[tool.vertices[k] as usize]);
        let down = self.back * -towards;
        let is_no_nearer = |beyond: DVec3| {
            let displacement = beyond - start;
            down.dot(displacement) <= FLAT * displacement.length()
        };
        let beyond = tool.edges[edge].beyond;
        is_no_nearer(own) && (beyond == NONE || is_no_nearer(self.shape.points[beyond as usize]))
    }
}

/// Where the lines of two edges come closest, if that is within both and the lines are no farther apart than a limit, and the
/// unit normal of both.
fn inner_points(p: [DVec3; 2], q: [DVec3; 2], limit: f64) -> Option<([DVec3; 2], DVec3)> {
    let (u, v, between) = (p[1] - p[0], q[1] - q[0], q[0] - p[0]);
    let normal = u.cross(v);
    let square = normal.length_squared();
    let apart = between.dot(normal);
    if apart * apart > limit * limit * square {
        return None;
    }
    let (s, t) = (between.cross(v).dot(normal), between.cross(u).dot(normal));
    let within = square > 0.0 && s > 0.0 && s < square && t > 0.0 && t < square;
    let points = || [p[0] + u * (s / square), q[0] + v * (t / square)];
    within.then(|| (points(), normal / square.sqrt()))
}
