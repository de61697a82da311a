use super::*;
use crate::testing::{Counted, model, model_bytes};
use spm::write_spm;
use spm_builder::generate::Shape;
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model, read_mesh};
use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::Ordering;

/// The ask of the acceptance runs, for a model as if it were 0.15 m long: 0.1 m/s, 2 mm deep, 1 mm
/// radius.
fn ask<D: AsRef<[u8]>>(file: &SpmFile<D>, seed: u64, seconds: f64) -> TourAsk {
    let header = file.model_header();
    let sides = DVec3::from_array(header.upper) - DVec3::from_array(header.lower);
    let unit = sides.max_element() / 0.15;
    TourAsk {
        seed,
        seconds,
        speed: 0.1 * unit,
        depth: 0.002 * unit,
        radius: 0.001 * unit,
        from: 0,
    }
}

fn walk<D: AsRef<[u8]>>(file: &SpmFile<D>, ask: TourAsk) -> Vec<(TourPoint, Leg)> {
    let mut tour = Tour::new(file, ask).unwrap();
    std::iter::from_fn(|| {
        let point = tour.next_point(file).unwrap()?;
        Some((point, tour.resampler.leg().unwrap()))
    })
    .collect()
}

fn distance<D: AsRef<[u8]>>(file: &SpmFile<D>, point: &TourPoint) -> f64 {
    let origin = DVec3::from_array(file.model_header().origin);
    let position = DVec3::from_array(point.position) - origin;
    let (_, closest) = file.closest_point(position).unwrap();
    closest.distance_squared.sqrt()
}

fn shapes() -> Vec<(Shape, SpmFile<Vec<u8>>)> {
    Shape::ALL
        .iter()
        .map(|&(shape, _)| (shape, model(shape, 6000, 8)))
        .collect()
}

#[test]
fn the_same_seed_gives_the_same_tour_and_another_one_another() {
    let file = model(Shape::Relief, 6000, 8);
    let tour = |seed| make_tour(&file, ask(&file, seed, 5.0)).unwrap();
    assert_eq!(tour(1), tour(1));
    assert_ne!(tour(1), tour(2));
}

/// The bits that this build must give on any machine; of the plate, since no function of a library
/// decides a bit of it.
#[test]
fn a_tour_is_the_same_bits_on_every_machine() {
    let file = model(Shape::Plate, 6000, 8);
    let points = make_tour(&file, ask(&file, 3, 20.0)).unwrap();
    let last = points.last().unwrap().position;
    let bits = last.map(|x| format!("{:016x}", x.to_bits()));
    let expected = ["3fc5e3cdf8b7d6a9", "3fe95fbb3184e43b", "bf8b4e81b4e81b4f"];
    assert_eq!(bits, expected, "{last:?}");
}

#[test]
fn a_step_is_a_small_part_of_a_touch_and_steps_of_two_tours_may_alternate() {
    for (shape, seed) in [(Shape::Relief, 1), (Shape::Terrain, 2), (Shape::Torus, 3)] {
        let (bytes, reads) = Counted::new(model_bytes(shape, 6000, 8));
        let file = SpmFile::open(bytes).unwrap();
        let reads = || reads.load(Ordering::Relaxed);
        let asks = [seed, seed + 10].map(|seed| ask(&file, seed, 20.0));
        let mut tours = asks.map(|ask| Tour::new(&file, ask).unwrap());
        let mut points = [Vec::new(), Vec::new()];
        let (mut most, mut before_first) = (0, 0);
        while !tours.iter().all(Tour::is_over) {
            for (tour, points) in tours.iter_mut().zip(&mut points) {
                let before = reads();
                let step = tour.step(&file).unwrap();
                most = most.max(reads() - before);
                match step {
                    Step::Point(point) => points.push(point),
                    _ if points.is_empty() => before_first += reads() - before,
                    _ => {}
                }
            }
        }
        println!("{shape}: {most} reads in a step, {before_first} before the first points");
        assert!(
            20 * most < before_first,
            "{shape}: {most} of {before_first}"
        );
        assert_eq!(points, asks.map(|ask| make_tour(&file, ask).unwrap()));
    }
}

#[test]
fn a_tour_is_as_long_as_asked_and_no_faster() {
    for (shape, file) in shapes() {
        for seconds in [0.001, 0.07, 1.0, 1.11, 12.3456] {
            let ask = ask(&file, 5, seconds);
            let points = make_tour(&file, ask).unwrap();
            assert_eq!(points[0].t, 0.0);
            assert_eq!(points.last().unwrap().t, seconds);
            for pair in points.windows(2) {
                let time = pair[1].t - pair[0].t;
                assert!(time > 0.0 && time <= TOUR_PERIOD_S * 1.000_001);
                let [a, b] = [0, 1].map(|k| DVec3::from_array(pair[k].position));
                assert!(
                    a.distance(b) <= ask.speed * time * 1.000_001,
                    "{shape}: {} in {time}",
                    a.distance(b)
                );
                let [w, x, y, z] = pair[1].orientation_wxyz;
                assert!((w * w + x * x + y * y + z * z - 1.0).abs() < 1e-9);
            }
        }
    }
}

/// The axis goes all round the models, so it also passes where it is opposite to where it began.
#[test]
fn a_tool_turns_as_its_axis_does_and_never_spins_about_it() {
    for (shape, file) in shapes() {
        let points = make_tour(&file, ask(&file, 4, 30.0)).unwrap();
        let turns = points.iter().map(|point| {
            let pose = Pose::from_wxyz(point.position, point.orientation_wxyz).unwrap();
            pose.orientation
        });
        let turns: Vec<DQuat> = turns.collect();
        for pair in turns.windows(2) {
            let [a, b] = [pair[0] * DVec3::Z, pair[1] * DVec3::Z];
            // The arc cosine of a product near 1 is good to the root of its rounding.
            let limit = a.angle_between(b) + 1e-7;
            assert!(pair[0].angle_between(pair[1]) <= limit, "{shape}: {a} {b}");
        }
    }
}

#[test]
fn free_ways_never_come_near_the_mesh() {
    for (shape, file) in shapes() {
        for seed in 0..3 {
            let ask = ask(&file, seed, 30.0);
            let ball = ball_radius(150.0 * ask.radius, ask.radius);
            let points = walk(&file, ask);
            assert!(points.iter().any(|(_, leg)| *leg == Leg::Free));
            for pair in points.windows(2) {
                if pair.iter().all(|(_, leg)| *leg == Leg::Free) {
                    let middle = TourPoint {
                        position: DVec3::from_array(pair[0].0.position)
                            .midpoint(DVec3::from_array(pair[1].0.position))
                            .to_array(),
                        ..pair[0].0
                    };
                    for point in [pair[0].0, middle] {
                        let distance = distance(&file, &point);
                        assert!(
                            distance > 0.45 * ball,
                            "{shape} {seed}: {distance} at {point:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn most_of_the_time_is_contact_and_it_begins_soon() {
    for (shape, file) in shapes() {
        for seed in 0..3 {
            let points = walk(&file, ask(&file, seed, 30.0));
            let contact = points.iter().filter(|(_, leg)| *leg == Leg::Slide).count();
            let share = contact as f64 / points.len() as f64;
            assert!(share > 0.6, "{shape} {seed}: {share}");
            let first = points
                .iter()
                .find(|(_, leg)| *leg == Leg::Slide)
                .unwrap()
                .0
                .t;
            assert!(first < 1.0, "{shape} {seed}: {first}");
        }
    }
}

#[test]
fn a_shallow_intent_slides_outside_at_radius_less_depth() {
    let file = model(Shape::Sphere, 20_000, 8);
    let ask = TourAsk {
        seed: 4,
        seconds: 20.0,
        speed: 0.5,
        depth: 0.01,
        radius: 0.05,
        from: 0,
    };
    let points = walk(&file, ask);
    let mut sliding = 0;
    for run in points.chunk_by(|a, b| a.1 == b.1) {
        if run[0].1 != Leg::Slide {
            continue;
        }
        // Not the pressing at the start and the lifting at the end.
        for (point, _) in run.iter().skip(40).take(run.len().saturating_sub(80)) {
            let height = DVec3::from_array(point.position).length() - 1.0;
            assert!((height - 0.04).abs() < 0.004, "{height}");
            sliding += 1;
        }
    }
    assert!(sliding > 1000);
}

#[test]
fn the_depth_of_the_intent_is_measured_from_the_surface() {
    let file = model(Shape::Relief, 20_000, 8);
    let ask = ask(&file, 2, 20.0);
    let mut distances: Vec<f64> = walk(&file, ask)
        .iter()
        .filter(|(_, leg)| *leg == Leg::Slide)
        .map(|(point, _)| distance(&file, point))
        .collect();
    distances.sort_by(f64::total_cmp);
    // A millimetre below the surface: the intent is deeper than the probe is wide.
    let median = distances[distances.len() / 2];
    let wanted = (ask.radius - ask.depth).abs();
    assert!(
        (median - wanted).abs() < 0.2 * wanted,
        "{median} instead of {wanted}"
    );
}

#[test]
fn on_an_open_sheet_a_slide_stays_on_its_side() {
    let file = model(Shape::Plate, 6000, 8);
    let ask = TourAsk {
        depth: 0.005,
        radius: 0.02,
        ..ask(&file, 9, 60.0)
    };
    let points = walk(&file, ask);
    let runs: Vec<_> = points.chunk_by(|a, b| a.1 == b.1).collect();
    let mut slides = 0;
    for pair in runs.windows(2) {
        let (before, run) = (pair[0], pair[1]);
        let from = before[before.len() - 1].0.position[2];
        // What begins beside the rim may take either side.
        if run[0].1 != Leg::Slide || from.abs() < 0.9 * ask.radius {
            continue;
        }
        for (point, _) in run {
            // It may begin to round the rim before it turns.
            let height = point.position[2] * from.signum();
            assert!(height > -0.5 * (ask.radius - ask.depth), "{point:?}");
        }
        slides += 1;
    }
    assert!(slides > 3, "{slides} slides");
}

#[test]
fn numbers_out_of_range_are_refused() {
    let file = model(Shape::Sphere, 1000, 4);
    let good = ask(&file, 1, 1.0);
    assert!(Tour::new(&file, good).is_ok());
    let with = |change: &dyn Fn(&mut TourAsk)| {
        let mut ask = good;
        change(&mut ask);
        let refused = Tour::new(&file, ask).map(|_| ()).unwrap_err();
        assert_eq!(refused.refusal(), Refusal::Tour);
        refused.to_string()
    };
    let says = |sentence: String, expected: &str| {
        assert!(sentence.contains(expected), "{sentence}");
        // No number that is fine is blamed.
        let names = ["seconds", "speed", "depth", "radius"];
        let named = names.iter().filter(|&&name| sentence.contains(name));
        assert_eq!(named.count(), 1, "{sentence}");
    };
    for bad in [f64::NAN, f64::INFINITY, -1.0, f64::NEG_INFINITY] {
        says(with(&|a| a.seconds = bad), &format!("it is {bad} seconds"));
        says(with(&|a| a.speed = bad), "its speed is");
        says(with(&|a| a.depth = bad), "its depth is");
        says(with(&|a| a.radius = bad), "its radius of the probe is");
    }
    says(with(&|a| a.speed = 0.0), "its speed is 0");
    says(with(&|a| a.speed = 1e300), "its speed is");
    says(with(&|a| a.seconds = 0.0), "it is 0 seconds");
    let header = file.model_header();
    let side = (DVec3::from_array(header.upper) - DVec3::from_array(header.lower)).max_element();
    says(with(&|a| a.speed = 20.1 * side), "and at most 20, or");
    // What a scene lets in, rounded in model units.
    let mut fastest = good;
    fastest.speed = (20.0 * side).next_up();
    assert!(Tour::new(&file, fastest).is_ok());
    says(with(&|a| a.radius = 1e9), "its radius of the probe is");
    // 2 mm of a model of 1.5 mm.
    says(
        with(&|a| a.depth = side * (2.0 / 1.5)),
        "its depth is 1.333e0 lengths of the model: make it at least 0 and at most 1",
    );
}

/// A sheet of 40 strips that rise and fall by 30 degrees, so that every second edge is concave.
fn folded_sheet() -> SpmFile<Vec<u8>> {
    let (columns, rows) = (40u32, 10u32);
    let mut mesh = SoupMesh::default();
    for j in 0..=rows {
        for i in 0..=columns {
            let height = f64::from(i % 2) * 0.05 / 3f64.sqrt();
            let position = [0.05 * f64::from(i), 0.1 * f64::from(j), height];
            mesh.positions.push(position);
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let a = j * (columns + 1) + i;
            let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let options = BuildOptions {
        base_faces: Some(100),
        regions: Some(4),
    };
    let parts = build_model(mesh, &options, &NoProgress).unwrap();
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).unwrap();
    SpmFile::open(bytes).unwrap()
}

/// Where it rolls from one face to the other its contact moves by the radius, twenty steps.
#[test]
fn a_slow_ball_rolls_through_a_concave_edge() {
    let file = folded_sheet();
    let header = file.model_header();
    let [lower, upper] = [header.lower, header.upper].map(DVec3::from_array);
    let ball = Ball {
        radius: 0.008,
        step: 0.0004,
        lower,
        upper,
    };
    let from = (lower + upper) * 0.5 + DVec3::new(0.02, 0.0, 0.04);
    let is_far = |seed: &u64| {
        let mut draw = Draw(Xoshiro256PlusPlus::seed_from_u64(*seed));
        let start = ball.touch(&file, from).unwrap().unwrap();
        let mut slide = Slide::new(&ball, start, 1.0, &mut draw);
        while slide.step(&ball, &file, &mut draw) {}
        let places = slide.into_path().into_iter().map(|of| of.surface.x);
        let ends = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = places.fold(ends, |(low, high), x| (low.min(x), high.max(x)));
        // Between two concave edges there is 0.1.
        high - low > 0.15
    };
    let far = (0..6u64).filter(is_far).count();
    assert!(far >= 4, "{far} of 6 slides get over a concave edge");
}

/// At 3 mm/s the height of a fast tour, an eighth of the model, would take 6 s.
#[test]
fn a_slow_tour_touches_soon_and_goes_on_touching() {
    for (shape, file) in shapes() {
        let (mut touching, mut all) = (0, 0);
        for seed in 0..3 {
            let fast = ask(&file, seed, 60.0);
            let slow = TourAsk {
                speed: 0.03 * fast.speed,
                ..fast
            };
            let points = walk(&file, slow);
            let mut slides = points.iter().filter(|(_, leg)| *leg == Leg::Slide);
            let first = slides.next().unwrap().0.t;
            assert!(first < 2.0, "{shape} {seed}: {first}");
            touching += 1 + slides.count();
            all += points.len();
        }
        let share = touching as f64 / all as f64;
        assert!(share > 0.2, "{shape}: {share} of the time in contact");
    }
}

#[test]
fn any_speed_ends() {
    let file = model(Shape::Torus, 2000, 4);
    for speed in [1e-300, 1e-9, 1.0, 50.0] {
        let points = make_tour(
            &file,
            TourAsk {
                speed,
                ..ask(&file, 1, 1.0)
            },
        )
        .unwrap();
        assert_eq!(points.len(), 201);
        assert!(
            points
                .iter()
                .all(|p| DVec3::from_array(p.position).is_finite())
        );
    }
}

#[test]
fn real_scans_are_toured_with_most_of_the_time_in_contact() {
    let folder = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/models"
    ));
    for name in ["stanford-bunny.obj", "terrain257.obj", "dragon25k.obj"] {
        let path = folder.join(name);
        if !path.exists() {
            let _ = writeln!(
                std::io::stderr(),
                "skipped: {} is not there",
                path.display()
            );
            continue;
        }
        let mesh = read_mesh(&path).unwrap();
        let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
        let mut bytes = Vec::new();
        write_spm(&parts, &mut bytes).unwrap();
        let file = SpmFile::open(bytes).unwrap();
        for seed in 0..4 {
            let points = walk(&file, ask(&file, seed, 20.0));
            let contact = points.iter().filter(|(_, leg)| *leg == Leg::Slide).count();
            let share = contact as f64 / points.len() as f64;
            println!("{name} seed {seed}: {share:.2} of the time in contact");
            assert!(share > 0.6, "{name} {seed}: {share}");
        }
    }
}
