//! A cylinder mesh probe against the coarse, the locally refined and the full mesh (thesis Figure
//! 5.20), and what the boxes of a coarse mesh cost that are those of the full mesh's tree (Figure
//! 4.8 c and d).
//!
//! The probe is measured in edges of the full mesh, so that it meets about as many faces of any:
//! what grows is the search for them.

use super::closest::touches;
use super::full_front::FullFront;
use super::timing::{Caches, Timed, time_stretch};
use super::tools::{MAX_PAIRS, Touch, new_tool, ours, refine};
use crate::failure::Failure;
use crate::models::local_front::LocalFront;
use crate::models::surface::Surface as Full;
use crate::models::{Model, active_triangles};
use crate::report::quantile::{quantile, sort};
use crate::report::table::Table;
use crate::report::units::grouped;
use hrtc_core::contact::query::{FacePair, PairWork, Surface, all_pairs};
use hrtc_core::contact::tool::{Tool, ToolMesh, cylinder_mesh};
use rand::Rng;
use serde::Serialize;
use std::ops::Range;

/// A probe, and how far around the points touched it is refined, in mean edges of the full mesh.
#[derive(Debug, Clone, Copy)]
pub struct Probe {
    pub radius: f64,
    pub length: f64,
    /// How deep its end is.
    pub depth: f64,
    pub refined: f64,
}

/// What is refined is all that it meets.
pub const PROBE: Probe = Probe {
    radius: 4.0,
    length: 20.0,
    depth: 1.0,
    refined: 10.0,
};
/// Faces of the probe.
const FACES: usize = 240;
/// Poses for which a local front is formed anew, and points of the path from one such stretch to
/// the next.
const STRETCH: usize = 4;
const EVERY: usize = 200;
/// Shares of the splits performed.
const PREFIXES: [f64; 3] = [0.03, 0.1, 0.3];

/// A front, and what the probe's query costs on it.
#[derive(Debug, Clone, Serialize)]
pub struct Level {
    /// The model.
    pub model: String,
    /// Faces of the full mesh.
    pub faces: u32,
    /// `coarse`, `prefix`, `local` or `full`.
    pub front: &'static str,
    /// Faces of the front, on average.
    pub front_faces: f64,
    /// Median, nanoseconds.
    pub p50_ns: f64,
    /// 99th of 100, nanoseconds.
    pub p99_ns: f64,
    /// Pairs of nodes visited, on average.
    pub node_pairs: f64,
    /// Pairs of faces tested, on average.
    pub face_pairs: f64,
    /// Pairs of nodes visited where the tree is built anew over the front by median splits, on
    /// average; 0 where it was not asked for.
    pub node_pairs_rebuilt: f64,
}

/// Sums over the poses.
#[derive(Default)]
struct Sums {
    timed: Timed,
    work: PairWork,
    rebuilt: PairWork,
    front_faces: f64,
    poses: f64,
}

impl Sums {
    fn level(self, model: &Model, front: &'static str) -> Level {
        let mut ns = self.timed.ns;
        sort(&mut ns);
        Level {
            model: model.name.clone(),
            faces: model.file.model_header().faces,
            front,
            front_faces: self.front_faces / self.poses,
            p50_ns: quantile(&ns, 0.5),
            p99_ns: quantile(&ns, 0.99),
            node_pairs: f64::from(self.work.node_pairs) / self.poses,
            face_pairs: f64::from(self.work.faces) / self.poses,
            node_pairs_rebuilt: f64::from(self.rebuilt.node_pairs) / self.poses,
        }
    }

    /// Adds a stretch of the poses on a front; `rebuilt` is a tree over its faces made anew. On
    /// every front each stretch begins behind the poses before it, since what forms a front, or
    /// counts, leaves its faces in the caches.
    fn add(
        &mut self,
        surface: Surface<'_>,
        probe: &mut Tool,
        (all, stretch): (&[Touch], Range<usize>),
        rebuilt: Option<&Tool>,
    ) {
        let mut out = vec![FacePair::NONE; MAX_PAIRS];
        let mut query = |k: usize| ours(surface, probe, &all[k].to_query, &mut out);
        let timed = time_stretch(Caches::AsLeft, stretch.clone(), STRETCH, &mut query);
        self.timed.extend(timed);
        let poses = &all[stretch];
        for touch in poses {
            probe.place(&touch.to_query);
            self.work
                .add(all_pairs(&surface, &*probe, u32::MAX, &mut out).work);
            if let Some(rebuilt) = rebuilt {
                self.rebuilt
                    .add(all_pairs(rebuilt, &*probe, u32::MAX, &mut out).work);
            }
        }
        self.front_faces += f64::from(surface.mesh.active_faces()) * poses.len() as f64;
        self.poses += poses.len() as f64;
    }
}

/// Mean length of the edges of triangles.
fn mean_edge(full: &Full) -> f64 {
    let triangles = full.triangles();
    let lengths = triangles
        .iter()
        .map(|[a, b, c]| a.distance(*b) + b.distance(*c) + c.distance(*a));
    lengths.sum::<f64>() / (3 * triangles.len()) as f64
}

/// The tree built anew over the faces of a front.
fn rebuilt(model: &Model, surface: Surface<'_>) -> Result<Tool, Failure> {
    let (_, corners) = active_triangles(surface.mesh);
    let faces = corners.len() as u32;
    let mesh = ToolMesh {
        positions: corners.into_iter().flatten().collect(),
        triangles: (0..faces).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
    };
    new_tool(model, &mesh)
}

/// The places of so many poses, a stretch after the other.
fn stretches(poses: usize) -> impl Iterator<Item = Range<usize>> {
    let starts = (0..poses).step_by(STRETCH);
    starts.map(move |start| start..(start + STRETCH).min(poses))
}

/// The levels of a model.
///
/// # Errors
/// When a region cannot be loaded.
pub fn levels(
    model: &Model,
    full: &Full,
    full_front: &FullFront,
    with: Probe,
    random: &mut impl Rng,
) -> Result<Vec<Level>, Failure> {
    let edge = mean_edge(full);
    let (length, depth) = (with.length * edge, with.depth * edge);
    let mut probe = new_tool(model, &cylinder_mesh(with.radius * edge, length, FACES))?;
    let poses: Vec<Touch> = touches(model, full, random)
        .chunks(EVERY)
        .flat_map(|some| some.iter().take(STRETCH))
        .filter_map(|&at| Touch::new(at, length, depth))
        .collect();
    let mut levels = Vec::new();
    for (name, share) in [("coarse", 0.0)]
        .into_iter()
        .chain(PREFIXES.map(|s| ("prefix", s)))
    {
        let splits = (share * model.records.len() as f64) as usize;
        let front = FullFront::prefix(model, splits)?;
        let anew = rebuilt(model, front.surface())?;
        let mut sums = Sums::default();
        for stretch in stretches(poses.len()) {
            sums.add(front.surface(), &mut probe, (&poses, stretch), Some(&anew));
        }
        levels.push(sums.level(model, name));
    }
    let mut front = LocalFront::new(model)?;
    let mut sums = Sums::default();
    for stretch in stretches(poses.len()) {
        refine(&poses[stretch.clone()], with.refined * edge, &mut front)?;
        let surface = Surface {
            mesh: front.cache().mesh(),
            tree: front.cache().tree(),
        };
        sums.add(surface, &mut probe, (&poses, stretch), None);
    }
    levels.push(sums.level(model, "local"));
    let mut sums = Sums::default();
    for stretch in stretches(poses.len()) {
        sums.add(full_front.surface(), &mut probe, (&poses, stretch), None);
    }
    levels.push(sums.level(model, "full"));
    Ok(levels)
}

/// What grows faster than the logarithm of the full mesh, in words: the query on the refined front,
/// over shapes of one family.
pub fn broken(growth: &[Level]) -> Vec<String> {
    let local = || growth.iter().filter(|level| level.front == "local");
    let (Some(first), Some(last)) = (
        local().min_by_key(|level| level.faces),
        local().max_by_key(|level| level.faces),
    ) else {
        return Vec::new();
    };
    let allowed = f64::from(last.faces).ln() / f64::from(first.faces).ln();
    let grown = [
        ("time", last.p50_ns / first.p50_ns),
        ("pairs of nodes", last.node_pairs / first.node_pairs),
    ];
    // What is no number keeps no limit.
    let is_kept = |grown: f64| grown <= allowed;
    let beyond = grown.into_iter().filter(|&(_, grown)| !is_kept(grown));
    beyond
        .map(|(what, grown)| {
            format!(
                "from {} to {} faces the {what} of a probe's query on the refined front grew by {grown:.2}, at most \
                 {allowed:.2} is allowed",
                first.faces, last.faces
            )
        })
        .collect()
}

/// That nothing was judged by growth, in words; nothing where something was.
pub fn skipped(growth: &[Level]) -> Option<&'static str> {
    let mut sizes: Vec<u32> = growth.iter().map(|level| level.faces).collect();
    sizes.sort_unstable();
    sizes.dedup();
    (sizes.len() < 2).then_some(
        "no limit of growth is judged: it takes two sizes or more (--growth 16000 has two)",
    )
}

/// The table of the terminal.
pub fn words<'a>(levels: impl Iterator<Item = &'a Level>) -> String {
    let heads = "probe against | front | faces | of front | p50 ns | p99 ns | node pairs | \
        face pairs | rebuilt";
    let mut table = Table::new(2, heads);
    for row in levels {
        table.row([
            row.model.clone(),
            row.front.to_string(),
            row.faces.to_string(),
            format!("{:.0}", row.front_faces),
            grouped(row.p50_ns.round() as u64),
            grouped(row.p99_ns.round() as u64),
            format!("{:.1}", row.node_pairs),
            format!("{:.1}", row.face_pairs),
            if row.node_pairs_rebuilt > 0.0 {
                format!("{:.1}", row.node_pairs_rebuilt)
            } else {
                String::new()
            },
        ]);
    }
    format!("\n{table}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pose_is_in_one_stretch() {
        let all: Vec<Range<usize>> = stretches(2 * STRETCH + 1).collect();
        assert!(
            all.iter()
                .all(|of| of.len() <= STRETCH && of.start % STRETCH == 0)
        );
        let poses: Vec<usize> = all.into_iter().flatten().collect();
        assert_eq!(poses, (0..=2 * STRETCH).collect::<Vec<_>>());
        assert_eq!(stretches(0).count(), 0);
    }

    #[test]
    fn what_grows_faster_than_the_logarithm_is_told() {
        let level = |faces, p50_ns, node_pairs| Level {
            model: "m".to_string(),
            faces,
            front: "local",
            front_faces: 1.0,
            p50_ns,
            p99_ns: p50_ns,
            node_pairs,
            face_pairs: 1.0,
            node_pairs_rebuilt: 0.0,
        };
        let first = level(1000, 100.0, 50.0);
        // Twice the logarithm.
        let good = level(1_000_000, 190.0, 99.0);
        assert_eq!(broken(&[good.clone(), first.clone()]), [""; 0]);
        assert_eq!(
            broken(&[first.clone(), level(1_000_000, 210.0, 99.0)]).len(),
            1
        );
        let no_number = level(1_000_000, f64::NAN, 99.0);
        assert_eq!(broken(&[first.clone(), no_number]).len(), 1);
        // Nothing grew over one size.
        let same = [first.clone(), level(1000, 300.0, 90.0)];
        for one_size in [&same[..0], &same[..1], &same] {
            assert!(skipped(one_size).is_some_and(|text| text.contains("two sizes")));
        }
        assert_eq!(skipped(&[first.clone(), good]), None);
        assert_eq!(broken(&[first, level(1_000_000, 210.0, 101.0)]).len(), 2);
        assert_eq!(broken(&[]), [""; 0]);
    }
}
