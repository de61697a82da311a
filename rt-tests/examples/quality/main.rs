//! How near a simplified mesh stays to the full one, beside meshoptimizer's simplifier at equal
//! numbers of faces: `cargo run --release -p rt-tests --example quality -- MESH…`
//!
//! A program of its own, so that no C++ library is part of `rt-tests`, whose memory is locked while
//! it ticks.
//!
//! Ours is a prefix of the sequence of splits (the continuous detail of thesis chapter 3); it must
//! refine back to the full mesh by splits that do not wait long for each other, which costs quality
//! that a simplifier which only aims at one mesh need not pay. The deviation is sampled in both
//! directions, on the same number of points for both, and given in parts of the diagonal.

mod welded;

use clap::Parser;
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rt_tests::failure::Failure;
use rt_tests::models::surface::Surface;
use rt_tests::models::{Model, active_triangles};
use rt_tests::report::output::{print, print_json};
use serde::Serialize;
use spm::OperationFaces;
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use welded::Welded;

/// Parts of the full mesh's faces at which the two are compared.
const SHARES: [f64; 4] = [0.5, 0.2, 0.05, 0.01];
/// A mesh with fewer faces has no room for four levels.
const FEWEST_FACES: u32 = 500;
/// Points in each direction.
const SAMPLES: u32 = 20_000;
/// What the rounding of positions to f32 alone makes, in parts of the diagonal: a plane deviates no
/// less.
const ROUNDING: f64 = 1e-7;
/// The most that the mean deviation at the median model may be of meshoptimizer's.
const MAX_MEAN_RATIO: f64 = 1.0;
/// The most that the largest deviation at the median model may be of meshoptimizer's.
const MAX_MAX_RATIO: f64 = 1.5;

/// Compare simplified meshes with meshoptimizer's at equal numbers of faces; status 1 when a limit
/// is broken.
#[derive(Debug, Parser)]
pub struct Arguments {
    /// Mesh files [default: the shapes that ve-station generate makes]
    pub models: Vec<PathBuf>,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
    /// Seed of the sampled points
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Quality {
    /// Seed of the sampled points.
    pub seed: u64,
    /// One a mesh.
    pub models: Vec<ModelQuality>,
    /// Meshes that were left out, too small to compare.
    pub left_out: Vec<String>,
    /// Ours over theirs, mean deviation, at the median model.
    pub mean_ratio_median: f64,
    /// Ours over theirs, largest deviation, at the median model.
    pub max_ratio_median: f64,
    /// Ours over theirs, largest deviation, at the worst model.
    pub max_ratio_worst: f64,
    /// Whether both medians are within their limits.
    pub pass: bool,
}

/// One mesh.
#[derive(Debug, Serialize)]
pub struct ModelQuality {
    /// The mesh.
    pub model: String,
    /// Faces of the full mesh.
    pub faces: u32,
    /// Ours over theirs, mean deviation: the mean over the points.
    pub mean_ratio: f64,
    /// Ours over theirs, largest deviation: the mean over the points.
    pub max_ratio: f64,
    /// One a number of faces.
    pub points: Vec<Point>,
}

/// Both at one number of faces.
#[derive(Debug, Serialize)]
pub struct Point {
    /// Part of the full mesh's faces that was asked for.
    pub share: f64,
    /// Faces of ours.
    pub faces: u32,
    /// Faces of theirs; more than asked for where it found no further collapse.
    pub faces_theirs: u32,
    /// Ours.
    pub ours: Deviation,
    /// Theirs.
    pub theirs: Deviation,
}

/// Sampled distance between two meshes, both directions, in parts of the diagonal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Deviation {
    /// Mean of the two directions' means.
    pub mean: f64,
    /// The largest found; every vertex of both meshes is looked at.
    pub max: f64,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(_) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.status())
        }
    }
}

/// Compares, says what it found, and judges.
///
/// # Errors
/// One sentence: status 2 for a bad file, 1 when a limit is broken.
fn run(args: &Arguments) -> Result<Quality, Failure> {
    let mut found = Quality {
        seed: args.seed,
        models: Vec::new(),
        left_out: Vec::new(),
        mean_ratio_median: 0.0,
        max_ratio_median: 0.0,
        max_ratio_worst: 0.0,
        pass: false,
    };
    let mut take = |name: &str, compared: Option<ModelQuality>| match compared {
        Some(model) => {
            eprint!("{}", words(&model));
            found.models.push(model);
        }
        None => found.left_out.push(name.to_string()),
    };
    if args.models.is_empty() {
        for (shape, name) in Shape::ALL {
            let built = |base_faces| {
                let options = options(base_faces);
                Model::build(
                    name.to_string(),
                    generate(shape, 40_000, 1),
                    &options,
                    &NoProgress,
                )
                .map_err(|error| Failure::Run(error.to_string()))
            };
            take(name, compare(built, args.seed)?);
        }
    }
    for path in &args.models {
        let built = |base_faces| Model::open(path, &options(base_faces), &NoProgress);
        take(&path.display().to_string(), compare(built, args.seed)?);
    }
    let of = |ratio: fn(&ModelQuality) -> f64| {
        let mut all: Vec<f64> = found.models.iter().map(ratio).collect();
        all.sort_unstable_by(f64::total_cmp);
        all
    };
    let (means, maxima) = (of(|m| m.mean_ratio), of(|m| m.max_ratio));
    found.mean_ratio_median = median(&means);
    found.max_ratio_median = median(&maxima);
    found.max_ratio_worst = maxima.last().copied().unwrap_or(0.0);
    found.pass =
        found.mean_ratio_median <= MAX_MEAN_RATIO && found.max_ratio_median <= MAX_MAX_RATIO;
    let summary = format!(
        "ours over theirs at the median of {} meshes: mean {:.3} (at most {MAX_MEAN_RATIO}), largest {:.3} (at most {MAX_MAX_RATIO}; worst mesh {:.3})\n",
        found.models.len(),
        found.mean_ratio_median,
        found.max_ratio_median,
        found.max_ratio_worst
    );
    if args.json {
        eprint!("{summary}");
        print_json(&found)?;
    } else {
        print(&summary)?;
    }
    if found.pass || found.models.is_empty() {
        return Ok(found);
    }
    Err(Failure::Run(
        "a prefix of ours deviates more than meshoptimizer's simplifier by more than the limit"
            .to_string(),
    ))
}

/// Middle of sorted numbers; 0 of none.
fn median(sorted: &[f64]) -> f64 {
    match sorted.len() {
        0 => 0.0,
        n => (sorted[(n - 1) / 2] + sorted[n / 2]) * 0.5,
    }
}

fn options(base_faces: Option<u32>) -> BuildOptions {
    BuildOptions {
        base_faces,
        regions: None,
    }
}

/// Compares at every share; `None` for a mesh that is too small.
fn compare(
    built: impl Fn(Option<u32>) -> Result<Model, Failure>,
    seed: u64,
) -> Result<Option<ModelQuality>, Failure> {
    let mut model = built(None)?;
    let faces = model.file.model_header().faces;
    if faces < FEWEST_FACES {
        return Ok(None);
    }
    let fewest = (f64::from(faces) * SHARES[SHARES.len() - 1]) as u32;
    if model.file.model_header().base_faces > fewest {
        model = built(Some(fewest))?;
    }
    let diagonal = model.file.model_header().diagonal;
    let full = Surface::new(model.full_triangles());
    let welded = Welded::new(full.triangles());
    let mut points = Vec::new();
    for share in SHARES {
        let mut theirs = welded.simplify((f64::from(faces) * share) as u32);
        let ours = prefix(&model, theirs.len() as u32)?;
        if ours.len() > theirs.len() {
            // The base mesh has more: no further collapse was legal.
            theirs = welded.simplify(ours.len() as u32);
        }
        if theirs.is_empty() {
            continue;
        }
        // The same points of the full mesh for both.
        let deviation = |triangles: Vec<[DVec3; 3]>| {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
            deviation(&full, &Surface::new(triangles), diagonal, &mut random)
        };
        points.push(Point {
            share,
            faces: ours.len() as u32,
            faces_theirs: theirs.len() as u32,
            ours: deviation(ours),
            theirs: deviation(theirs),
        });
    }
    // Not their geometric mean: at the one point where ours is exact it would be nothing, whatever
    // the others.
    let ratio = |of: fn(&Deviation) -> f64| {
        let sum: f64 = points
            .iter()
            .map(|p| of(&p.ours) / of(&p.theirs).max(ROUNDING))
            .sum();
        sum / points.len().max(1) as f64
    };
    Ok(Some(ModelQuality {
        mean_ratio: ratio(|d| d.mean),
        max_ratio: ratio(|d| d.max),
        model: model.name,
        faces,
        points,
    }))
}

/// The longest prefix of the sequence with no more than so many faces; the base mesh if it has more
/// already.
fn prefix(model: &Model, faces: u32) -> Result<Vec<[DVec3; 3]>, Failure> {
    let mut mesh = model.active_mesh();
    let mut out = OperationFaces::new();
    for record in &model.records {
        if mesh.active_faces() + 1 + u32::from(record.has_right_face()) > faces {
            break;
        }
        mesh.split(record.i, &mut out)
            .map_err(|error| Failure::Run(format!("{}: {error}", model.name)))?;
    }
    Ok(active_triangles(&mesh).1)
}

/// Sampled deviation of a simplified mesh from the full one.
fn deviation(full: &Surface, simple: &Surface, diagonal: f64, random: &mut impl Rng) -> Deviation {
    let mut sum = [0.0; 2];
    let mut max: f64 = 0.0;
    for (direction, (from, to)) in [(full, simple), (simple, full)].into_iter().enumerate() {
        let points = from.spread(SAMPLES, random);
        let mut hint = 0;
        for &(_, point) in &points {
            let near = to.nearest(point, hint);
            hint = near.triangle;
            sum[direction] += near.distance / points.len() as f64;
            max = max.max(near.distance);
        }
        for &corner in from.triangles().as_flattened() {
            let near = to.nearest(corner, hint);
            hint = near.triangle;
            max = max.max(near.distance);
        }
    }
    Deviation {
        mean: (sum[0] + sum[1]) * 0.5 / diagonal,
        max: max / diagonal,
    }
}

fn words(model: &ModelQuality) -> String {
    let mut text = format!(
        "{} ({} faces): ours over theirs, mean {:.3}, largest {:.3}\n",
        model.model, model.faces, model.mean_ratio, model.max_ratio
    );
    for point in &model.points {
        let _ = writeln!(
            text,
            "  {:>4.0} %  {:>7} | {:>7} faces   mean {:.2e} | {:.2e}   largest {:.2e} | {:.2e} of the diagonal",
            point.share * 100.0,
            point.faces,
            point.faces_theirs,
            point.ours.mean,
            point.theirs.mean,
            point.ours.max,
            point.theirs.max
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_is_compared_at_every_share_and_a_missing_file_is_bad_input() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = folder.path().join("sphere.obj");
        let mut text = String::new();
        let sphere = generate(Shape::Sphere, 4000, 1);
        for [x, y, z] in &sphere.positions {
            let _ = writeln!(text, "v {x} {y} {z}");
        }
        for face in &sphere.triangles {
            let [a, b, c] = face.map(|corner| corner + 1);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        std::fs::write(&mesh, text).unwrap();
        let arguments = |model: PathBuf| Arguments {
            models: vec![model],
            json: true,
            seed: 1,
        };
        let found = run(&arguments(mesh)).unwrap();
        let points = &found.models[0].points;
        assert_eq!(points.len(), SHARES.len());
        assert!(points.iter().all(|p| p.faces <= p.faces_theirs));
        assert!(
            points
                .iter()
                .all(|p| p.ours.mean > 0.0 && p.theirs.mean > 0.0)
        );
        // Coarser is farther off, for both.
        let grows = |of: fn(&Point) -> f64| points.windows(2).all(|p| of(&p[0]) < of(&p[1]));
        assert!(grows(|p| p.ours.mean) && grows(|p| p.theirs.mean));

        let nowhere = run(&arguments(folder.path().join("nowhere.obj"))).unwrap_err();
        assert_eq!(nowhere.status(), 2);
        assert!(nowhere.to_string().contains("nowhere.obj"));
    }
}
