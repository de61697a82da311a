//! Nodes of the tree that an update marks, beside the bound of Theorem 2 (thesis Figure 4.7), and
//! what an update takes beside what a tool's query takes (thesis 4.3.2).

use super::EVERY;
use super::closest::touches;
use super::full_front::FullFront;
use super::timing::time;
use super::tools::{
    MAX_PAIRS, STRETCH, TOOLS, Touch, capsule, new_tool, ours, refine, refined_reach,
};
use super::update::patch;
use crate::clocks::Clocks;
use crate::failure::Failure;
use crate::models::Model;
use crate::models::local_front::LocalFront;
use crate::models::surface::{Surface as Full, unit};
use crate::report::quantile::{quantile, sort};
use crate::report::table::Table;
use crate::report::units::grouped;
use ab_tree::AbTree;
use hrtc_core::contact::query::{FacePair, Surface, closest_point};
use hrtc_core::contact::tool::Tool;
use rand::Rng;
use serde::Serialize;
use spm::{ActiveMesh, Handle};

/// Times that so many faces are deformed: more often where it is soon done.
const MAX_UPDATES: usize = 200;
const MAX_FACES: usize = 400_000;
/// Shares of a front's faces whose update is compared with a query.
const SHARES: [f64; 3] = [0.01, 0.03, 0.1];
/// The most that an update may take of a query (thesis 4.3.2).
const MAX_SHARE: f64 = 0.15;
/// Of the stretches for which the tool's queries are measured, how many are taken here: one of so
/// many.
const SOME: usize = 10;

/// How the deformed faces lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Spread {
    /// Around one face, as splits deform them.
    Patch,
    /// Anywhere.
    Scattered,
    /// Evenly over the leaves: what marks most.
    Even,
}

impl Spread {
    pub const ALL: [Self; 3] = [Self::Patch, Self::Scattered, Self::Even];

    pub fn words(self) -> &'static str {
        match self {
            Self::Patch => "a patch",
            Self::Scattered => "scattered",
            Self::Even => "even",
        }
    }
}

/// An update of so many faces of a full mesh.
#[derive(Debug, Clone, Serialize)]
pub struct Marking {
    /// The model.
    pub model: String,
    /// Leaves of the tree: n.
    pub faces: u32,
    /// Leaves deformed: k.
    pub deformed: u32,
    /// How they lie.
    pub spread: Spread,
    /// The most nodes that one update marked and refitted, leaves and root among them.
    pub marked_max: u32,
    /// Theorem 2: k (ceil(log2 n) - floor(log2 k) + 2).
    pub bound: u64,
    /// Median of marking and refitting, nanoseconds.
    pub update_p50_ns: f64,
}

/// An update of a share of a local front's faces, beside a query of a tool that touches there.
#[derive(Debug, Clone, Serialize)]
pub struct UpdateShare {
    /// The model.
    pub model: String,
    /// The tool's task.
    pub task: &'static str,
    /// Median of the faces of the fronts.
    pub front_faces: f64,
    /// Share of them that was deformed, a patch around the contact.
    pub deformed_share: f64,
    /// Median of the update, nanoseconds.
    pub update_p50_ns: f64,
    /// Median of the query, nanoseconds.
    pub query_p50_ns: f64,
    /// The one over the other.
    pub share_p50: f64,
}

/// Theorem 2, in leaves; k from 1 to n.
pub fn bound(n: u32, k: u32) -> u64 {
    let ceil_log_n = u64::from(n.next_power_of_two().ilog2());
    u64::from(k) * (ceil_log_n - u64::from(k.ilog2()) + 2)
}

/// Marks and refits; the nodes refitted, the root among them.
fn update(tree: &mut AbTree, mesh: &ActiveMesh, faces: &[Handle]) -> u32 {
    for &face in faces {
        tree.deform(face);
    }
    tree.refit(|face| mesh.face_box(face)) + 1
}

/// Every number of deformed faces, a power of four, and all of them.
pub fn markings(model: &Model, front: &FullFront, random: &mut impl Rng) -> Vec<Marking> {
    let header = model.file.model_header();
    // Faces in the order of the leaves.
    let order: Vec<Handle> = (0..header.faces)
        .filter_map(|place| model.file.full_face(place).ok())
        .map(|full| full.face)
        .collect();
    let mut tree = front.surface().tree.clone();
    let clocks = Clocks::new();
    let n = order.len() as u32;
    let counts = (0..)
        .map(|power| 4u32.saturating_pow(power))
        .take_while(|&k| k < n);
    let mut rows = Vec::new();
    for k in counts.chain([n]) {
        let times = (MAX_FACES / k as usize).clamp(1, MAX_UPDATES);
        for spread in Spread::ALL {
            let (mut marked_max, mut ns) = (0, Vec::new());
            for _ in 0..times {
                let faces = chosen(front, &order, k, spread, random);
                let (taken, marked) = clocks.time(|| update(&mut tree, front.mesh(), &faces));
                marked_max = marked_max.max(marked);
                ns.push(taken);
            }
            rows.push(Marking {
                model: model.name.clone(),
                faces: n,
                deformed: k,
                spread,
                marked_max,
                bound: bound(n, k),
                update_p50_ns: median(ns),
            });
        }
    }
    rows
}

fn chosen(
    front: &FullFront,
    order: &[Handle],
    k: u32,
    spread: Spread,
    random: &mut impl Rng,
) -> Vec<Handle> {
    let n = order.len();
    let any = (unit(random) * n as f64) as usize;
    match spread {
        Spread::Patch => patch(front.mesh(), order, any, k as usize),
        Spread::Scattered => {
            let mut places: Vec<usize> = (0..n).collect();
            for at in 0..k as usize {
                let other = at + (unit(random) * (n - at) as f64) as usize;
                places.swap(at, other);
            }
            places.truncate(k as usize);
            places.into_iter().map(|place| order[place]).collect()
        }
        Spread::Even => (0..k as usize)
            .map(|at| order[(any + at * n / k as usize) % n])
            .collect(),
    }
}

/// What updates of local fronts take, beside a tool's query on the same fronts.
///
/// # Errors
/// When a region cannot be loaded.
pub fn shares(
    model: &Model,
    full: &Full,
    random: &mut impl Rng,
) -> Result<Vec<UpdateShare>, Failure> {
    let touching = touches(model, full, random);
    let mut rows = Vec::new();
    for kind in TOOLS {
        let (mesh, length, depth) = capsule(model, kind);
        let at = touching.iter().step_by(EVERY);
        let touches: Vec<Touch> = at.filter_map(|&at| Touch::new(at, length, depth)).collect();
        rows.extend(shares_of(
            model,
            kind.0,
            &mut new_tool(model, &mesh)?,
            &touches,
        )?);
    }
    Ok(rows)
}

fn shares_of(
    model: &Model,
    task: &'static str,
    tool: &mut Tool,
    touches: &[Touch],
) -> Result<Vec<UpdateShare>, Failure> {
    let mut out = vec![FacePair::NONE; MAX_PAIRS];
    let mut front = LocalFront::new(model)?;
    let reach = refined_reach(model);
    let (mut faces, mut queries) = (Vec::new(), Vec::new());
    let mut updates = SHARES.map(|_| Vec::new());
    for stretch in touches.chunks(STRETCH).step_by(SOME) {
        refine(stretch, reach, &mut front)?;
        let (mesh, tree) = (front.cache().mesh(), front.cache().tree());
        let surface = Surface { mesh, tree };
        let count = f64::from(mesh.active_faces());
        faces.push(count);
        let mut active = Vec::new();
        mesh.for_each_active_face(|face| active.push(face));
        let mut query = |k: usize| ours(surface, tool, &stretch[k].to_query, &mut out);
        queries.extend(time(stretch.len(), &mut [&mut query]).swap_remove(0).ns);
        let mut deformed = tree.clone();
        for (ns, share) in updates.iter_mut().zip(SHARES) {
            let around = |touch: &Touch| {
                let (nearest, _) = closest_point(surface, touch.point, None);
                let face = nearest.map(|nearest| nearest.face);
                let first = active.iter().position(|&active| Some(active) == face);
                first.map_or_else(Vec::new, |first| {
                    patch(mesh, &active, first, (share * count) as usize)
                })
            };
            let patches: Vec<_> = stretch.iter().map(around).collect();
            let mut update = |k: usize| f64::from(update(&mut deformed, mesh, &patches[k]));
            ns.extend(time(stretch.len(), &mut [&mut update]).swap_remove(0).ns);
        }
    }
    let row = |(ns, share): (Vec<f64>, f64)| {
        let (update_p50_ns, query_p50_ns) = (median(ns), median(queries.clone()));
        UpdateShare {
            model: model.name.clone(),
            task,
            front_faces: median(faces.clone()),
            deformed_share: share,
            update_p50_ns,
            query_p50_ns,
            share_p50: update_p50_ns / query_p50_ns,
        }
    };
    Ok(updates.into_iter().zip(SHARES).map(row).collect())
}

fn median(mut of: Vec<f64>) -> f64 {
    sort(&mut of);
    quantile(&of, 0.5)
}

/// What is beyond its limit, in words.
pub fn broken(markings: &[Marking], shares: &[UpdateShare]) -> Vec<String> {
    let marked = markings
        .iter()
        .filter(|row| u64::from(row.marked_max) > row.bound)
        .map(|row| {
            format!(
                "{}: an update of {} leaves marked {} nodes, at most {} are allowed",
                row.model, row.deformed, row.marked_max, row.bound
            )
        });
    // What is no number keeps no limit.
    let is_kept = |row: &UpdateShare| row.share_p50 <= MAX_SHARE;
    let slow = shares
        .iter()
        .filter(|&row| !is_kept(row))
        .map(|row| {
            format!(
                "{}, {}: an update of {:.0} % of the faces is {:.2} of the query, at most {MAX_SHARE} is allowed",
                row.model,
                row.task,
                100.0 * row.deformed_share,
                row.share_p50
            )
        });
    marked.chain(slow).collect()
}

/// The tables of the terminal.
pub fn words(markings: &[Marking], shares: &[UpdateShare]) -> String {
    let heads = "update of | spread | leaves | deformed | marked | theorem 2 | p50 ns";
    let mut updates = Table::new(2, heads);
    for row in markings {
        updates.row([
            row.model.clone(),
            row.spread.words().to_string(),
            row.faces.to_string(),
            row.deformed.to_string(),
            grouped(row.marked_max.into()),
            grouped(row.bound),
            grouped(row.update_p50_ns.round() as u64),
        ]);
    }
    let heads = "update beside query | task | faces | deformed | update ns | query ns | share";
    let mut beside = Table::new(2, heads);
    for row in shares {
        beside.row([
            row.model.clone(),
            row.task.to_string(),
            format!("{:.0}", row.front_faces),
            format!("{:.0}%", 100.0 * row.deformed_share),
            grouped(row.update_p50_ns.round() as u64),
            grouped(row.query_p50_ns.round() as u64),
            format!("{:.2}", row.share_p50),
        ]);
    }
    format!("\n{updates}\n{beside}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_that_of_theorem_2() {
        // One leaf of 1024: its path of eleven nodes, and one to spare.
        assert_eq!(bound(1024, 1), 12);
        assert_eq!(bound(1025, 1), 13);
        assert_eq!(bound(1000, 64), 64 * (10 - 6 + 2));
        // All leaves: twice as many nodes there are.
        assert_eq!(bound(1024, 1024), 2048);
    }

    #[test]
    fn what_is_beyond_a_limit_is_told() {
        let marking = |marked_max| Marking {
            model: "m".to_string(),
            faces: 1024,
            deformed: 1,
            spread: Spread::Even,
            marked_max,
            bound: 12,
            update_p50_ns: 1.0,
        };
        let share = |share_p50| UpdateShare {
            model: "m".to_string(),
            task: "t",
            front_faces: 1000.0,
            deformed_share: 0.1,
            update_p50_ns: share_p50,
            query_p50_ns: 1.0,
            share_p50,
        };
        assert_eq!(broken(&[marking(12)], &[share(0.15)]), [""; 0]);
        assert_eq!(broken(&[marking(13)], &[share(0.16)]).len(), 2);
        assert_eq!(broken(&[], &[share(f64::NAN)]).len(), 1);
    }
}
