//! Collection of the candidate pairs, and their update where the surface changed.

use super::face_pair::{CandidateFace, MovingFace};
use super::{
    LookAheadTube, MAX_PAIRS, MAX_SURFACE_FACES, NearPair, Neighbourhood, PLACED, ToolShape,
};
use crate::contact::query::{Body, Ending, Limit, PairWork, Surface};
use crate::contact::tool::{RelativePath, Resume, for_each_face_near, for_each_near_pair};
use glam::DVec3;
use spm::{ActiveMesh, Handle, NONE};
use std::ops::ControlFlow;

/// Halvings of the margin at once if the neighbourhood is full.
const HALVINGS: usize = 6;

/// Cost of a face and of so many pairs whose list is gone through for an update, in node pairs
/// (measured with 380 faces and 1540 pairs: 35 us).
const KEPT_FACE: usize = 2;
const KEPT_PAIRS: usize = 3;

/// A collection that the budget interrupted.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct PartialCollection {
    pub(super) tube: LookAheadTube,
    /// Margin around the straight lines.
    margin: f64,
    resume: Resume,
}

/// What is known after an update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) enum Updated {
    /// All pairs; of these, so many before those of changed faces.
    All(usize),
    /// Those of an unfinished collection, which may go on.
    Unfinished,
    /// Not all pairs, for lack of room or budget, or since there were none before.
    Unknown,
}

impl Neighbourhood {
    /// Collects all pairs of a tube. If there are too many, the margin shrinks; if that does not
    /// suffice, nothing is known and the ending says so. If the limit of node pairs is reached, the
    /// next call for the same placement continues, with the same tube.
    pub fn collect(
        &mut self,
        surface: Surface<'_>,
        shape: &ToolShape,
        tube: LookAheadTube,
        limit: &mut Limit<'_>,
    ) -> (Ending, PairWork) {
        let PartialCollection {
            tube,
            mut margin,
            resume,
        } = self.begin_or_go_on(tube);
        let ends = tube.ends();
        let centres = ends.map(|at| at.centre);
        [self.rotation, self.end_rotation] = ends.map(|at| at.rotation());
        self.turned.begin(shape.faces.len());
        let mut candidate: Option<CandidateFace> = None;
        // In the tool's frame straight paths are bent.
        let path = RelativePath::new(centres, [self.rotation, self.end_rotation]);
        let bend = tube.bend_seen(tube.straight_margin());
        let (ending, work, resume) = for_each_near_pair(
            &surface,
            &shape.blocks,
            &path,
            margin + bend,
            resume,
            limit,
            |face, tool_face| {
                if self.pairs.len() == MAX_PAIRS || self.faces.len() == MAX_SURFACE_FACES {
                    // The lists are at their fullest, and the places of faces change.
                    self.note_high_water();
                    candidate = None;
                    if !self.make_room(&mut margin) {
                        return ControlFlow::Break(());
                    }
                }
                let candidate = match &mut candidate {
                    Some(candidate) if candidate.face == face => candidate,
                    other => other.insert(CandidateFace::of(surface.mesh, face)),
                };
                if let Some(gap) =
                    self.take(surface.mesh, shape, centres, candidate, tool_face, margin)
                {
                    self.gaps.push(gap);
                }
                ControlFlow::Continue(margin + bend)
            },
        );
        self.path = path;
        let partial = PartialCollection {
            tube,
            margin,
            resume,
        };
        self.finish_collection(ending, partial);
        (ending, work)
    }

    /// An unfinished collection goes on along a share of its path only, if that leaves a margin and
    /// costs no more than `most`. Returns the cost, in node pairs.
    pub fn shorten_collection(&mut self, shape: &ToolShape, share: f64, most: u32) -> u32 {
        let cost = self.vertex_count() / PLACED;
        let Some(partial) = self.partial.as_mut().filter(|_| share < 1.0) else {
            return 0;
        };
        let (tube, margin) = partial.tube.shortened(share, partial.margin);
        if cost > most || margin <= 0.0 {
            self.invalidate();
            return 0;
        }
        let lost = partial.margin - margin;
        self.gaps.iter_mut().for_each(|gap| *gap -= lost);
        (partial.tube, partial.margin) = (tube, margin);
        let ends = tube.ends();
        self.place_ends(shape, &ends[1]);
        self.path = RelativePath::new(ends.map(|at| at.centre), ends.map(|at| at.rotation()));
        cost
    }

    /// The unfinished collection if it began where the tube does, else a new one.
    fn begin_or_go_on(&mut self, tube: LookAheadTube) -> PartialCollection {
        let start = tube.ends()[0];
        let partial = self.partial.take();
        if let Some(partial) = partial.filter(|partial| partial.tube.ends()[0] == start) {
            return partial;
        }
        self.clear();
        PartialCollection {
            tube,
            margin: tube.straight_margin(),
            resume: Resume::START,
        }
    }

    /// Ends or interrupts a collection.
    fn finish_collection(&mut self, ending: Ending, partial: PartialCollection) {
        self.note_high_water();
        self.tube = LookAheadTube::nowhere();
        match ending {
            Ending::Complete => self.tube = partial.tube.narrowed(partial.margin),
            Ending::OutOfBudget { .. } => self.partial = Some(partial),
            Ending::Stopped { .. } => {}
        }
    }

    /// Halves the margin until a quarter of the room is free; false if that does not suffice. Each
    /// halving counts the pairs that would stay; they are moved once.
    fn make_room(&mut self, margin: &mut f64) -> bool {
        for _ in 0..HALVINGS {
            *margin *= 0.5;
            if self.has_room_within(*margin) {
                self.shrink(*margin);
                return true;
            }
        }
        false
    }

    /// Adds a face of the surface and one of the tool as a pair if they come within `margin` on the
    /// straight lines from start to end. Returns their separation.
    #[inline]
    fn take(
        &mut self,
        mesh: &ActiveMesh,
        shape: &ToolShape,
        centres: [DVec3; 2],
        candidate: &mut CandidateFace,
        tool_face: u32,
        margin: f64,
    ) -> Option<f64> {
        let own = &shape.faces[tool_face as usize];
        self.list(own.vertices, shape, centres);
        let moving = MovingFace {
            face: tool_face,
            corners: [&self.positions, &self.ends]
                .map(|places| own.vertices.map(|v| places[v as usize])),
            own: own.normal,
            rotation: self.rotation,
        };
        let (gap, along) = moving.best_apart(candidate, &mut self.turned, margin);
        if gap > margin {
            return None;
        }
        let place = candidate.place;
        let place = place.unwrap_or_else(|| self.face_place(mesh, candidate.face));
        candidate.place = Some(place);
        self.count_pair(self.pairs.len(), place);
        self.pairs.push(NearPair {
            tool: tool_face,
            surface: place,
            along,
        });
        Some(gap)
    }

    /// Updates the pairs after faces have changed or gone: the result is that of a new collection,
    /// or of an unfinished one that had come as far. Going through the list may not cost more than
    /// the first limit, and the pairs of changed faces no more than the second.
    pub fn update(
        &mut self,
        surface: Surface<'_>,
        shape: &ToolShape,
        changed: &[Handle],
        [most_of_list, most]: [u32; 2],
    ) -> (Updated, PairWork) {
        let mut work = PairWork::default();
        let (tube, margin, mut resume) = match self.partial {
            Some(partial) => (partial.tube, partial.margin, Some(partial.resume)),
            None if self.tube.left() > 0.0 => (self.tube, self.tube.straight_margin(), None),
            None => return (Updated::Unknown, work),
        };
        let of_list = self.list_cost();
        if of_list > most_of_list {
            return (Updated::Unknown, work);
        }
        let most = most + of_list;
        work.node_pairs += of_list;
        self.generation += 1;
        let mesh = surface.mesh;
        let within = margin + tube.bend_seen(margin);
        let ends = tube.ends();
        self.place(shape, &ends[0]);
        self.place_ends(shape, &ends[1]);
        self.turned.begin(shape.faces.len());
        let kept = self.drop_changed(mesh, changed);
        let path = self.path;
        if let Some(resume) = &mut resume {
            changed.iter().for_each(|&face| resume.begin_again(face));
        }
        let is_ahead = |face| resume.is_some_and(|at| !at.is_beyond(&surface, face));
        for &face in changed {
            if !surface.has(face) || self.face_places.find(face).is_some() || is_ahead(face) {
                continue;
            }
            let mut candidate = CandidateFace::of(mesh, face);
            let (corners, centres) = (candidate.corners, ends.map(|at| at.centre));
            let limits = [most.saturating_sub(work.cost()), PairWork::FACE_PAIR];
            let (mut visited, mut has_room) = (0, true);
            let take = |own| {
                visited += 1;
                has_room = self.pairs.len() < MAX_PAIRS && self.faces.len() < MAX_SURFACE_FACES;
                if has_room
                    && let Some(gap) = self.take(mesh, shape, centres, &mut candidate, own, margin)
                {
                    self.gaps.push(gap);
                }
                has_room
            };
            let (cost, is_all) =
                for_each_face_near(&shape.blocks, &path, corners, within, limits, take);
            work.faces += visited;
            work.node_pairs += cost - PairWork::FACE_PAIR * visited;
            if !(has_room && is_all) {
                return (Updated::Unknown, work);
            }
        }
        self.note_high_water();
        match (&mut self.partial, resume) {
            (Some(partial), Some(resume)) => {
                partial.resume = resume;
                (Updated::Unfinished, work)
            }
            _ => (Updated::All(kept), work),
        }
    }

    /// What it costs to go through the list, in node pairs.
    fn list_cost(&self) -> u32 {
        let listed = KEPT_FACE * self.faces.len() + self.pairs.len() / KEPT_PAIRS;
        listed as u32 + 2 * self.vertex_count() / PLACED
    }

    /// Drops the pairs of faces that have changed or are gone. Returns how many are left.
    fn drop_changed(&mut self, mesh: &ActiveMesh, changed: &[Handle]) -> usize {
        // A face may be listed more than once.
        for &face in changed {
            if let Some(place) = self.face_places.find(face) {
                self.faces[place as usize].face = NONE;
            }
        }
        let mut kept = 0;
        for k in 0..self.pairs.len() {
            let face = self.faces[self.pairs[k].surface as usize].face;
            if face != NONE && mesh.is_active(face) {
                self.keep(k, kept);
                kept += 1;
            }
        }
        self.keep_first(kept);
        for face in &mut self.faces {
            face.look_around(mesh);
        }
        kept
    }

    /// Places vertices of the tool that are not listed yet at start and end of the path.
    #[inline]
    fn list(&mut self, vertices: [u32; 3], shape: &ToolShape, centres: [DVec3; 2]) {
        for v in vertices.map(|v| v as usize) {
            if !self.is_listed[v] {
                self.is_listed[v] = true;
                self.vertices.push(v as u32);
                self.positions[v] = centres[0] + self.rotation * shape.points[v];
                self.ends[v] = centres[1] + self.end_rotation * shape.points[v];
            }
        }
    }

    /// Whether the pairs that may be within a margin, and their faces, leave a quarter of the room.
    fn has_room_within(&self, margin: f64) -> bool {
        let (mut pairs, mut faces, mut last) = (0, 0, NONE);
        for (pair, &gap) in self.pairs.iter().zip(&self.gaps) {
            if gap <= margin {
                pairs += 1;
                faces += usize::from(pair.surface != last);
                last = pair.surface;
            }
        }
        4 * pairs <= 3 * MAX_PAIRS && 4 * faces <= 3 * MAX_SURFACE_FACES
    }

    /// Keeps only pairs that may be within a margin, and their faces.
    fn shrink(&mut self, margin: f64) {
        let mut kept = 0;
        for k in 0..self.pairs.len() {
            if self.gaps[k] <= margin {
                self.keep(k, kept);
                kept += 1;
            }
        }
        self.keep_first(kept);
    }

    /// Puts a pair that is kept into its place, with the handle of its face until the faces are
    /// indexed anew.
    fn keep(&mut self, pair: usize, place: usize) {
        let kept = self.pairs[pair];
        let surface = self.faces[kept.surface as usize].face;
        self.pairs[place] = NearPair { surface, ..kept };
        self.gaps[place] = self.gaps[pair];
    }

    /// Keeps the first pairs, which hold handles, and their faces, which are indexed anew.
    fn keep_first(&mut self, kept: usize) {
        self.gaps.truncate(kept);
        self.pairs.truncate(kept);
        // The pairs of a face may lie apart: which faces stay is known after all of them.
        for face in &mut self.faces {
            face.pairs = 0;
        }
        for pair in &self.pairs {
            // These are the places before.
            if let Some(place) = self.face_places.find(pair.surface) {
                self.faces[place as usize].pairs = 1;
            }
        }
        self.face_places.clear();
        self.vertex_places.clear();
        let mut count = 0;
        for from in 0..self.faces.len() {
            let face = self.faces[from];
            if face.pairs > 0 {
                self.face_places.find_or_add(face.face, count);
                let owns = self.owns_corners(&face, count);
                self.faces[count as usize] = face.relisted(owns);
                count += 1;
            }
        }
        self.faces.truncate(count as usize);
        for k in 0..kept {
            let (place, _) = self.face_places.find_or_add(self.pairs[k].surface, 0);
            self.pairs[k].surface = place;
            self.count_pair(k, place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::face_pair::TurnedFaces;
    use super::super::{Direction, SurfaceFace};
    use super::*;
    use crate::contact::motion::{Placement, Twist};
    use crate::contact::tool::{Tool, ToolMesh, capsule_mesh};
    use ab_tree::{AbTree, leaf_key};
    use glam::DQuat;
    use spm::Certified;

    const FACES: u32 = 12;

    /// A strip of faces along x that is bent at its end, and its tree.
    fn strip() -> (ActiveMesh, AbTree) {
        let mut mesh = ActiveMesh::new(FACES + 2, FACES, 0);
        for v in 0..FACES + 2 {
            let at = [0.5 * v as f32, (v % 2) as f32, 0.0];
            mesh.set_base_vertex(v, at, Certified::EXACT);
        }
        let mut tree = AbTree::new(FACES);
        tree.preconstruct(FACES);
        for face in 0..FACES {
            let across = |is_there: bool, other: u32| if is_there { other } else { NONE };
            let before = across(face > 0, face.wrapping_sub(1));
            let after = across(face + 1 < FACES, face + 1);
            // All seen from above.
            let corners = [face, face + 1 + face % 2, face + 2 - face % 2];
            let neighbours = corners.map(|v| match v - face {
                0 => after,
                1 => NONE,
                _ => before,
            });
            mesh.set_base_face(face, corners, neighbours)
                .expect("all are there");
            tree.insert(face, leaf_key(face, FACES));
        }
        tree.refit(|face| mesh.face_box(face));
        (mesh, tree)
    }

    /// Whether all of the list is what the mesh and the pairs say.
    fn check(near: &Neighbourhood, mesh: &ActiveMesh) {
        let mut owned = vec![0; FACES as usize + 2];
        for (place, face) in (0..).zip(&near.faces) {
            let made = SurfaceFace::of(mesh, face.face);
            assert_eq!(face.corners, made.corners);
            assert_eq!(face.normal, made.normal);
            assert_eq!(face.beyond, made.beyond, "{}", face.face);
            assert_eq!(face.owns_edge, made.owns_edge);
            assert_eq!(face.asks_edge, made.asks_edge);
            assert_eq!(near.place_of(face.face), Some(place));
            assert!(face.pairs > 0);
            assert_eq!(near.pairs_of(place).count(), face.pairs as usize);
            for (vertex, owns) in face.vertices.iter().zip(face.owns) {
                owned[*vertex as usize] += u32::from(owns);
            }
        }
        for face in &near.faces {
            assert!(face.vertices.iter().all(|&v| owned[v as usize] == 1));
        }
        let pairs: u32 = near.faces.iter().map(|face| face.pairs).sum();
        assert_eq!(pairs as usize, near.pairs.len());
        assert_eq!(near.pairs.len(), near.gaps.len());
    }

    /// A neighbour that has changed, more than once, and a list without the farthest pairs: each
    /// face that is left is as if it were listed anew.
    #[test]
    fn the_faces_of_an_updated_list_are_those_of_the_mesh() {
        let (mut mesh, mut tree) = strip();
        let tool = Tool::new(&capsule_mesh(0.3, 6.0, 8, 6)).expect("it is a tool");
        let shape = ToolShape::new(&tool, 1.0);
        let mut near = Neighbourhood::new(&shape);
        let at = Placement {
            centre: DVec3::new(3.0, 0.5, 0.6),
            orientation: DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
        };
        let tube = LookAheadTube::along(at, Twist::default(), 0.1, 1.0, &shape);
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        near.collect(surface, &shape, tube, &mut u32::MAX.into());
        assert_eq!(near.faces.len(), FACES as usize);
        check(&near, &mesh);
        for (height, changed) in [(0.2, [FACES - 1; 2]), (0.0, [FACES - 1, 3])] {
            let last = [0.5 * (FACES + 1) as f32, 1.0, height];
            mesh.set_base_vertex(FACES + 1, last, Certified::EXACT);
            tree.refit(|face| mesh.face_box(face));
            let surface = Surface {
                mesh: &mesh,
                tree: &tree,
            };
            let (updated, _) = near.update(surface, &shape, &changed, [1 << 20; 2]);
            assert!(matches!(updated, Updated::All(_)));
            check(&near, &mesh);
        }
        // A face whose pairs lie apart, since an update came amid it, and of which the first go.
        let first = near.pairs[0];
        for k in 0..near.pairs.len() {
            if near.pairs[k].surface == first.surface {
                near.gaps[k] = 1.0;
            }
        }
        near.count_pair(near.pairs.len(), first.surface);
        near.pairs.push(first);
        near.gaps.push(0.0);
        check(&near, &mesh);
        let all = near.pairs.len();
        near.shrink(0.4);
        assert!(!near.pairs.is_empty() && near.pairs.len() < all);
        check(&near, &mesh);
    }

    /// What is kept of a tool's face within a collection is not used in the next, and a state from
    /// a recording, which comes without it, goes on alike.
    #[test]
    fn a_collection_does_not_depend_on_what_was_before() {
        let (mesh, tree) = strip();
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        // A large oblique face: its own normal separates it best.
        let positions = [[-20.0, -15.0, 0.0], [20.0, -15.0, 0.0], [0.0, 30.0, 0.0]];
        let plate = ToolMesh {
            positions: positions.map(DVec3::from_array).to_vec(),
            triangles: vec![[0, 1, 2]],
        };
        let tool = Tool::new(&plate).expect("it is a tool");
        let shape = ToolShape::new(&tool, 1.0);
        let collected = |near: &mut Neighbourhood, angle: f64| {
            let at = Placement {
                centre: DVec3::new(3.0, 0.5, 0.6),
                orientation: DQuat::from_rotation_y(angle),
            };
            let path = Twist {
                linear: DVec3::new(0.05, 0.0, 0.02),
                ..Twist::default()
            };
            let tube = LookAheadTube::along(at, path, 0.1, 1.0, &shape);
            near.collect(surface, &shape, tube, &mut u32::MAX.into());
            assert_eq!(near.pairs.len(), FACES as usize);
            let of_tool = |pair: &NearPair| matches!(pair.along, Direction::Turning(_));
            assert!(near.pairs.iter().all(of_tool));
            assert!(near.gaps.iter().all(|&gap| gap > 0.1));
            format!("{:?} {:?}", near.pairs, near.gaps)
        };
        let (mut kept, mut read) = (Neighbourhood::new(&shape), Neighbourhood::new(&shape));
        for angle in [0.1, -0.1, 0.05] {
            let alone = collected(&mut Neighbourhood::new(&shape), angle);
            assert_eq!(collected(&mut kept, angle), alone);
            read.turned = TurnedFaces::default();
            assert_eq!(collected(&mut read, angle), alone);
            read.turned = TurnedFaces::default();
            let (updated, _) = read.update(surface, &shape, &[3], [1 << 20; 2]);
            assert!(matches!(updated, Updated::All(_)));
            assert_eq!(read.pairs.len(), FACES as usize);
        }
    }

    /// Pairs that a gap tells to be beyond a distance are beyond it all along a motion, also one
    /// beside the path, and where the path was shortened amid a collection.
    #[test]
    fn a_gap_holds_on_every_motion_within_the_tube() {
        let (mesh, tree) = strip();
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        let tool = Tool::new(&capsule_mesh(0.3, 6.0, 8, 6)).expect("it is a tool");
        let shape = ToolShape::new(&tool, 1.0);
        let start = Placement {
            centre: DVec3::new(3.0, 0.5, 0.6),
            orientation: DQuat::from_rotation_y(1.4),
        };
        let path = Twist {
            linear: DVec3::new(0.1, 0.05, -0.1),
            angular: DVec3::new(0.05, 0.1, 0.0),
        };
        let beside = Twist {
            linear: DVec3::new(0.0, 0.1, 0.1),
            ..Twist::default()
        };
        let (mut told, mut wrong) = (0, 0);
        for share in [1.0, 0.6] {
            let mut near = Neighbourhood::new(&shape);
            let tube = LookAheadTube::along(start, path, 0.1, 0.3, &shape);
            if share < 1.0 {
                near.collect(surface, &shape, tube, &mut 150.into());
                assert!(near.has_partial_collection());
                near.shorten_collection(&shape, share, u32::MAX);
            }
            near.collect(surface, &shape, tube, &mut u32::MAX.into());
            assert!(!near.pairs.is_empty() && near.tube.left() > 0.0);
            for motion in [path.times(share), path.times(0.5).plus(&beside)] {
                let clear = near.gap_beyond(&motion, &start, 0.02);
                for k in 0..near.pairs.len() {
                    if !near.is_beyond(k, clear) {
                        continue;
                    }
                    told += 1;
                    let pair = near.pairs[k];
                    let face = near.faces[pair.surface as usize].corners;
                    for part in 0..=8 {
                        let at = start.moved(&motion.times(0.125 * f64::from(part)));
                        let corners = shape.faces[pair.tool as usize]
                            .vertices
                            .map(|v| at.centre + at.rotation() * shape.points[v as usize]);
                        let closest = geometry::closest_points_of_triangles(face, corners);
                        wrong += u32::from(closest.distance_squared <= 0.02 * 0.02);
                    }
                }
            }
        }
        assert!(told > 0 && wrong == 0, "{wrong} of {told}");
    }
}
