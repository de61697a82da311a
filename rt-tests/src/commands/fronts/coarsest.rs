//! The coarsest front of the same sequence that keeps a tolerance: what could be had in place of {E
//! > t}.
//!
//! From {E > t} one VSP after the other is left out, with everything that needs it, as long as the
//! surface that remains stays within the tolerance. That is measured both ways on the front as it
//! is, not as the mesh was when the edge collapsed: samples of the changed faces against the full
//! mesh, and the vertices of the full mesh against them. In the end there is no VSP left that could
//! be done without: whichever goes, with what needs it, the front exceeds the tolerance somewhere.
//! (Two that could only go together may remain.) It takes the whole full mesh and a minute for a
//! million faces, so it is a yardstick for E and no way to make fronts.
//!
//! (Errors are not monotone: undoing one split may exceed the tolerance, and undoing those that
//! need it as well may not. Therefore both are tried. Measured on fandisk, featuretype and
//! bunny20k: beyond `MAX_TOGETHER` at a time nothing more was found.)

use crate::models::surface::Surface;
use crate::models::{Model, active_triangles};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use spm::{ActiveMesh, ErrorScale, OperationFaces};
use std::cmp::Reverse;
use std::collections::BTreeSet;

/// Steps of the grid of samples on a face: at least, at most, and for each square root of vertices
/// of the full mesh that hang on it. The builder's grid, half as fine again.
const STEPS: (f64, f64, f64) = (6.0, 64.0, 3.0);
/// Splits that are undone at once, at most.
const MAX_TOGETHER: usize = 32;

/// A front of {E > asked} on its way.
struct Front<'a> {
    full: &'a Surface,
    positions: &'a [DVec3],
    mesh: ActiveMesh,
    /// By VSP: those of {E > asked} that depend on it.
    dependents: Vec<Vec<u32>>,
    /// By face: the vertices of the full mesh that are nearest to it.
    hanging: Vec<Vec<u32>>,
    /// By face: a triangle of the full mesh that is near.
    hints: Vec<u32>,
    asked: f64,
    out: OperationFaces,
}

/// The front {E > asked}, model units: all VSPs whose expected error exceeds it.
///
/// # Panics
/// When {E > asked} is no front.
#[must_use]
pub fn front_of_controller(model: &Model, asked: f64) -> ActiveMesh {
    let scale = ErrorScale::for_diagonal(model.file.model_header().diagonal);
    let mut mesh = model.active_mesh();
    let mut out = OperationFaces::new();
    for record in model.records.iter().filter(|r| scale.decode(r.e) > asked) {
        let done = mesh.split(record.i, &mut out);
        assert!(done.is_ok(), "{done:?}");
    }
    mesh
}

/// A front of [`front_of_controller`] without every VSP that is not needed to keep what is asked.
#[must_use]
pub fn coarsest(model: &Model, full: &Surface, start: ActiveMesh, asked: f64) -> ActiveMesh {
    let mut order: Vec<u32> = (0..model.records.len() as u32)
        .filter(|&i| start.is_performed(i))
        .collect();
    // What needs the least first, as the LOD controller does; of equals what depends on most.
    order.sort_by_key(|&i| (model.records[i as usize].e, Reverse(i)));
    let mut front = Front::new(model, full, start, asked);
    // What is left out makes other collapses legal: until a whole round finds none.
    loop {
        let before = order.len();
        order.retain(|&i| !front.leave_out(i));
        if order.len() == before {
            return front.mesh;
        }
    }
}

impl<'a> Front<'a> {
    fn new(model: &'a Model, full: &'a Surface, mesh: ActiveMesh, asked: f64) -> Self {
        let (handles, triangles) = active_triangles(&mesh);
        let header = model.file.model_header();
        let faces = (header.base_faces + 2 * header.vsps) as usize;
        let mut hints = vec![0; faces];
        for (&face, corners) in handles.iter().zip(&triangles) {
            let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
            hints[face as usize] = full.nearest(centre, 0).triangle;
        }
        let mut hanging = vec![Vec::new(); faces];
        let surface = Surface::new(triangles);
        let mut hint = 0;
        for vertex in model.full_vertices() {
            hint = surface
                .nearest(model.positions[vertex as usize], hint)
                .triangle;
            hanging[handles[hint as usize] as usize].push(vertex);
        }
        let mut dependents = vec![Vec::new(); header.vsps as usize];
        for i in (0..header.vsps).filter(|&i| mesh.is_performed(i)) {
            for dependency in mesh.dependencies(i) {
                dependents[dependency as usize].push(i);
            }
        }
        Self {
            full,
            dependents,
            positions: &model.positions,
            mesh,
            hanging,
            hints,
            asked,
            out: OperationFaces::new(),
        }
    }

    /// Leaves a split out, with everything that needs it, where that keeps what is asked; whether
    /// it did.
    fn leave_out(&mut self, i: u32) -> bool {
        if !self.mesh.is_performed(i) {
            return true;
        }
        let Some(undone) = self.needing(i) else {
            return false;
        };
        let mut changed = Vec::new();
        for &k in undone.iter().rev() {
            self.mesh.collapse(k, &mut self.out).expect("small fans");
            changed.extend(self.out.deformed());
            changed.extend(self.out.made_or_removed());
        }
        changed.sort_unstable();
        changed.dedup();
        let (stay, gone): (Vec<u32>, Vec<u32>) =
            changed.iter().partition(|&&face| self.mesh.is_active(face));
        let dealt = self.deal(&stay, &changed);
        if let Some(dealt) = dealt
            && self.faces_are_near(&stay, &dealt)
        {
            for face in gone {
                self.hanging[face as usize].clear();
            }
            for (face, vertices) in stay.into_iter().zip(dealt) {
                self.hanging[face as usize] = vertices;
            }
            return true;
        }
        for &k in &undone {
            let done = self.mesh.split(k, &mut self.out);
            assert!(done.is_ok(), "what was undone can be done again");
        }
        false
    }

    /// A performed VSP and the performed ones that need it, ascending; `None` when they are too
    /// many.
    fn needing(&self, i: u32) -> Option<Vec<u32>> {
        let mut found = BTreeSet::from([i]);
        let mut waiting = vec![i];
        while let Some(k) = waiting.pop() {
            for &other in &self.dependents[k as usize] {
                if self.mesh.is_performed(other) && found.insert(other) {
                    waiting.push(other);
                }
            }
            if found.len() > MAX_TOGETHER {
                return None;
            }
        }
        Some(found.into_iter().collect())
    }

    /// Deals the vertices that hang on changed faces to the nearest of those that stay; `None` when
    /// one is too far away.
    fn deal(&self, stay: &[u32], changed: &[u32]) -> Option<Vec<Vec<u32>>> {
        let corners: Vec<_> = stay.iter().map(|&f| self.mesh.corners(f)).collect();
        let mut dealt = vec![Vec::new(); corners.len()];
        for &face in changed {
            for &vertex in &self.hanging[face as usize] {
                let point = self.positions[vertex as usize];
                let to = |triangle: &[DVec3; 3]| {
                    closest_point_on_triangle(*triangle, point).distance_squared
                };
                let distances = corners.iter().map(to).enumerate();
                let (place, squared) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
                if squared.sqrt() > self.asked {
                    return None;
                }
                dealt[place].push(vertex);
            }
        }
        Some(dealt)
    }

    /// Whether the samples of faces are near enough to the full mesh.
    fn faces_are_near(&self, faces: &[u32], dealt: &[Vec<u32>]) -> bool {
        let (least, most, each) = STEPS;
        faces.iter().zip(dealt).all(|(&face, vertices)| {
            let [a, b, c] = self.mesh.corners(face);
            let steps = (each * (vertices.len() as f64).sqrt()).ceil();
            let steps = steps.clamp(least, most) as u32;
            let mut hint = self.hints[face as usize];
            (0..=steps).all(|row| {
                (0..=steps - row).all(|column| {
                    let [v, w] = [row, column].map(|k| f64::from(k) / f64::from(steps));
                    let near = self.full.nearest(a + (b - a) * v + (c - a) * w, hint);
                    hint = near.triangle;
                    near.distance <= self.asked
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spm_builder::generate::{Shape, generate};
    use spm_builder::{BuildOptions, NoProgress};

    fn model(shape: Shape) -> (Model, Surface) {
        let mesh = generate(shape, 6000, 1);
        let options = BuildOptions::default();
        let model = Model::build("trial".to_string(), mesh, &options, &NoProgress).unwrap();
        let full = Surface::new(model.full_triangles());
        (model, full)
    }

    #[test]
    fn it_keeps_what_is_asked_and_holds_nothing_that_could_be_left_out() {
        for shape in [Shape::Relief, Shape::Terrain, Shape::Wedge] {
            let (model, full) = model(shape);
            let asked = 2e-3 * model.file.model_header().diagonal;
            let start = front_of_controller(&model, asked);
            let before = start.performed();
            let mesh = coarsest(&model, &full, start, asked);
            mesh.check();
            assert!(mesh.performed() <= before && before < 2 * mesh.performed() + 8);
            let triangles = active_triangles(&mesh).1;
            let surface = Surface::new(triangles.clone());
            // E is no bound: what {E > asked} got wrong may have stayed.
            let mut beyond = 0;
            let mut samples = 0;
            for &vertex in &model.full_vertices() {
                let near = surface.nearest(model.positions[vertex as usize], 0);
                beyond += u32::from(near.distance > asked);
                samples += 1;
            }
            for [a, b, c] in triangles {
                let near = full.nearest((a + b + c) / 3.0, 0);
                beyond += u32::from(near.distance > asked);
                samples += 1;
            }
            assert!(1000 * beyond <= samples, "{shape:?}: {beyond} of {samples}");
            // Another round finds nothing.
            let mut front = Front::new(&model, &full, mesh.clone(), asked);
            let legal = (0..model.records.len() as u32).filter(|&i| mesh.collapse_is_legal(i));
            let left_out = legal.filter(|&i| front.leave_out(i)).count();
            assert_eq!(left_out, 0, "{shape:?}");
        }
    }

    #[test]
    fn a_finer_start_ends_at_the_same_size() {
        let (model, full) = model(Shape::Relief);
        let asked = 2e-3 * model.file.model_header().diagonal;
        let from =
            |t: f64| coarsest(&model, &full, front_of_controller(&model, t), asked).performed();
        let (same, finer) = (from(asked), from(asked / 3.0));
        assert!(10 * same.abs_diff(finer) < same, "{same} {finer}");
        assert!(front_of_controller(&model, asked / 3.0).performed() > 2 * same);
    }
}
