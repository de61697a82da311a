//! Faces and their neighbours during simplification, and which edges may collapse.

use crate::edges::neighbours;
use crate::tuning::simplify::MAX_FACES_ROUND_AN_END;
use spm::NONE;

/// Corners and neighbours by face, and one face by vertex slot.
pub(super) struct Topology {
    /// Slots, counterclockwise; of a removed face the first is `NONE`.
    pub corners: Vec<[u32; 3]>,
    /// The face across the edge opposite each corner, `NONE` at a boundary.
    pub neighbours: Vec<[u32; 3]>,
    /// By slot: some live face round it.
    face_of: Vec<u32>,
    /// By slot: live faces round it.
    faces_round: Vec<u32>,
    /// Faces that are left.
    pub alive: u32,
}

/// An edge that may collapse as far as topology goes; names as in the record.
pub(super) struct Collapsible {
    pub vt: u32,
    pub vu: u32,
    pub fl: u32,
    pub fr: u32,
    vl: u32,
    vr: u32,
    pub fn_: [u32; 4],
}

impl Topology {
    /// Of a whole mesh.
    ///
    /// # Panics
    /// When it is no manifold.
    pub fn new(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let mut face_of = vec![NONE; vertices];
        let mut faces_round = vec![0; vertices];
        for (face, corners) in (0u32..).zip(triangles) {
            for &corner in corners {
                face_of[corner as usize] = face;
                faces_round[corner as usize] += 1;
            }
        }
        Self {
            corners: triangles.to_vec(),
            neighbours: neighbours(triangles).expect("a manifold"),
            face_of,
            faces_round,
            alive: triangles.len() as u32,
        }
    }

    pub fn is_alive(&self, face: u32) -> bool {
        self.corners[face as usize][0] != NONE
    }

    /// Whether so many faces are round a slot that no edge to it may collapse.
    pub fn has_large_fan(&self, slot: u32) -> bool {
        self.faces_round[slot as usize] > MAX_FACES_ROUND_AN_END
    }

    /// The side of a face from corner k to the next: its two slots and the face across.
    pub fn side(&self, face: u32, k: usize) -> (u32, u32, u32) {
        let corners = self.corners[face as usize];
        (
            corners[k],
            corners[(k + 1) % 3],
            self.neighbours[face as usize][(k + 2) % 3],
        )
    }

    fn corner_of(&self, face: u32, slot: u32) -> Option<usize> {
        self.corners[face as usize].iter().position(|&s| s == slot)
    }

    /// The face across the edge of `face` opposite `slot`.
    fn across(&self, face: u32, slot: u32) -> u32 {
        self.corner_of(face, slot)
            .map_or(NONE, |k| self.neighbours[face as usize][k])
    }

    /// Faces round a slot and the slots next to it; true on a boundary.
    fn ring(&self, slot: u32, fan: &mut Vec<u32>, ring: &mut Vec<u32>) -> bool {
        fan.clear();
        ring.clear();
        let first = self.face_of[slot as usize];
        // Counterclockwise until it closes or meets the boundary; then clockwise from the first for
        // the rest.
        let mut face = first;
        loop {
            let Some(k) = self.corner_of(face, slot) else {
                return true;
            };
            fan.push(face);
            ring.push(self.corners[face as usize][(k + 1) % 3]);
            let next = self.neighbours[face as usize][(k + 1) % 3];
            if next == first {
                return false;
            }
            if next == NONE {
                ring.push(self.corners[face as usize][(k + 2) % 3]);
                break;
            }
            face = next;
        }
        let mut face = first;
        while let Some(k) = self.corner_of(face, slot) {
            if face != first {
                fan.push(face);
                ring.push(self.corners[face as usize][(k + 1) % 3]);
            }
            face = self.neighbours[face as usize][(k + 2) % 3];
            if face == NONE {
                break;
            }
        }
        true
    }

    /// The edge at a side of a face, when collapsing it keeps the mesh a manifold: the link
    /// condition on the mesh closed with one more vertex behind all boundaries. Fills in fans and
    /// rings of both ends (vt, vu).
    ///
    /// `None` at once where an end has a large fan: every edge to it asks in every round.
    pub fn collapsible(
        &self,
        face: u32,
        k: usize,
        fans: &mut [Vec<u32>; 2],
        rings: &mut [Vec<u32>; 2],
    ) -> Option<Collapsible> {
        let (fl, (vt, vu, fr)) = (face, self.side(face, k));
        if self.has_large_fan(vt) || self.has_large_fan(vu) {
            return None;
        }
        let vl = self.corners[face as usize][(k + 2) % 3];
        let vr = if fr == NONE {
            NONE
        } else {
            let corners = self.corners[fr as usize];
            corners.into_iter().find(|&s| s != vt && s != vu)?
        };
        let [fan_t, fan_u] = fans;
        let [ring_t, ring_u] = rings;
        let boundary_t = self.ring(vt, fan_t, ring_t);
        let boundary_u = self.ring(vu, fan_u, ring_u);
        // An inner edge between two boundaries: the boundaries would meet in a point.
        if fr != NONE && boundary_t && boundary_u {
            return None;
        }
        let common = ring_t.iter().filter(|s| ring_u.contains(s)).count();
        if common != if fr == NONE { 1 } else { 2 } {
            return None;
        }
        let behind = |face: u32, slot: u32| {
            if face == NONE {
                NONE
            } else {
                self.across(face, slot)
            }
        };
        let fn_ = [
            behind(fl, vu),
            behind(fl, vt),
            behind(fr, vu),
            behind(fr, vt),
        ];
        // Without a neighbour vl (or vr) would hang on nothing.
        if fn_[0] == NONE && fn_[1] == NONE {
            return None;
        }
        if fr != NONE {
            let orphan = fn_[2] == NONE && fn_[3] == NONE;
            let tetrahedron = fn_[0] == fn_[2] && fn_[1] == fn_[3];
            if orphan || tetrahedron {
                return None;
            }
        }
        Some(Collapsible {
            vt,
            vu,
            fl,
            fr,
            vl,
            vr,
            fn_,
        })
    }

    /// Removes the faces of the edge; vt's slot takes over the fan of vu.
    pub fn collapse(&mut self, edge: &Collapsible, fan_u: &[u32]) {
        let removed = 1 + u32::from(edge.fr != NONE);
        self.faces_round[edge.vt as usize] += self.faces_round[edge.vu as usize];
        self.faces_round[edge.vt as usize] -= 2 * removed;
        for third in [edge.vl, edge.vr].into_iter().take(removed as usize) {
            self.faces_round[third as usize] -= 1;
        }
        let [fn0, fn1, fn2, fn3] = edge.fn_;
        self.join(edge.fl, fn0, fn1);
        if edge.fr != NONE {
            self.join(edge.fr, fn2, fn3);
        }
        for &face in fan_u {
            if let Some(k) = self.corner_of(face, edge.vu) {
                self.corners[face as usize][k] = edge.vt;
            }
        }
        let either = |a: u32, b: u32| if a == NONE { b } else { a };
        self.face_of[edge.vl as usize] = either(fn0, fn1);
        self.face_of[edge.vt as usize] = either(fn0, fn1);
        if edge.fr != NONE {
            self.face_of[edge.vr as usize] = either(fn2, fn3);
        }
        for face in [edge.fl, edge.fr].into_iter().filter(|&f| f != NONE) {
            self.corners[face as usize] = [NONE; 3];
            self.alive -= 1;
        }
    }

    /// Makes the two faces next to a removed one each other's neighbour.
    fn join(&mut self, removed: u32, a: u32, b: u32) {
        for (face, other) in [(a, b), (b, a)] {
            if face != NONE {
                for neighbour in &mut self.neighbours[face as usize] {
                    if *neighbour == removed {
                        *neighbour = other;
                    }
                }
            }
        }
    }
}
