//! Queries of any numbers: no panic, no allocation, no result that is not finite.
//! Poses that are none are rejected where a pose becomes a frame, and counted.

use crate::common::fronts::{Front, full_mesh, scaled};
use geometry::{Pose, Similarity};
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::{
    FacePair, Nearest, Placed, all_pairs, closest_point, faces_within, first_pair, swept_sphere,
};
use hrtc_core::contact::tool::{Tool, capsule_mesh};
use realtime::counting_allocator::count;
use simulator::Random;

/// Far beyond any scene, and still such that a squared distance is a number.
const FARTHEST: f64 = 1e100;
/// Pairs of nodes and faces that a query of two bodies may visit.
const BUDGET: u32 = 2000;

/// A front with faces of all sorts of no area among its own: in one point, in one edge, twice the
/// same.
fn front() -> Front {
    let mut mesh = full_mesh("cow.obj", 4000);
    for k in 0..40 {
        let [a, b, c] = mesh.triangles[97 * k];
        let [at_a, at_b, at_c] = [a, b, c].map(|v| mesh.positions[v as usize]);
        let first = mesh.positions.len() as u32;
        let corners = match k % 4 {
            0 => [at_a; 3],
            1 => [at_a, at_b, 0.25 * at_a + 0.75 * at_b],
            2 => [at_a, at_a, at_c],
            _ => [at_a, at_c, at_b],
        };
        mesh.positions.extend(corners);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    Front::of_mesh(&mesh)
}

/// What came of many queries.
#[derive(Debug, Default)]
struct Counts {
    rejected: u64,
    asked: [u64; 5],
    /// Answers with something found.
    found: [u64; 5],
}

struct Asker<'a> {
    front: &'a Front,
    tool: Tool,
    /// The same tool at rest, to be placed box by box.
    rest: Tool,
    size: f64,
    random: Random,
    out: Vec<FacePair>,
    hint: Option<Nearest>,
    counts: Counts,
}

impl Asker<'_> {
    /// Mostly a number about the model, sometimes any, sometimes none.
    fn number(&mut self) -> f64 {
        let signed = 2.0 * self.random.unit() - 1.0;
        match self.random.below(200) {
            0 => [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][self.random.below(3) as usize],
            1 => signed * 10f64.powi(self.random.below(400) as i32 - 300),
            2 => 0.0,
            3 => signed.signum() * 5e-324,
            _ => signed * self.size,
        }
    }

    fn vector(&mut self) -> DVec3 {
        let about = self.random.below(self.front.faces.len() as u64) as usize;
        let about = self.front.faces[about].1[0];
        match self.random.below(4) {
            // On a corner, near one, anywhere.
            0 => about,
            1 | 2 => about + 0.02 * DVec3::new(self.number(), self.number(), self.number()),
            _ => DVec3::new(self.number(), self.number(), self.number()),
        }
    }

    /// A frame, `None` for what is none.
    fn frame(&mut self) -> Option<Similarity> {
        let pose = Pose {
            position: self.vector(),
            orientation: DQuat::from_xyzw(
                self.number(),
                self.number(),
                self.number(),
                self.number(),
            ),
        };
        let scale = match self.random.below(50) {
            0 => self.number(),
            1 => 10f64.powi(self.random.below(20) as i32 - 10),
            _ => 1.0,
        };
        let frame = Similarity::new(pose, scale)?;
        (pose.position.abs().max_element() <= FARTHEST && scale <= FARTHEST).then_some(frame)
    }

    /// Asks one query of any kind.
    fn ask(&mut self) {
        let Some(frame) = self.frame() else {
            self.counts.rejected += 1;
            return;
        };
        let surface = self.front.surface();
        let point = frame.point(DVec3::ZERO);
        let other = point + frame.vector(DVec3::Z) * (0.1 * self.size);
        let radius = 0.05 * self.size * self.random.unit();
        let hint = self.hint.map(|nearest| nearest.face);
        // Those of two bodies take a hundred times as long: one of forty.
        let kind = match self.random.below(40) {
            0 => 3 + self.random.below(2) as usize,
            _ => self.random.below(3) as usize,
        };
        let found = match kind {
            0 => {
                let (nearest, _) = closest_point(surface, point, hint);
                let nearest = nearest.expect("the front has faces");
                let closest = nearest.closest;
                assert!(closest.point.is_finite() && closest.distance_squared.is_finite());
                assert!(closest.weights.iter().all(|w| w.is_finite()));
                self.hint = Some(nearest);
                true
            }
            1 => {
                let mut count = 0;
                faces_within(surface, point, radius, |_, closest| {
                    assert!(closest.point.is_finite());
                    count += 1;
                    radius
                });
                count > 0
            }
            2 => {
                let (hit, _) = swept_sphere(surface, point, other - point, radius);
                assert!(hit.is_none_or(|hit| (0.0..=1.0).contains(&hit.fraction)));
                hit.is_some()
            }
            3 => {
                self.tool.place(&frame);
                let found = all_pairs(&surface, &self.tool, BUDGET, &mut self.out);
                for pair in &self.out[..found.count] {
                    assert!(pair.meeting.point().is_some_and(DVec3::is_finite));
                }
                found.count > 0
            }
            _ => {
                let placed = Placed {
                    body: &self.rest,
                    to_query: frame,
                };
                let (pair, _, _) = first_pair(&surface, &placed, BUDGET, None);
                assert!(pair.is_none_or(|p| p.meeting.point().is_some_and(DVec3::is_finite)));
                pair.is_some()
            }
        };
        self.counts.asked[kind] += 1;
        self.counts.found[kind] += u64::from(found);
    }
}

#[test]
fn a_hundred_thousand_queries_are_finite_and_allocate_nothing() {
    let (seed, queries) = (1, 100_000);
    let front = front();
    let size = front.diagonal();
    let mesh = scaled(&capsule_mesh(0.015, 0.1, 8, 6), size);
    let tool = Tool::new(&mesh).expect("a capsule is a tool");
    let mut asker = Asker {
        front: &front,
        rest: tool.clone(),
        tool,
        size,
        random: Random::new(seed),
        out: vec![FacePair::NONE; 1 << 12],
        hint: None,
        counts: Counts::default(),
    };
    let calls = count(|| (0..queries).for_each(|_| asker.ask()));
    let counts = asker.counts;
    println!("seed {seed}, {queries} queries: {counts:?}");
    assert_eq!(calls, 0, "queries allocate nothing");
    assert!(counts.rejected > queries / 100, "{counts:?}");
    assert_eq!(counts.rejected + counts.asked.iter().sum::<u64>(), queries);
    // Every kind finds something.
    for (asked, found) in counts.asked.into_iter().zip(counts.found) {
        assert!(found > 0 && asked >= found, "{counts:?}");
    }
}
