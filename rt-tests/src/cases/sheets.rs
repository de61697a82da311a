//! Nothing is thin, sharp or broken enough to be passed.

use super::bench::{Bench, Response, model, parts, spm};
use super::case::{Case, Found, ProbeOfCase, Size, Trial, positive};
use super::setup::Setup;
use super::shapes;
use crate::failure::Failure;
use crate::models::surface::{Surface, unit};
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::record::max_or_nan;
use mutants::Mutant;
use rand_xoshiro::Xoshiro256PlusPlus;
use spm_builder::generate::{Shape, generate};

/// Parameters of the thin sheet in the list of facts.
const THIN: &str = "t = 0, 0.1, 1 mm; 0.05, 0.5, 1, 2 m/s; K = 0.5, 1, 3 kN/m; a million passes; full \
                    resolution, and coarse with R < t/2";

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: THIN,
        runs: "the same t, v, K; flat, at full resolution, from either side, within 60 degrees",
        ..Case::of(
            [
                "thin-sheet",
                "4",
                "passes through sheets of 0, 0.1 and 1 mm",
            ],
            0.0,
            Mutant::Sweep,
            thin_sheet,
        )
    },
    Case {
        facts: THIN,
        runs: "the same t, v, K; a waved sheet of 16 thousand faces, refined under the probe",
        ..Case::of(
            [
                "thin-sheet-refined",
                "4",
                "passes through a waved sheet that is refined meanwhile",
            ],
            0.0,
            Mutant::Sweep,
            thin_refined,
        )
    },
    Case {
        facts: THIN,
        runs: "t = 1 mm; a waved sheet of 20 mm, tolerances of 1 and 3 um; passes with R < t/2 count",
        ..Case::of(
            [
                "thin-sheet-coarse",
                "4",
                "passes through the waved sheet on a coarse front",
            ],
            0.0,
            Mutant::Sweep,
            thin_coarse,
        )
    },
    Case {
        facts: THIN,
        runs: "as thin-sheet, a capsule upright",
        probe: ProbeOfCase::Tool,
        ..Case::of(
            [
                "thin-sheet-tool",
                "4",
                "passes of a tool through sheets of 0, 0.1 and 1 mm",
            ],
            0.0,
            Mutant::ToolPairs,
            thin_sheet,
        )
    },
    Case {
        facts: "rays exactly at edges and vertices, turned at random, 1 km off; a million",
        runs: "the same; balls of 0.1 um and 1 mm at 0.5 m/s, straight and slanted by up to 60 degrees",
        ..Case::of(
            [
                "edges-and-vertices",
                "5",
                "passes through a body at edges and vertices",
            ],
            0.0,
            Mutant::Sweep,
            edges_and_vertices,
        )
    },
    Case {
        facts: "zero area, duplicate, sliver of 1e6, NaN, non-manifold, flipped, 1 um crack, hole",
        runs: "the same but a hole, on a plate, whole and refined, 0.5 m/s; what the builder drops is counted by \
               kind, what it cuts at all",
        ..Case::of(
            [
                "damaged-mesh",
                "11",
                "passes through a damaged mesh, no numbers, wrong counts",
            ],
            0.0,
            Mutant::Rejects,
            damaged_mesh,
        )
    },
    Case {
        facts: "1-2 m/s into a coarse region; error <= bound; onset error logged",
        runs: "1-2 m/s into a relief of 50 000 faces",
        ..Case::of(
            [
                "prediction-miss",
                "16",
                "true error over its bound on a coarse front",
            ],
            1.0,
            Mutant::Certified,
            prediction_miss,
        )
    },
];

/// Speeds of a pass, m/s.
const SPEEDS: [f64; 4] = [0.05, 0.5, 1.0, 2.0];
/// Acceleration to it, m/s²: what a hand may do to a device, but for rounding.
const PASS_M_PER_S2: f64 = 2000.0 * (1.0 - 1e-9);
/// How deep a pass goes behind the surface, metres.
const DEPTH_M: f64 = 5e-3;

/// Straight from one place to another at a speed, as soon as a hand can have it, with a look at
/// every tick.
fn pass(bench: &mut Bench, from: DVec3, to: DVec3, speed: f64, mut look: impl FnMut(&Response)) {
    let period = bench.period_s();
    let length = from.distance(to);
    let step = length / (length / (speed * period)).ceil().max(1.0);
    let gain = PASS_M_PER_S2 * period * period;
    let (mut moved, mut way) = (0.0, 0.0);
    // But for rounding; the last step may lead beyond.
    while way < length * (1.0 - 1e-9) {
        moved = f64::min(moved + gain, step);
        way += moved;
        look(&bench.touch(from.lerp(to, way / length)));
    }
}

/// Whether a tick of a pass that ends within a body has a force: a proxy that stays outside is felt
/// by nobody without one.
fn pushes(response: &Response) -> bool {
    response.force.length() > 0.0
}

/// A random place on a disc around the origin, and a random way down, within 60 degrees.
fn aim(random: &mut Xoshiro256PlusPlus, radius: f64) -> (DVec3, DVec3) {
    let mut on_disc = || {
        let (turn, r) = (std::f64::consts::TAU * unit(random), unit(random).sqrt());
        DVec3::new(turn.cos(), turn.sin(), 0.0) * r
    };
    let place = on_disc() * radius;
    let slope = on_disc() * 3f64.sqrt();
    (place, (slope - DVec3::Z).normalize())
}

/// Case 4: passes through a sheet of 0, 0.1 and 1 mm from either side at 0.05 to 2 m/s: those after
/// which the proxy was beyond it at any tick.
fn thin_sheet(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for thickness in [0.0, 1e-4, 1e-3] {
        let gap = thickness * UNITS / defaults.size_m;
        let bytes = model(shapes::sheets(gap), true)?;
        let sheet = Sheet {
            thickness,
            height: |_, _| 0.0,
            lower: 0.0,
            certified: None,
        };
        // With the other sheets a million.
        let full = if defaults.length_m.is_some() {
            250_000
        } else {
            500_000
        };
        let count = size.of(160, full / 18);
        sheet.pass_each(&bytes, (defaults, 0.0), count, random, &mut found)?;
    }
    Ok(found)
}

/// The same through a waved sheet, which is refined under the probe.
fn thin_refined(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for thickness in [0.0, 1e-4, 1e-3] {
        let gap = thickness * UNITS / defaults.size_m;
        let bytes = model(shapes::waved_sheets(gap, 64), false)?;
        let sheet = Sheet {
            thickness,
            height: shapes::wave,
            lower: LOWER_ON_WAVE,
            certified: None,
        };
        let count = size.of(4, 200_000 / 18);
        sheet.pass_each(&bytes, (defaults, 0.0), count, random, &mut found)?;
    }
    // Where nothing is refined meanwhile, nothing is shown.
    let splits = found.logged.iter().find(|of| of.name == SPLITS);
    found.must(splits.is_some_and(|of| of.value > 0.0));
    Ok(found)
}

/// The same on a front that stays coarse: a pass counts where the certified error was below half
/// of the thickness, so that the two sides have not crossed.
fn thin_coarse(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let thickness = 1e-3;
    // A split or collapse moves a vertex by a face's side, so those are a sixth of the thickness.
    let setup = Setup {
        size_m: 0.02,
        ..defaults
    };
    let gap = thickness * UNITS / setup.size_m;
    let bytes = model(shapes::waved_sheets(gap, 128), false)?;
    for tolerance_m in [1e-6, 3e-6] {
        let sheet = Sheet {
            thickness,
            height: shapes::wave,
            lower: LOWER_ON_WAVE,
            certified: Some(0.5 * thickness),
        };
        let count = size.of(8, 50_000 / 12);
        sheet.pass_each(&bytes, (setup, tolerance_m), count, random, &mut found)?;
    }
    // Where no front was coarse, or every one too coarse, nothing is shown.
    let coarse = found.logged.iter().find(|of| of.name == COARSE);
    found.must(coarse.is_some_and(|of| of.value > 0.0));
    Ok(found)
}

/// Sides of a sheet, model units.
const UNITS: f64 = 2.0;
/// What is logged of a coarse front.
const COARSE: &str = "certified error of a pass that counts, m";
/// What is logged of a front that is refined.
const SPLITS: &str = "splits during a pass";

/// Share of its radius by which a ball may be within a surface and has not passed it.
const WITHIN: f64 = 1e-3;
/// The same of the end of a capsule: its 240 faces, 10 around and 6 from the end to the side, are
/// within it by up to 1 - cos(180/10 degrees) cos(90/12 degrees).
const WITHIN_CAPSULE: f64 = 0.058;
/// Share of its radius by which a ball on the waved sheet may be lower over a place than on a
/// plane: up to 0.034 where its slope is 0.15, and 0.011 since its faces of 3 mm are flat.
const LOWER_ON_WAVE: f64 = 0.05;
/// Most height over a place for a certified error: on slopes of 0.15 it is 1.15 times that.
const OVER_SLOPE: f64 = 1.2;

/// A sheet of two sides: the upper one has a height over each place, in units of a tenth of a
/// metre.
struct Sheet {
    thickness: f64,
    height: fn(f64, f64) -> f64,
    /// See [`LOWER_ON_WAVE`]; 0 where the sheet is flat and there as a whole.
    lower: f64,
    /// A pass counts while the certified error is below this, metres; `None` where every one does.
    certified: Option<f64>,
}

impl Sheet {
    /// The height of the middle between both sides, metres.
    fn middle(&self, place: DVec3, size_m: f64) -> f64 {
        let unit = size_m / UNITS;
        unit * (self.height)(place.x / unit, place.y / unit) - 0.5 * self.thickness
    }

    /// Whether a proxy that came from the side that is `up` has passed neither side of the sheet:
    /// on the other one it is within the first. Where a front is coarse, what is not touched may be
    /// anywhere, and what is touched is as far off as is certified; from half of the thickness on
    /// it is not known which side that is.
    fn keeps(&self, setup: &Setup, response: &Response, up: DVec3) -> bool {
        let Response { proxy, record, .. } = response;
        let half = 0.5 * self.thickness;
        let height = (proxy.z - self.middle(*proxy, setup.size_m)) * up.z;
        let error = record.certified_error_m;
        let is_known = self.lower == 0.0 || (record.contact_bounded && error < half);
        let within = setup.length_m.map_or(WITHIN, |_| WITHIN_CAPSULE);
        let touches = setup.radius_m * (1.0 - within - self.lower) - OVER_SLOPE * error;
        height > 0.0 && (!is_known || height - half >= touches)
    }

    /// Passes at every stiffness from either side at every speed.
    fn pass_each(
        &self,
        bytes: &[u8],
        (defaults, tolerance_m): (Setup, f64),
        count: u64,
        random: &mut Xoshiro256PlusPlus,
        found: &mut Found,
    ) -> Result<(), Failure> {
        for stiffness in [500.0, 1000.0, 3000.0] {
            let stiffness_n_per_m = stiffness * defaults.stiffer();
            for up in [DVec3::Z, DVec3::NEG_Z] {
                let setup = Setup {
                    stiffness_n_per_m,
                    ..defaults
                };
                let mut bench = Bench::new(bytes, setup)?;
                bench.turn(DQuat::from_rotation_arc(DVec3::Z, up));
                bench.ask(tolerance_m);
                bench.settle(up * 0.02)?;
                for k in 0..count {
                    let (place, direction) = aim(random, 0.3 * setup.size_m);
                    let speed = SPEEDS[k as usize % SPEEDS.len()];
                    self.pass_once(&mut bench, (place, direction * up.z, up), speed, found);
                }
            }
        }
        Ok(())
    }

    /// A pass at a place along a direction, from the side that is `up`.
    fn pass_once(
        &self,
        bench: &mut Bench,
        (place, direction, up): (DVec3, DVec3, DVec3),
        speed: f64,
        found: &mut Found,
    ) {
        let setup = *bench.setup();
        let middle = self.middle(place, setup.size_m);
        let surface = place + DVec3::Z * (middle + 0.5 * self.thickness * up.z);
        let start = surface - direction * (6.0 * setup.radius_m);
        bench.travel(start);
        let (mut keeps, mut certified, mut splits) = (true, 0.0, 0);
        let mut is_pushed = false;
        let end = surface + direction * DEPTH_M;
        pass(bench, start, end, speed, |response| {
            keeps &= self.keeps(&setup, response, up);
            certified = max_or_nan(certified, response.record.certified_error_m);
            splits += response.record.vsplits;
            is_pushed |= pushes(response);
        });
        found.must(is_pushed);
        found.log(SPLITS, f64::from(splits));
        // What is no number is no bound.
        if self.certified.is_none_or(|most| certified < most) {
            found.right(keeps);
            found.log(COARSE, certified);
        }
        bench.travel(place + up * 0.02);
    }
}

/// Case 5: passes straight at the edges and vertices of a closed body, turned at random and 1 km
/// away, of a ball that is as good as a ray and of one that is not: those after which the proxy was
/// within.
fn edges_and_vertices(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let mesh = generate(Shape::Sphere, 400, 1);
    let targets = targets(&mesh.positions, &mesh.triangles);
    let point = |v: u32| DVec3::from_array(mesh.positions[v as usize]);
    // The ball that is surely within: up to the nearest face.
    let faces = mesh.triangles.iter().map(|t| t.map(point));
    let within = faces.fold(f64::INFINITY, |least, [a, b, c]| {
        least.min((b - a).cross(c - a).normalize().dot(a).abs())
    });
    let bytes = model(mesh, true)?;
    for k in 0..size.of(4, 40) {
        let axis = aim(random, 1.0).1;
        let setup = Setup {
            radius_m: [1e-7, 1e-3][k as usize % 2],
            pose: Pose {
                position: aim(random, 1.0).1 * 1000.0,
                orientation: DQuat::from_axis_angle(axis, 6.0 * unit(random)),
            },
            ..defaults
        };
        let mut bench = Bench::new(&bytes, setup)?;
        let scale = 0.5 * setup.size_m;
        let least = (within * scale + setup.radius_m) * (1.0 - 1e-5);
        bench.settle(setup.pose.transform_point(DVec3::Z * 1.5 * scale))?;
        for pass_number in 0..size.of(100, 25_000) {
            let target = targets[(unit(random) * targets.len() as f64) as usize] * scale;
            let straight = -target.normalize();
            let slanted = DQuat::from_rotation_arc(DVec3::NEG_Z, straight) * aim(random, 1.0).1;
            let direction = if pass_number % 2 == 0 {
                straight
            } else {
                slanted
            };
            let [start, end] = [-0.2, 0.1].map(|share| {
                setup
                    .pose
                    .transform_point(target + direction * (share * scale))
            });
            // Around the body, never through it.
            bench.travel(setup.pose.transform_point(target * 1.5));
            bench.travel(start);
            let (mut keeps, mut is_pushed) = (true, false);
            pass(&mut bench, start, end, 0.5, |response| {
                keeps &= response.proxy.distance(setup.pose.position) >= least;
                is_pushed |= pushes(response);
            });
            found.right(keeps);
            found.must(is_pushed);
            bench.travel(setup.pose.transform_point(target * 1.5));
        }
    }
    Ok(found)
}

/// Vertices, and the middles of edges.
fn targets(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let point = |v: u32| DVec3::from_array(positions[v as usize]);
    let middles = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| (point(a) + point(b)) * 0.5);
    positions
        .iter()
        .map(|&p| DVec3::from_array(p))
        .chain(middles)
        .collect()
}

/// Case 11: passes through a plate with everything wrong that meshes have, but no hole: those after
/// which the proxy was beyond it, outputs that are no numbers, and kinds of damage of which the
/// builder counted another number than was put in. What it keeps as it is (slivers, turned faces, a
/// crack) it does not count; of edges of three faces it counts the vertices that the cut adds.
fn damaged_mesh(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for whole in [true, false] {
        let (mesh, damage) = shapes::damaged_plate();
        let built = parts(mesh, whole)?;
        let summary = &built.summary;
        found.right(summary.zero_area_faces == damage.zero_area);
        found.right(summary.duplicate_faces == damage.duplicates);
        found.right(summary.not_finite_faces == damage.not_finite);
        // Each of these faces has a vertex of its own that is no number.
        found.right(summary.not_finite_vertices == damage.not_finite);
        found.right(summary.out_of_range_faces == 0);
        found.right(summary.cut_vertices > 0);
        pass_damaged(size, (&spm(&built)?, defaults), random, &mut found)?;
    }
    Ok(found)
}

fn pass_damaged(
    size: &Size,
    (bytes, setup): (&[u8], Setup),
    random: &mut Xoshiro256PlusPlus,
    found: &mut Found,
) -> Result<(), Failure> {
    let mut bench = Bench::new(bytes, setup)?;
    let home = DVec3::Z * 0.02;
    bench.settle(home)?;
    for _ in 0..size.of(150, 50_000) {
        let (place, direction) = aim(random, 0.3 * setup.size_m);
        let start = place - direction * (4.0 * setup.radius_m);
        let (mut keeps, mut is_pushed) = (true, false);
        bench.travel(start);
        let end = place + direction * DEPTH_M;
        pass(&mut bench, start, end, 0.5, |response| {
            keeps &= response.force.is_finite() && response.proxy.z >= 0.0;
            is_pushed |= pushes(response);
        });
        found.right(keeps);
        found.must(is_pushed);
        bench.travel(home);
    }
    Ok(())
}

/// Case 16: true distance of the contact from the full mesh over its certified bound, the largest,
/// where the probe comes at 1 to 2 m/s on a front that is coarse yet. Logged: the same at the first
/// touch, as a force.
fn prediction_miss(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = defaults;
    let mesh = generate(Shape::Relief, 50_000, 1);
    let corner =
        |v: u32| DVec3::from_array(mesh.positions[v as usize].map(|x| f64::from(x as f32)));
    let full = Surface::new(mesh.triangles.iter().map(|t| t.map(corner)).collect());
    let bytes = model(mesh, false)?;
    let mut bench = Bench::new(&bytes, setup)?;
    bench.settle(DVec3::Z * setup.size_m)?;
    let mut found = Found::new(0.0);
    let mut coarse = 0;
    for _ in 0..size.of(120, 4000) {
        let direction = aim(random, 1.0).1 * if unit(random) < 0.5 { 1.0 } else { -1.0 };
        let speed = 1.0 + unit(random);
        let start = direction * setup.size_m;
        bench.travel(start);
        let ticks = (start.length() / (speed * bench.period_s())) as u32;
        let mut touched = false;
        for tick in 1..=ticks {
            let place = start * (1.0 - f64::from(tick) / f64::from(ticks));
            let response = bench.touch(place);
            let Some(at) = bench.contact() else {
                continue;
            };
            let unit_m = bench
                .controller()
                .frame()
                .map_or(f64::NAN, |of| of.metres_per_unit);
            let bound = response.record.certified_error_m / unit_m;
            coarse += u32::from(bound > 0.0);
            let apart = full.nearest(at, 0).distance;
            // Coordinates are rounded to f32: a bound of 0 holds up to that.
            let rounding = at.abs().max_element() * f64::from(f32::EPSILON);
            found.most(positive(apart - rounding) / (bound + rounding));
            if !std::mem::replace(&mut touched, true) {
                found.log(
                    "error of the first force, N",
                    apart * unit_m * setup.stiffness_n_per_m,
                );
            }
        }
        found.must(touched);
    }
    // Where it was fine everywhere nothing is shown.
    found.must(coarse > 0);
    Ok(found)
}

#[cfg(test)]
mod tests;
