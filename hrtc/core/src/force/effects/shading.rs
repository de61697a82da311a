//! Force shading: a smooth force direction over edges (Morgenbesser 1996), which hides the facets
//! of a mesh.
//!
//! The direction is a weighted mean of the normals of the faces within the radius r. The weight of
//! a face is the product of three terms, each continuous in the place of the proxy:
//!
//! - its area, at most that of the disc of radius r;
//! - `(1 - a² / r²)²`, with a the distance from the contact aside;
//! - the cosine between its normal and the direction to the proxy.
//!
//! A second round takes out the faces that turn from the mean by `max_turn / 2` or more, so sharper
//! edges stay sharp. All lengths are those of the object, so the result hardly depends on the level
//! of detail. Where more faces are within r than the limit of a tick, r is as large as the nearest
//! of them reach, so that the weights are continuous there too; it is counted.
//!
//! Each contact of a tool is shaded by itself, with its own force, and leaves the others' forces. A
//! tool has no middle to see the faces from, and its contact point lies in them. A ball of radius r
//! that rests there takes its place. The force of a tool turns by at most `max_turn`.
//!
//! A proxy deep below a ridge passes it in a few ticks, that of a tool in one. The direction
//! therefore turns by at most `max_turn` over a displacement r of the probe.

use super::contact_set::{Acting, MAX_CONTACTS};
use super::nearest_faces::{FaceNear, NearestFaces};
use super::{ContactSample, Rendered};
use crate::contact::query::{Work, faces_within_limited};
use crate::tuning::force::SHADING_VISITS;
use geometry::ClosestPoint;
use geometry::portable::{angle_between, cos, hypot, sin};
use glam::DVec3;
use mutants::{Mutant, is};
use scene::ShadingPlan;

/// Shading of one surface for one probe.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Shading {
    plan: ShadingPlan,
    /// Of each contact, by its slot: its direction in the last tick, unit vector in the object's
    /// axes; `None` before a contact.
    directions: [Option<DVec3>; MAX_CONTACTS],
    /// Largest number of faces at a contact.
    high_water: usize,
    /// Searches that found more faces than there is room for.
    cut: u64,
}

impl Shading {
    /// Shading before any contact.
    #[must_use]
    pub fn new(plan: ShadingPlan) -> Self {
        Self {
            plan,
            directions: [None; MAX_CONTACTS],
            high_water: 0,
            cut: 0,
        }
    }

    /// Ends the contact.
    pub fn reset(&mut self) {
        self.directions = [None; MAX_CONTACTS];
    }

    /// Largest number of faces at a contact so far.
    #[must_use]
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Searches so far that found more faces than there is room for.
    #[must_use]
    pub fn cut(&self) -> u64 {
        self.cut
    }

    /// Turns the force of each contact; `amount` from 0 (not at all) to 1. The result is the work
    /// of the search.
    pub fn turn(
        &mut self,
        at: &ContactSample<'_>,
        contacts: &mut [Acting],
        amount: f64,
        out: &mut Rendered,
    ) -> Work {
        let mut work = Work::default();
        // All contacts together cost no more than a ball's.
        let searches = contacts.iter().filter(|of| of.is_pushing).count();
        for contact in contacts {
            let size = contact.force.length();
            if !(size > 0.0 && size.is_finite()) {
                continue;
            }
            let normal = contact.force / size;
            let last = self.directions[contact.slot].filter(|_| !contact.is_new);
            let shaded = if contact.is_pushing {
                let (found, cost) = self.smooth(at, contact, normal, searches);
                work.add(cost);
                self.limited(at, contact, normal, (last, found))
            } else {
                last.unwrap_or(normal)
            };
            self.directions[contact.slot] = Some(shaded);
            let shaded = normal.lerp(shaded, amount).normalize_or(normal);
            contact.add((shaded - normal) * size, out);
        }
        work
    }

    /// The smooth direction at a contact, and the work of the search.
    fn smooth(
        &mut self,
        at: &ContactSample<'_>,
        contact: &Acting,
        normal: DVec3,
        searches: usize,
    ) -> (Smooth, Work) {
        let radius = self.plan.radius_m / at.metres_per_unit;
        let disc = std::f64::consts::PI * radius * radius;
        let point = contact.point / at.metres_per_unit;
        let centre = at.middle.map_or(point + normal * radius, |middle| {
            middle / at.metres_per_unit
        });
        let off = centre.distance(point);
        let within = hypot(off, radius);
        let mut nearest = NearestFaces::new(within, searches);
        let most = at.max_work / searches.max(1) as u32;
        let most = most.min(SHADING_VISITS * nearest.room() as u32);
        let visit = |face, closest: ClosestPoint| {
            let [a, b, c] = at.surface.mesh.corners(face);
            let cross = (b - a).cross(c - a);
            let out = (centre - closest.point).normalize_or(normal);
            nearest.add(FaceNear {
                normal: cross.normalize_or_zero(),
                area: (0.5 * cross.length()).min(disc),
                // Negative for a proxy behind the face, which pushes against its own normal.
                faces: cross.normalize_or_zero().dot(out),
                distance_squared: closest.distance_squared,
            })
        };
        let limit = &mut most.into();
        let (unvisited, work) = faces_within_limited(at.surface, centre, within, limit, visit);
        let is_short = unvisited < within;
        self.high_water = self.high_water.max(nearest.all().len());
        self.cut += u64::from(nearest.is_cut() || is_short);
        let aside = |distance_squared: f64| (distance_squared - off * off).max(0.0);
        // How far aside all faces were seen.
        let seen = if nearest.is_cut() {
            nearest.farthest_squared().min(unvisited * unvisited)
        } else {
            unvisited * unvisited
        };
        let reached = aside(seen).min(radius * radius);
        let is_seen = reached > 0.0;
        let square = if is_seen { reached } else { radius * radius };
        let weighed = || {
            nearest.all().iter().map(|face| {
                let near = (1.0 - aside(face.distance_squared) / square).max(0.0);
                face.normal * (face.area * near * near * face.faces)
            })
        };
        let mean: DVec3 = weighed().sum();
        let mean = mean.normalize_or(normal);
        let sharp = cos(0.5 * self.plan.max_turn);
        let kept: DVec3 = weighed()
            .map(|face| {
                let alike = face.normalize_or_zero().dot(mean);
                face * ((alike - sharp) / (1.0 - sharp)).max(0.0)
            })
            .sum();
        let found = if is_short && (kept == DVec3::ZERO || !is_seen) {
            Smooth::Unknown
        } else if kept == DVec3::ZERO {
            Smooth::Sharp
        } else {
            Smooth::Towards(kept.normalize_or(normal))
        };
        (found, work)
    }

    /// The smooth direction within the limits of a tick and of a tool. At a sharp edge the force
    /// keeps its own direction; where there was no time to look, it turns there from that of the
    /// last tick.
    fn limited(
        &self,
        at: &ContactSample<'_>,
        contact: &Acting,
        normal: DVec3,
        (last, found): (Option<DVec3>, Smooth),
    ) -> DVec3 {
        let [elapsed, _] = at.periods;
        let seconds = elapsed as f64 * at.clock.period_s;
        let moved = at.velocity_at(contact.arm).length() * seconds / self.plan.radius_m;
        let shaded = match (last, found) {
            (Some(last), Smooth::Towards(smooth)) => {
                turned_to(last, smooth, moved * self.plan.max_turn)
            }
            (None, Smooth::Towards(smooth)) => smooth,
            (Some(last), Smooth::Unknown) => turned_to(last, normal, moved * self.plan.max_turn),
            (None, Smooth::Unknown) | (_, Smooth::Sharp) => normal,
        };
        match at.middle {
            Some(_) => shaded,
            None => turned_to(normal, shaded, self.plan.max_turn),
        }
    }
}

/// What the faces around a contact say of its direction.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Smooth {
    /// A unit vector.
    Towards(DVec3),
    /// They are not alike: a sharp edge.
    Sharp,
    /// The work did not suffice to look at them.
    Unknown,
}

/// A unit vector, turned towards another by at most an angle, radians.
fn turned_to(from: DVec3, to: DVec3, most: f64) -> DVec3 {
    let angle = angle_between(from, to);
    if angle <= most || is(Mutant::Shading) {
        return to;
    }
    let aside = (to - from * from.dot(to)).normalize_or_zero();
    (from * cos(most) + aside * sin(most)).normalize_or(to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::query::Surface;
    use crate::force::effects::contact_set::ContactSet;
    use crate::force::effects::tests::Bench;
    use crate::force::passivity::CouplingSpring;
    use crate::tuning::force::MAX_SHADING_FACES;
    use ab_tree::{AbTree, leaf_key};
    use geometry::Wrench;
    use spm::{ActiveMesh, Certified, NONE};

    /// A roof of two faces, each tilted by a tenth of a radian.
    fn roof() -> (ActiveMesh, AbTree) {
        let mut mesh = ActiveMesh::new(4, 2, 0);
        let corners = [
            [0.0, -0.01, 0.0],
            [0.0, 0.01, 0.0],
            [-0.01, 0.0, -0.001],
            [0.01, 0.0, -0.001],
        ];
        for (vertex, corner) in (0u32..).zip(corners) {
            mesh.set_base_vertex(vertex, corner, Certified::EXACT);
        }
        let faces = [([0, 1, 2], [NONE, NONE, 1]), ([1, 0, 3], [NONE, NONE, 0])];
        let mut tree = AbTree::new(2);
        tree.preconstruct(2);
        for (face, (corners, neighbours)) in (0u32..).zip(faces) {
            mesh.set_base_face(face, corners, neighbours)
                .expect("the vertices are there");
            tree.insert(face, leaf_key(face, 2));
        }
        tree.refit(|face| mesh.face_box(face));
        (mesh, tree)
    }

    /// A ball that rests beside a ridge feels the same direction however little of the surface
    /// there is time to look at.
    #[test]
    fn the_direction_stays_where_there_is_no_time_to_look() {
        let (mesh, tree) = roof();
        let plan = ShadingPlan {
            radius_m: 2e-3,
            max_turn: 0.7,
        };
        let normal = DVec3::new(0.1, 0.0, 1.0).normalize();
        let point = DVec3::new(2e-4, 0.0, -2e-5);
        let mut bench = Bench::new(0.0);
        let mut felt = |shading: &mut Shading, contacts: &mut ContactSet, max_work, velocity| {
            bench.step();
            let sample = ContactSample {
                max_work,
                velocity,
                surface: Surface {
                    mesh: &mesh,
                    tree: &tree,
                },
                point,
                middle: Some(point + normal * 1e-3),
                ..bench.sample(&[])
            };
            let force = normal * 3.0;
            let passive = Wrench {
                force,
                ..Wrench::ZERO
            };
            let mut out = Rendered::new(passive, CouplingSpring::default());
            let mut acting = contacts.track(&sample, force);
            shading.turn(&sample, acting.all(), 1.0, &mut out);
            out.passive.force
        };
        let (mut shading, mut contacts) = (Shading::new(plan), ContactSet::default());
        let first = felt(&mut shading, &mut contacts, 1000, DVec3::ZERO);
        let turned = first.angle_between(normal);
        assert!(turned > 0.02, "the ridge turns it: {turned}");
        for max_work in (0..12).chain([1000]) {
            let then = felt(&mut shading, &mut contacts, max_work, DVec3::ZERO);
            assert!(first.distance(then) < 1e-12, "{max_work}: {first} {then}");
        }
        // One that moves on has the force's own direction by and by.
        let mut angle = turned;
        for tick in 0..100 {
            let now = felt(&mut shading, &mut contacts, 1, DVec3::X * 0.02);
            let next = now.angle_between(normal);
            assert!(
                next <= angle + 1e-12 && angle - next < 0.01,
                "{tick}: {angle} {next}"
            );
            angle = next;
        }
        assert!(angle < 1e-6, "{angle}");
    }

    /// A ring of faces about the origin, of which one stands up, far faces, and a face at the
    /// origin, the last one of the tree.
    fn ring_about_a_face() -> (ActiveMesh, AbTree) {
        const FACES: u32 = 4096;
        const IN_RING: u32 = FACES / 2;
        let mut mesh = ActiveMesh::new(3 * FACES, FACES, 0);
        let mut tree = AbTree::new(FACES);
        tree.preconstruct(FACES);
        for face in 0..FACES {
            let angle = std::f64::consts::TAU * f64::from(face) / f64::from(IN_RING);
            let at = |distance: f64, aside: f64, height: f64| {
                let angle = angle + aside;
                DVec3::new(distance * angle.cos(), distance * angle.sin(), height)
            };
            let height = if face == 0 { 2e-3 } else { 0.0 };
            let inner = if face % 16 == 0 { 0.9e-3 } else { 1e-3 };
            let corners = match face {
                _ if face < IN_RING => [
                    at(inner, 0.0, 0.0),
                    at(1.2e-3, -1e-3, height),
                    at(1.2e-3, 1e-3, 0.0),
                ],
                _ if face + 1 < FACES => [1.0, 1.1, 1.2].map(|x| DVec3::new(x, x * x, 0.0)),
                _ => [0.0, 2.0, 4.0].map(|turn| at(1e-4, turn, 0.0)),
            };
            for (k, corner) in (0..).zip(corners) {
                let corner = corner.as_vec3().to_array();
                mesh.set_base_vertex(3 * face + k, corner, Certified::EXACT);
            }
            let vertices = [0, 1, 2].map(|k| 3 * face + k);
            mesh.set_base_face(face, vertices, [NONE; 3])
                .expect("the vertices are there");
            tree.insert(face, leaf_key(face, FACES));
        }
        tree.refit(|face| mesh.face_box(face));
        (mesh, tree)
    }

    /// More faces than a search visits come before the face under the ball: without it they say
    /// nothing of the direction.
    #[test]
    fn a_search_that_ends_before_the_nearest_face_knows_no_direction() {
        let (mesh, tree) = ring_about_a_face();
        let mut shading = Shading::new(ShadingPlan {
            radius_m: 2e-3,
            max_turn: 0.7,
        });
        let bench = Bench::new(0.0);
        let sample = ContactSample {
            surface: Surface {
                mesh: &mesh,
                tree: &tree,
            },
            point: DVec3::ZERO,
            middle: Some(DVec3::Z * 1e-3),
            ..bench.sample(&[])
        };
        let mut acting = ContactSet::default().track(&sample, DVec3::Z);
        let contact = acting.all()[0];
        let (found, work) = shading.smooth(&sample, &contact, DVec3::Z, 1);
        assert_eq!(found, Smooth::Unknown, "{work:?}");
        assert!(work.nodes + work.faces <= SHADING_VISITS * MAX_SHADING_FACES as u32);
        assert_eq!(shading.cut(), 1, "it is counted");
    }
}
