//! Collection of the candidate pairs, and their update where the surface changed.

use super::{
    Direction, LookAheadTube, MAX_PAIRS, MAX_SURFACE_FACES, NearPair, Neighbourhood, ToolShape,
    normal_of,
};
use crate::contact::query::{Body, Ending, Limit, PairWork, Surface};
use crate::contact::tool::{RelativePath, Resume, for_each_face_near, for_each_near_pair};
use glam::{DMat3, DVec3};
use spm::{ActiveMesh, Handle, NONE};
use std::ops::ControlFlow;

/// Halvings of the margin at once if the neighbourhood is full.
const HALVINGS: usize = 6;

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
                    // The places of faces change.
                    candidate = None;
                    if !self.make_room(surface.mesh, &mut margin) {
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
                    self.clear_until.push(gap);
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
        self.high_water = self.high_water.max(self.pairs.len());
        self.tube = LookAheadTube::nowhere();
        match ending {
            Ending::Complete => self.tube = partial.tube.narrowed(partial.margin),
            Ending::OutOfBudget { .. } => self.partial = Some(partial),
            Ending::Stopped { .. } => {}
        }
    }

    /// Halves the margin until a quarter of the room is free; false if that does not suffice.
    fn make_room(&mut self, mesh: &ActiveMesh, margin: &mut f64) -> bool {
        for _ in 0..HALVINGS {
            *margin *= 0.5;
            self.shrink(mesh, *margin);
            if self.has_room() {
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
        let own = shape.faces[tool_face as usize];
        self.list(own.vertices, shape, centres);
        let moving = MovingFace {
            corners: [&self.positions, &self.ends]
                .map(|places| own.vertices.map(|v| places[v as usize])),
            own: own.normal,
            rotation: self.rotation,
        };
        let (gap, along) = moving.best_apart(candidate, margin);
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
    /// or of an unfinished one that had come as far. It may not cost more than `most`.
    pub fn update(
        &mut self,
        surface: Surface<'_>,
        shape: &ToolShape,
        changed: &[Handle],
        most: u32,
    ) -> (Updated, PairWork) {
        let mut work = PairWork::default();
        let (tube, margin, mut resume) = match self.partial {
            Some(partial) => (partial.tube, partial.margin, Some(partial.resume)),
            None if self.tube.left() > 0.0 => (self.tube, self.tube.straight_margin(), None),
            None => return (Updated::Unknown, work),
        };
        self.generation += 1;
        let mesh = surface.mesh;
        let within = margin + tube.bend_seen(margin);
        let ends = tube.ends();
        self.place(shape, &ends[0]);
        self.place_ends(shape, &ends[1]);
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
            let corners = candidate.corners;
            let centres = ends.map(|at| at.centre);
            let limits = [most.saturating_sub(work.cost()), PairWork::FACE_PAIR];
            let (mut visited, mut has_room) = (0, true);
            let take = |own| {
                visited += 1;
                has_room = self.pairs.len() < MAX_PAIRS && self.faces.len() < MAX_SURFACE_FACES;
                if has_room
                    && self
                        .take(mesh, shape, centres, &mut candidate, own, margin)
                        .is_some()
                {
                    // The tool may have deviated from the path since.
                    self.clear_until.push(f64::NEG_INFINITY);
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
        self.high_water = self.high_water.max(self.pairs.len());
        match (&mut self.partial, resume) {
            (Some(partial), Some(resume)) => {
                partial.resume = resume;
                (Updated::Unfinished, work)
            }
            _ => (Updated::All(kept), work),
        }
    }

    /// Drops the pairs of faces that have changed or are gone. Returns how many are left.
    fn drop_changed(&mut self, mesh: &ActiveMesh, changed: &[Handle]) -> usize {
        // A face may be listed more than once.
        for &face in changed {
            if let Some(place) = self.face_places.find(face) {
                self.faces[place as usize].face = NONE;
            }
        }
        let faces = &self.faces;
        let face_of = |pair: &NearPair| faces[pair.surface as usize].face;
        let is_there = |face: Handle| face != NONE && mesh.is_active(face);
        let mut kept = 0;
        for k in 0..self.pairs.len() {
            let face = face_of(&self.pairs[k]);
            if is_there(face) {
                // A handle until the faces are indexed anew.
                self.pairs[kept] = NearPair {
                    surface: face,
                    ..self.pairs[k]
                };
                self.clear_until[kept] = self.clear_until[k];
                kept += 1;
            }
        }
        self.keep_first(kept, mesh);
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

    /// Whether a full neighbourhood has enough room to continue.
    fn has_room(&self) -> bool {
        4 * self.pairs.len() <= 3 * MAX_PAIRS && 4 * self.faces.len() <= 3 * MAX_SURFACE_FACES
    }

    /// Keeps only pairs that may be within a margin, and their faces.
    fn shrink(&mut self, mesh: &ActiveMesh, margin: f64) {
        let mut kept = 0;
        for k in 0..self.pairs.len() {
            let pair = self.pairs[k];
            if self.clear_until[k] <= margin {
                let face = self.faces[pair.surface as usize].face;
                self.pairs[kept] = NearPair {
                    // A handle until the faces are indexed anew.
                    surface: face,
                    ..pair
                };
                self.clear_until[kept] = self.clear_until[k];
                kept += 1;
            }
        }
        self.keep_first(kept, mesh);
    }

    /// Keeps the first pairs, which hold handles, and indexes the faces anew.
    fn keep_first(&mut self, kept: usize, mesh: &ActiveMesh) {
        self.clear_until.truncate(kept);
        self.pairs.truncate(kept);
        self.clear_faces();
        for k in 0..kept {
            let place = self.face_place(mesh, self.pairs[k].surface);
            self.pairs[k].surface = place;
            self.count_pair(k, place);
        }
    }
}

/// A face of the surface for which pairs are collected.
struct CandidateFace {
    face: Handle,
    corners: [DVec3; 3],
    /// Unit normal; zero without area.
    normal: DVec3,
    /// Index among the faces that have a pair.
    place: Option<u32>,
}

impl CandidateFace {
    fn of(mesh: &ActiveMesh, face: Handle) -> Self {
        let corners = mesh.corners(face);
        Self {
            face,
            corners,
            normal: normal_of(corners),
            place: None,
        }
    }
}

/// A face of the tool for which pairs are collected.
struct MovingFace {
    /// Corners at the start and at the end of the path.
    corners: [[DVec3; 3]; 2],
    /// Normal in the tool's axes.
    own: DVec3,
    /// From the tool's axes to the model's at the start.
    rotation: DMat3,
}

impl MovingFace {
    /// The direction of largest separation along the straight path, among the normals of two faces
    /// and the direction between their centres, and that separation; or the first direction with a
    /// separation above `enough`.
    fn best_apart(&self, face: &CandidateFace, enough: f64) -> (f64, Direction) {
        let [start, end] = &self.corners;
        // Both signs of a normal at once.
        let either = |normal: DVec3| {
            let [a, b, c] = face.corners.map(|p| normal.dot(p));
            let [p, q, r] = start.map(|p| normal.dot(p));
            let [s, t, u] = end.map(|p| normal.dot(p));
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let least = p.min(q).min(r).min(s.min(t).min(u));
            let most = p.max(q).max(r).max(s.max(t).max(u));
            let (ahead, behind) = (least - high, low - most);
            if ahead >= behind {
                (ahead, 1.0, high)
            } else {
                (behind, -1.0, -low)
            }
        };
        let still = |normal: DVec3, sign: f64, height: f64| {
            let direction = sign * normal;
            Direction::Still { direction, height }
        };
        let (over, sign, height) = either(face.normal);
        let over_face = still(face.normal, sign, height);
        if over > enough {
            return (over, over_face);
        }
        let (under, sign, _) = either(self.rotation * self.own);
        let under_tool = Direction::Turning(sign * self.own);
        if under > enough {
            return (under, under_tool);
        }
        let middle = |[a, b, c]: [DVec3; 3]| a + b + c;
        let between = (middle(*start) - middle(face.corners)).normalize_or_zero();
        let (beside, sign, height) = either(between);
        if beside > over.max(under) {
            (beside, still(between, sign, height))
        } else if over >= under {
            (over, over_face)
        } else {
            (under, under_tool)
        }
    }
}
