//! How the pairs are gathered, and renewed where the surface has changed.

use super::{
    Direction, LookAheadTube, MAX_PAIRS, MAX_SURFACE_FACES, NearPair, Neighbourhood, ToolShape,
    normal_of,
};
use crate::contact::query::{Body, Ending, PairWork, Surface};
use crate::contact::tool::{RelativePath, Resume, for_each_face_near, for_each_near_pair};
use glam::{DMat3, DVec3};
use spm::{ActiveMesh, Handle, NONE};
use std::ops::ControlFlow;

/// Times that the margin of a full neighbourhood is halved at once, at the most.
const HALVINGS: usize = 6;

/// A gathering for which the budget did not suffice.
#[derive(Debug, Clone, Copy)]
pub(super) struct PartialCollection {
    pub(super) tube: LookAheadTube,
    /// Around the straight lines.
    margin: f64,
    resume: Resume,
}

impl Neighbourhood {
    /// Gathers all pairs of a corridor. Where there are too many the margin shrinks; where that does not help, nothing is
    /// known and the ending says so. Nor is it while the budget of node pairs is spent: then the next call goes on with the
    /// same corridor, which begins where the tool is to stay until then.
    pub fn collect(
        &mut self,
        surface: Surface<'_>,
        shape: &ToolShape,
        tube: LookAheadTube,
        budget: u32,
    ) -> (Ending, PairWork) {
        let partial = self.partial.take();
        if partial.is_none() {
            self.clear();
        }
        let PartialCollection {
            tube,
            mut margin,
            resume,
        } = partial.unwrap_or(PartialCollection {
            tube,
            margin: tube.straight_margin(),
            resume: Resume::START,
        });
        let ends = tube.ends();
        let centres = ends.map(|at| at.centre);
        [self.rotation, self.end_rotation] = ends.map(|at| at.rotation());
        let mut candidate: Option<CandidateFace> = None;
        // Seen from the tool, straight ways are bent.
        let path = RelativePath::new(centres, [self.rotation, self.end_rotation]);
        let bend = tube.bend_seen(tube.straight_margin());
        let mut of_this_face = 0;
        let (ending, work, resume) = for_each_near_pair(
            &surface,
            &shape.blocks,
            &path,
            margin + bend,
            resume,
            budget,
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
                    other => {
                        of_this_face = self.pairs.len();
                        other.insert(CandidateFace::of(surface.mesh, face))
                    }
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
        let leaf_of = |face: CandidateFace| surface.tree.leaf_of(face.face);
        // A face visited again finds its pairs again.
        let is_seen_again = candidate.is_some_and(|face| Resume::at(leaf_of(face)) == resume);
        self.finish_collection(ending, partial, is_seen_again.then_some(of_this_face));
        (ending, work)
    }

    /// Ends or interrupts a collection. `seen_again`: number of pairs before those of a face that
    /// the next call visits again.
    fn finish_collection(
        &mut self,
        ending: Ending,
        partial: PartialCollection,
        seen_again: Option<usize>,
    ) {
        self.high_water = self.high_water.max(self.pairs.len());
        self.tube = LookAheadTube::nowhere();
        match ending {
            Ending::Complete => self.tube = partial.tube.narrowed(partial.margin),
            Ending::OutOfBudget { .. } => {
                if let Some(count) = seen_again {
                    self.pairs.truncate(count);
                    self.clear_until.truncate(count);
                }
                self.partial = Some(partial);
            }
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

    /// Takes a face of the surface and one of the tool as a pair if they come within a margin on the straight ways from
    /// where the tool was placed to where its ends were, and says how far they stay apart.
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
        self.pairs.push(NearPair {
            tool: tool_face,
            surface: place,
            along,
        });
        Some(gap)
    }

    /// After faces have changed or gone, what is known is what would have been gathered with them as they are now. Whether
    /// it is: not where nothing was known, where that does not fit, nor where it costs more than `most`; and what it cost.
    pub fn update(
        &mut self,
        surface: Surface<'_>,
        shape: &ToolShape,
        changed: &[Handle],
        most: u32,
    ) -> (bool, PairWork) {
        let mut work = PairWork::default();
        if self.partial.is_some() || self.tube.left() <= 0.0 {
            return (false, work);
        }
        let mesh = surface.mesh;
        let margin = self.tube.straight_margin();
        let within = margin + self.tube.bend_seen(margin);
        let ends = self.tube.ends();
        self.place(shape, &ends[0]);
        self.place_ends(shape, &ends[1]);
        // A face may be told of more than once.
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
                // A handle until the faces are counted anew.
                self.pairs[kept] = NearPair {
                    surface: face,
                    ..self.pairs[k]
                };
                self.clear_until[kept] = self.clear_until[k];
                kept += 1;
            }
        }
        self.keep_first(kept, mesh);
        let path = self.path;
        for &face in changed {
            if !surface.has(face) || self.face_places.find(face).is_some() {
                continue;
            }
            let mut candidate = CandidateFace::of(mesh, face);
            let corners = candidate.corners;
            let mut has_room = true;
            let centres = ends.map(|at| at.centre);
            work.node_pairs += for_each_face_near(&shape.blocks, &path, corners, within, |own| {
                work.faces += 1;
                has_room = self.pairs.len() < MAX_PAIRS && self.faces.len() < MAX_SURFACE_FACES;
                if has_room
                    && self
                        .take(mesh, shape, centres, &mut candidate, own, margin)
                        .is_some()
                {
                    // The tool may have strayed from the way since.
                    self.clear_until.push(f64::NEG_INFINITY);
                }
                has_room
            });
            if !has_room || work.cost() > most {
                return (false, work);
            }
        }
        self.high_water = self.high_water.max(self.pairs.len());
        (true, work)
    }

    /// Lists vertices of the tool that are not yet, where they are at the start and at the end of the way.
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

    /// Whether it is worth while to go on after it was full.
    fn has_room(&self) -> bool {
        4 * self.pairs.len() <= 3 * MAX_PAIRS && 4 * self.faces.len() <= 3 * MAX_SURFACE_FACES
    }

    /// Keeps only pairs that may be within a margin, and the faces that they have.
    fn shrink(&mut self, mesh: &ActiveMesh, margin: f64) {
        let mut kept = 0;
        for k in 0..self.pairs.len() {
            let pair = self.pairs[k];
            if self.clear_until[k] <= margin {
                let face = self.faces[pair.surface as usize].face;
                self.pairs[kept] = NearPair {
                    // A handle until the faces are counted anew.
                    surface: face,
                    ..pair
                };
                self.clear_until[kept] = self.clear_until[k];
                kept += 1;
            }
        }
        self.keep_first(kept, mesh);
    }

    /// Keeps only the first pairs, which have handles of faces, and counts the faces anew.
    fn keep_first(&mut self, kept: usize, mesh: &ActiveMesh) {
        self.clear_until.truncate(kept);
        self.pairs.truncate(kept);
        self.clear_faces();
        for k in 0..kept {
            self.pairs[k].surface = self.face_place(mesh, self.pairs[k].surface);
        }
    }
}

/// A face of the surface for which pairs are gathered.
struct CandidateFace {
    face: Handle,
    corners: [DVec3; 3],
    /// Unit normal; zero without area.
    normal: DVec3,
    /// Among the faces that have a pair.
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

/// A face of the tool that is gathered for.
struct MovingFace {
    /// Where its corners are at the start and at the end of the way.
    corners: [[DVec3; 3]; 2],
    /// Its normal in the tool's axes.
    own: DVec3,
    /// From those to the model's at the start.
    rotation: DMat3,
}

impl MovingFace {
    /// Of the two faces' normals and the way between their middles the one along which they stay apart most on the straight
    /// way, and how far; or the first along which they stay farther apart than `enough`.
    fn best_apart(&self, face: &CandidateFace, enough: f64) -> (f64, Direction) {
        let [start, end] = &self.corners;
        // Both ways of a normal at once: what reaches least one way reaches most the other.
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
