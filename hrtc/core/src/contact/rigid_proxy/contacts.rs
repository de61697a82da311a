//! Contacts: the local minima of the distance between tool and surface.
//!
//! A minimum lies between a corner and a face, edge or corner, or between two edges, and no
//! neighbour of either feature is nearer (Johnson & Willemsen 2003). Other pairs would constrain
//! too much: a tool sliding over a plate would halve its motion at every edge. The two faces that
//! own a pair of features examine it once; one within a plane is skipped if its corners suffice.

use super::neighbourhood::{MAX_AROUND, MAX_PAIRS, Neighbourhood, PLACED, SurfaceFace};
use super::projection::MAX_HALF_SPACES;
use super::shape::{FLAT, ROUNDED, ToolShape};
use crate::contact::motion::{Placement, Twist};
use crate::contact::query::Surface;
use geometry::closest_point_on_triangle;
use geometry::portable::rotation;
use glam::{DMat3, DVec3};
use spm::{Handle, NONE};

/// Slope by which the neighbours of a corner over the inside of a face may be nearer: a rotation of
/// the tool soon lowers the corner, and the plane of a face never constrains too much.
const SLOPE: f64 = 0.05;
/// Cost of a pair examined, in node pairs (measured).
pub(super) const LOOK: u32 = 5;
/// Cost of a pair whose separation is computed, in node pairs (measured).
pub(super) const PASSED: u32 = 1;
/// Share of the contact offset that the arcs of a step leave: midway between where contacts act and
/// where the sweep stops.
const ARC_FLOOR: f64 = 0.75;
/// Rotation up to which arcs deviate from straight lines by the square of it, radians: the next
/// term of the series is a third of the rotation times that, a twelfth here.
const QUADRATIC_TURN: f64 = 0.25;

/// A contact of tool and surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ToolContact {
    /// The face of the surface.
    pub face: Handle,
    /// Its certified error when it was found near, model units: the full mesh is as it was, so it
    /// holds when the face is gone, too.
    pub certified: f32,
    /// Its point of contact, model units.
    pub point: DVec3,
    /// Unit direction from there to the tool.
    pub normal: DVec3,
    /// Distance along it, model units.
    pub gap: f64,
    /// The tool's point of contact, from the tool's centre, model units.
    pub arm: DVec3,
    /// Its multiplier in the projection, model units; 0 where it does not push. The force of the
    /// contact along its normal is the stiffness of the coupling times it, as far as the tick
    /// reached the placement that the contacts allow.
    pub multiplier: f64,
}

impl ToolContact {
    /// No contact: the content of an unused output.
    pub const NONE: Self = Self {
        face: NONE,
        certified: f32::INFINITY,
        point: DVec3::ZERO,
        normal: DVec3::ZERO,
        gap: 0.0,
        arm: DVec3::ZERO,
        multiplier: 0.0,
    };

    /// Between a point of the surface and one of the tool; `normal` is the unit direction from the
    /// first to the second.
    pub(super) fn between(
        face: &SurfaceFace,
        [point, tool]: [DVec3; 2],
        normal: DVec3,
        centre: DVec3,
    ) -> Self {
        Self {
            face: face.face,
            certified: face.certified,
            point,
            normal,
            gap: normal.dot(tool - point),
            arm: tool - centre,
            multiplier: 0.0,
        }
    }
}

/// The contacts of one placement.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Contacts {
    all: Vec<ToolContact>,
    /// Pairs examined.
    is_looked: Vec<bool>,
    /// The placement.
    at: Placement,
    dropped: u32,
    /// The last search for contacts.
    search: Option<Search>,
    high_water: usize,
}

/// A search for contacts.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct Search {
    /// The placement of the tool and the pairs that it is for.
    at: Placement,
    pairs: u64,
    /// Distance below which it looks for contacts, model units.
    pub(super) limit: f64,
    /// Where the budget interrupted it: the first pair that was not looked at.
    pub(super) next: Option<usize>,
    /// How many contacts of the last complete search come before those that it found. They stay
    /// until it is complete: what a part of the pairs tells is no estimate of the force.
    earlier: usize,
}

/// Position of a corner relative to its neighbours.
#[derive(Clone, Copy, PartialEq)]
enum Corner {
    /// A neighbour is nearer.
    Beaten,
    /// All neighbours are equally near.
    Flat,
    Nearest,
}

/// Judges a corner by the vectors to its neighbours, along the direction to the other body. A
/// neighbour nearer by less than the slope does not count, nor does a height within `rounded`.
fn judge(
    displacements: impl Iterator<Item = DVec3>,
    towards: DVec3,
    [slope, rounded]: [f64; 2],
) -> Corner {
    let mut flat = true;
    for displacement in displacements {
        let (along, length) = (towards.dot(displacement), displacement.length());
        if along > slope * length {
            return Corner::Beaten;
        }
        flat &= along.abs() <= FLAT * length + rounded;
    }
    if flat { Corner::Flat } else { Corner::Nearest }
}

impl Contacts {
    /// No contacts.
    pub fn new() -> Self {
        Self {
            all: Vec::with_capacity(MAX_HALF_SPACES),
            is_looked: vec![false; MAX_PAIRS],
            at: Placement::NOWHERE,
            dropped: 0,
            search: None,
            high_water: 0,
        }
    }

    /// Removes all contacts.
    pub fn clear(&mut self) {
        self.search = None;
        self.all.clear();
    }

    /// Moves the contacts to a new placement of the tool, on the same planes.
    pub fn carry(&mut self, at: &Placement) {
        let turn = at.rotation() * self.at.rotation().transpose();
        for contact in &mut self.all {
            contact.arm = turn * contact.arm;
            let tool = at.centre + contact.arm;
            contact.gap = contact.normal.dot(tool - contact.point);
        }
        self.at = *at;
    }

    /// The placement of the tool that they are for.
    pub fn at(&self) -> &Placement {
        &self.at
    }

    /// The last search, if it was for this placement and the present pairs.
    pub(super) fn search_of(&self, near: &Neighbourhood, at: &Placement) -> Option<Search> {
        let is_of = |search: &Search| search.at == *at && search.pairs == near.generation();
        self.search.filter(is_of)
    }

    /// The contacts, while a search is unfinished with those of the one before.
    pub fn all(&self) -> &[ToolContact] {
        &self.all
    }

    /// Those that the last search found, and the stops since.
    pub fn found(&self) -> &[ToolContact] {
        &self.all[self.earlier().min(self.all.len())..]
    }

    /// How many contacts are of an earlier search.
    fn earlier(&self) -> usize {
        self.search.map_or(0, |search| search.earlier)
    }

    /// The share of a motion on which the arcs of the rotation, too, obey all contacts: these are
    /// obeyed along straight lines. Where an arc bends towards the surface, a contact may lose a
    /// quarter of the contact offset by it.
    ///
    /// After a share s of the motion, `gap + s gain - s^2 loss` is left of a gap, and must not be
    /// less than the floor or than there is now.
    pub fn share_of_arcs(&self, motion: &Twist, offset: f64) -> f64 {
        let turn = motion.angular.length();
        if turn == 0.0 {
            return 1.0;
        }
        let part = (QUADRATIC_TURN / turn).min(1.0);
        let rotation = DMat3::from_quat(rotation(motion.angular * part));
        let mut share = 1.0f64;
        for contact in &self.all {
            let (normal, arm) = (contact.normal, contact.arm);
            let straight = motion.angular.cross(arm);
            let arc = rotation * arm - arm;
            let loss = normal.dot(straight * part - arc) / (part * part);
            let gain = normal.dot(motion.linear + straight);
            let room = (contact.gap - ARC_FLOOR * offset).max(0.0);
            if room + share * (gain - share * loss) < 0.0 && loss > 0.0 {
                let root = (gain * gain + 4.0 * loss * room).sqrt();
                share = ((gain + root) / (2.0 * loss)).clamp(0.0, share);
            }
        }
        share
    }

    /// Contacts beyond the capacity.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Largest number of contacts so far.
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Adds a contact. If full, the farthest one of an earlier search gives its place, else of all.
    pub fn add(&mut self, contact: ToolContact) {
        let farthest = |of: &[ToolContact]| {
            let places = 0..of.len();
            places
                .max_by(|&a, &b| of[a].gap.total_cmp(&of[b].gap))
                .unwrap_or(0)
        };
        if self.all.len() < MAX_HALF_SPACES {
            self.all.push(contact);
        } else if let Some(search) = self.search.as_mut().filter(|search| search.earlier > 0) {
            let place = farthest(&self.all[..search.earlier]);
            search.earlier -= 1;
            self.all.swap(place, search.earlier);
            self.all[search.earlier] = contact;
        } else {
            self.dropped += 1;
            let place = farthest(&self.all);
            if self.all[place].gap > contact.gap {
                self.all[place] = contact;
            }
        }
        self.high_water = self.high_water.max(self.found().len());
    }

    /// The first pair to be looked at by a search. One where the last one was, for the same pairs
    /// and no farther, goes on with what that found, stops included, and where the budget
    /// interrupted that; any other begins with the contacts known so far, until it is complete.
    fn begin_or_go_on(&mut self, near: &Neighbourhood, at: &Placement, limit: f64) -> usize {
        let earlier = self.search_of(near, at);
        if let Some(earlier) = earlier.filter(|earlier| limit <= earlier.limit) {
            return earlier.next.unwrap_or(0);
        }
        // What an interrupted search found is known of some pairs only: where there are contacts of
        // a complete one, these stay instead.
        let unfinished = self.search.filter(|search| search.next.is_some());
        if let Some(search) = unfinished.filter(|search| search.earlier > 0) {
            self.all.truncate(search.earlier);
        }
        self.carry(at);
        self.dropped = 0;
        self.is_looked[..near.pairs.len()].fill(false);
        self.search = Some(Search {
            at: *at,
            pairs: near.generation(),
            limit,
            next: Some(0),
            earlier: self.all.len(),
        });
        0
    }

    /// Collects the local minima below `limit`, among faces within `near_by` at the tool's
    /// placement or at the end of its motion, as no pair with a gap beyond `clear` is. `anew`: for
    /// a new step; otherwise only pairs not examined yet, for another motion from the same
    /// placement. Returns the cost in node pairs, and false if `most` was spent before the end.
    pub fn collect(
        &mut self,
        near: &mut Neighbourhood,
        shape: &ToolShape,
        surface: Surface<'_>,
        (at, anew): (&Placement, bool),
        [near_by, limit, clear]: [f64; 3],
        most: u32,
    ) -> (u32, bool) {
        let first = if anew {
            self.begin_or_go_on(near, at, limit)
        } else {
            0
        };
        let (centre, rotation) = (at.centre, at.rotation());
        let mut spent = near.vertex_count() / PLACED;
        if spent > most {
            return (0, false);
        }
        let back = rotation.transpose();
        for k in first..near.pairs.len() {
            if self.is_looked[k] || near.is_beyond(k, clear) {
                continue;
            }
            if spent + PASSED + 2 * LOOK > most {
                if let Some(search) = self.search.as_mut().filter(|_| anew) {
                    search.next = Some(k);
                }
                return (spent, false);
            }
            let [may_be, is_new] = near.asks(surface.mesh, shape, k);
            spent += PASSED + LOOK * u32::from(is_new);
            if !may_be {
                continue;
            }
            let pair = near.pairs[k];
            let corners = near.corners(shape, pair.tool);
            let now = near.apart_now(&pair, corners);
            let is_far = || near.apart_then(&pair, near.end_corners(shape, pair.tool)) > near_by;
            if now > limit || (now > near_by && is_far()) {
                continue;
            }
            self.is_looked[k] = true;
            spent += LOOK;
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
            let face = look.face;
            let mut found = |points: [DVec3; 2], normal: DVec3| {
                self.add(ToolContact::between(face, points, normal, centre));
            };
            look.tool_corners(&mut found);
            look.surface_corners(&mut found);
            look.edges(&mut found);
        }
        if let Some(search) = &mut self.search {
            search.next = None;
            self.all.drain(..search.earlier.min(self.all.len()));
            search.earlier = 0;
        }
        (spent, true)
    }
}

/// Two faces, and the context that decides about their features.
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
            // Over the inside the normal is exact at any distance.
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
                // Pairs of corners belong to the tool's corners.
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

    /// Interior points of two edges.
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

    /// Whether this face owns an edge of the surface and no neighbour there is nearer.
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

    /// Whether this face owns a corner of the surface and nothing around it is nearer.
    fn corner_is_nearest(&self, corner: usize, towards: DVec3) -> bool {
        self.face.owns[corner] && self.judge_surface_corner(corner, towards, FLAT) != Corner::Beaten
    }

    fn judge_surface_corner(&self, corner: usize, towards: DVec3, slope: f64) -> Corner {
        let (mesh, vertex) = (self.surface.mesh, self.face.vertices[corner]);
        let at = self.face.corners[corner];
        let mut flat = true;
        // Once around, or to a boundary and then in the other direction from the start.
        for side in [1, 2] {
            let (mut face, mut index) = (self.face.face, corner);
            for _ in 0..MAX_AROUND {
                let corners = mesh.corners(face);
                let displacements = [1, 2].map(|k| corners[(index + k) % 3] - at);
                // Both ends of a displacement are vertices in f32.
                let squares = corners.map(DVec3::length_squared);
                let farthest = squares.into_iter().fold(0.0, f64::max).sqrt();
                let allowed = [slope, 2.0 * ROUNDED * farthest];
                match judge(displacements.into_iter(), towards, allowed) {
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
        // At a boundary the plane ends: the corner may be its own.
        Corner::Nearest
    }

    fn judge_tool_corner(&self, vertex: u32, towards: DVec3, slope: f64) -> Corner {
        let at = self.shape.points[vertex as usize];
        let around = self.shape.around(vertex).iter();
        let judged = judge(
            around.map(|&v| self.shape.points[v as usize] - at),
            self.back * -towards,
            [slope, 0.0],
        );
        match judged {
            // At the rim of a sheet the plane ends: its corners suffice.
            Corner::Flat if self.shape.is_boundary_corner(vertex) => Corner::Nearest,
            judged => judged,
        }
    }

    /// Whether this face owns an edge of the tool and no neighbour there is nearer.
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

/// The closest points of the lines of two edges, if they are inside both edges and at most `limit`
/// apart, and the unit normal of both lines.
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
