//! No sheet is thin enough, no hand fast enough and no scale odd enough for the probe to get
//! through a surface, and the force there is that of a surface.
//!
//! The probe's poses are prescribed, without damping or limits: force over stiffness is the
//! displacement of the proxy from the probe, so the proxy's place is known from outside.

use crate::common::{World, plan, spm, station, world};
use geometry::{Pose, side_of_plane, solid_angle};
use glam::{DQuat, DVec3};
use haptic_device::Sample;
use hrtc_core::record::max_or_nan;
use scene::{ModelScale, ProbeShape, ScenePlan, TrajectoryPlan};
use simulator::{Client, ClientOptions, Random, STATION, Simulation};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, SoupMesh};
use std::cmp::Ordering;

/// Radius of the probe where the model is 1 m long.
const RADIUS: f64 = 0.005;
const STIFFNESS: f64 = 800.0;
/// Two metres a second for a model of 0.15 m, in shares of its size a tick.
const FASTEST: f64 = 0.0133;
/// Lengths of the model, metres.
const SIZES: [f64; 4] = [1e-3, 0.15, 1.0, 1e3];

/// A scene of one size; every length in it scales.
fn bare_plan(size: f64) -> ScenePlan {
    let mut plan = plan("");
    plan.objects[0].scale = ModelScale::Size(size);
    plan.objects[0].surface.stiffness_n_per_m = STIFFNESS;
    plan.objects[0].surface.damping_ns_per_m = 0.0;
    plan.probes[0].shape = ProbeShape::Sphere {
        radius_m: RADIUS * size,
    };
    plan.probes[0].trajectory = TrajectoryPlan::Points(Vec::new());
    plan.safety.force_max_n = 1e12;
    plan.safety.slew_n_per_s = 1e15;
    plan.safety.ramp_s = 0.0;
    plan.safety.passivity = false;
    // What a hand cannot tell is so many newtons, at any size.
    plan.accuracy.geomorph = false;
    plan
}

fn model(mesh: SoupMesh) -> Vec<u8> {
    spm(mesh, &BuildOptions::default())
}

/// A probe moved by hand; places are in shares of the model's size.
struct Probe {
    world: World,
    size: f64,
    place: DVec3,
}

impl Probe {
    /// With the model there, resting at a free place until the regions around are fine.
    fn new(model: &[u8], size: f64, place: DVec3) -> Self {
        let plan = bare_plan(size);
        let options = ClientOptions {
            device_max_n: 1e12,
            ..ClientOptions::default()
        };
        let station = station(&plan, model, STATION);
        let world = Simulation::new(station, Client::new(&plan, options));
        let mut probe = Self { world, size, place };
        for _ in 0..300 {
            probe.to(place);
        }
        assert!(probe.world.summary().last.ready && !probe.world.summary().last.contact);
        probe
    }

    /// One tick with the probe there; where the proxy is then.
    fn to(&mut self, place: DVec3) -> DVec3 {
        self.place = place;
        let pose = Pose::at(place * self.size);
        self.world.step(Some(Sample::at(pose)));
        place + self.world.force() / (STIFFNESS * self.size)
    }

    /// Straight to a place at a speed (shares of the size a tick), with a look at every proxy.
    fn move_to(&mut self, place: DVec3, speed: f64, mut look: impl FnMut(DVec3, &World)) {
        let from = self.place;
        let ticks = (from.distance(place) / speed).ceil().max(1.0) as u32;
        for tick in 1..=ticks {
            let proxy = self.to(from.lerp(place, f64::from(tick) / f64::from(ticks)));
            look(proxy, &self.world);
        }
    }
}

/// A hand that stabs and rubs: moves through the surface at up to 2 m/s for a model of 0.15 m.
fn stab(probe: &mut Probe, above: DVec3, spread: f64, look: &mut impl FnMut(DVec3, &World)) {
    let mut random = Random::new(11);
    let home = probe.place;
    for round in 0..12 {
        let aside = |random: &mut Random| {
            DVec3::new(random.unit() - 0.5, random.unit() - 0.5, 0.0) * 2.0 * spread
        };
        let speed = FASTEST * [1.0, 0.3, 0.03][round % 3];
        let depth = above * [0.01, 0.03, 0.15][round / 4];
        let start = home + aside(&mut random);
        probe.move_to(start, FASTEST, &mut *look);
        let surface = start - above * 0.08;
        probe.move_to(surface - depth, speed, &mut *look);
        let rubbed = surface - depth + aside(&mut random);
        probe.move_to(rubbed, speed, &mut *look);
        // Out again where it came in: the way back is free.
        probe.move_to(surface - depth, speed, &mut *look);
        probe.move_to(start, FASTEST, &mut *look);
        // A jump of thirty radii over rough land: what a tick has no work left for, the next ones
        // do.
        for _ in 0..3 {
            let freed = probe.to(home);
            look(freed, &probe.world);
        }
        assert!(
            !probe.world.summary().last.contact,
            "round {round}: it is free"
        );
    }
}

/// Two plates back to back, a ten-thousandth of their size apart.
fn double_sheet() -> SoupMesh {
    let mut mesh = generate(Shape::Plate, 5000, 1);
    let below = generate(Shape::Plate, 5000, 1);
    let first = mesh.positions.len() as u32;
    let moved = below.positions.iter().map(|&[x, y, _]| [x, y, -2e-4]);
    mesh.positions.extend(moved);
    let turned = below.triangles.iter();
    mesh.triangles
        .extend(turned.map(|&[a, b, c]| [a + first, c + first, b + first]));
    mesh
}

#[test]
fn a_plate_and_a_double_sheet_from_both_sides_at_every_scale() {
    let plate = model(generate(Shape::Plate, 20_000, 1));
    let sheets = model(double_sheet());
    let side = |z: f64, proxy: DVec3| {
        let (a, b, c) = (DVec3::ZERO, DVec3::X, DVec3::Y);
        side_of_plane(a, b, c, proxy - DVec3::Z * z)
    };
    for size in SIZES {
        // The plate is 2 units long: the lower sheet lies 1e-4 sizes below the upper one.
        for (name, model, sheet, up) in [
            ("plate from above", &plate, 0.0, 1.0),
            ("plate from below", &plate, 0.0, -1.0),
            ("sheets from above", &sheets, 0.0, 1.0),
            ("sheets from below", &sheets, -1e-4, -1.0),
        ] {
            let above = DVec3::Z * up;
            let mut probe = Probe::new(model, size, above * 0.08);
            let wanted = if up > 0.0 {
                Ordering::Greater
            } else {
                Ordering::Less
            };
            let mut contacts = 0;
            let mut nearest = f64::INFINITY;
            let mut last = DVec3::ZERO;
            // How far the proxy lags aside, of the probe's step, for hands below and above 0.1 m/s
            // at 0.15 m.
            let mut lags = [0.0f64; 2];
            stab(&mut probe, above, 0.2, &mut |proxy, world| {
                let goal = proxy - world.force() / (STIFFNESS * size);
                let step = goal.distance(last);
                last = goal;
                assert_eq!(side(sheet, proxy), wanted, "{name} at {size} m: {proxy}");
                nearest = nearest.min((proxy.z - sheet) * up);
                if world.summary().last.contact {
                    contacts += 1;
                    let force = world.force();
                    assert!(force.dot(above) >= 0.0, "{name} at {size} m: {force}");
                    let aside = force.truncate().length() / (STIFFNESS * size);
                    if step > 0.0 {
                        let lag = &mut lags[usize::from(step > 0.05 * FASTEST)];
                        *lag = lag.max(aside / step);
                    }
                }
            });
            println!(
                "{name} at {size} m: {contacts} contacts, centre never nearer than {nearest}, lag {lags:?}"
            );
            assert!(contacts > 100);
            assert!(nearest > 0.999 * RADIUS, "{name} at {size} m: {nearest}");
            // A tick has few steps around the edges between faces; what is left is done in the next
            // one.
            assert!(
                lags.iter().all(|&lag| lag < 1e-9),
                "{name} at {size} m: {lags:?}"
            );
        }
    }
}

#[test]
fn a_wedge_on_its_ridge_and_in_its_groove() {
    let wedge = model(generate(Shape::Wedge, 20_000, 1));
    // Its faces are z = 1 - |x| over a square of side 2; the size is 2.
    let over = |proxy: DVec3, right: bool| {
        let ridge = DVec3::new(0.0, 0.0, 0.5);
        let foot = DVec3::new(if right { 0.5 } else { -0.5 }, 0.0, 0.0);
        let (a, b) = if right { (foot, ridge) } else { (ridge, foot) };
        side_of_plane(a, ridge + DVec3::Y, b, proxy) == Ordering::Greater
            || side_of_plane(a, b, ridge + DVec3::Y, proxy) == Ordering::Less
    };
    assert!(over(DVec3::Z, true) && over(DVec3::Z, false));
    assert!(!over(DVec3::ZERO, true) && !over(DVec3::ZERO, false));
    for size in SIZES {
        for up in [1.0, -1.0] {
            let above = DVec3::Z * up;
            let mut probe = Probe::new(&wedge, size, DVec3::Z * (0.5 + 0.08 * up));
            let mut contacts = 0;
            stab(&mut probe, above, 0.05, &mut |proxy, world| {
                let (left, right) = (over(proxy, false), over(proxy, true));
                let outside = if up > 0.0 {
                    left || right
                } else {
                    !left && !right
                };
                assert!(outside, "up {up} at {size} m: {proxy}");
                contacts += u32::from(world.summary().last.contact);
            });
            println!("wedge, up {up} at {size} m: {contacts} contacts");
            assert!(contacts > 100);
        }
    }
}

#[test]
fn land_from_above_at_every_scale() {
    let terrain = model(generate(Shape::Terrain, 60_000, 1));
    for size in SIZES {
        let start = DVec3::Z * 0.3;
        let mut probe = Probe::new(&terrain, size, start);
        // Down to the land, then to 8 hundredths above it, where the stabs begin.
        let mut ground = f64::NAN;
        probe.move_to(DVec3::Z * -0.4, 0.003, |proxy, world| {
            if world.summary().last.contact && ground.is_nan() {
                ground = proxy.z;
            }
        });
        assert!(ground.is_finite(), "the land was met");
        probe.move_to(start, FASTEST, |_, _| {});
        probe.move_to(DVec3::Z * (ground + 0.08), FASTEST, |_, _| {});
        let (mut contacts, mut looked) = (0, 0u32);
        stab(&mut probe, DVec3::Z, 0.15, &mut |proxy, world| {
            contacts += u32::from(world.summary().last.contact);
            looked += 1;
            // A tick that forgets its force would show here too: the probe alone is below.
            if looked.is_multiple_of(3) {
                assert!(above_front(world, proxy * size), "at {size} m: {proxy}");
            }
        });
        println!("land at {size} m: {contacts} contacts");
        assert!(contacts > 100);
    }
}

/// Whether a point lies above every active face over or under it.
fn above_front(world: &World, place: DVec3) -> bool {
    let Some(frame) = world.controller().frame() else {
        return false;
    };
    let point = frame.to_model(place);
    let mesh = world.controller().cache().mesh();
    let mut above = true;
    mesh.for_each_active_face(|face| {
        let corners = mesh.corners(face);
        let flat = corners.map(|c| (c - point).truncate());
        let turns = [0, 1, 2].map(|k| flat[k].perp_dot(flat[(k + 1) % 3]));
        // A sliver without area, or a face on edge, is neither over nor under the point.
        let has_area = turns.iter().any(|&turn| turn > 0.0);
        if has_area && turns.iter().all(|&turn| turn >= 0.0) {
            let [a, b, c] = corners;
            above &= side_of_plane(a, b, c, point) == Ordering::Greater;
        }
    });
    above
}

/// How often the front winds round the proxy's centre: 0 outside of a closed one.
fn winding(world: &World) -> f64 {
    let (Some(frame), Some(proxy)) = (world.controller().frame(), world.controller().proxy())
    else {
        return 0.0;
    };
    let centre = frame.to_model(proxy);
    let mesh = world.controller().cache().mesh();
    let mut sum = 0.0;
    mesh.for_each_active_face(|face| sum += solid_angle(mesh.corners(face), centre));
    sum / (4.0 * std::f64::consts::PI)
}

#[test]
fn a_front_that_moves_over_the_proxy_takes_it_along() {
    let relief = model(generate(Shape::Relief, 30_000, 1));
    for size in SIZES {
        let mut random = Random::new(17);
        let mut probe = Probe::new(&relief, size, DVec3::X * 0.7);
        let (mut ticks, mut held, mut changes) = (0u32, 0u32, 0u32);
        for round in 0..20 {
            // A hand that holds still or rubs, just below a surface that is refined and coarsened
            // under it by more than the probe's radius.
            let direction = |random: &mut Random| {
                let mut unit = || random.unit() - 0.5;
                DVec3::new(unit(), unit(), unit()).normalize()
            };
            let aim = direction(&mut random);
            let beside = (aim + 0.3 * direction(&mut random)).normalize();
            let speed = FASTEST * [0.03, 0.3][round % 2];
            let mut from = |probe: &mut Probe, place: DVec3, speed: f64| {
                probe.move_to(place, speed, |proxy, world| {
                    ticks += 1;
                    held += u32::from(world.summary().last.contact);
                    changes += world.summary().last.vsplits + world.summary().last.ecols;
                    let winding = winding(world);
                    assert!(
                        winding.abs() < 0.5,
                        "round {round} at {size} m: {winding} at {proxy}"
                    );
                });
            };
            from(&mut probe, aim * 0.7, FASTEST);
            for (k, place) in [0.35, 0.3, 0.25, 0.3, 0.25, 0.3].into_iter().enumerate() {
                let tolerance = [0.0, 0.02, 0.004][(k + round) % 3] * size;
                probe.world.controller_mut().set_tolerance(tolerance);
                let place = if k % 2 == 0 { aim } else { beside } * place;
                from(&mut probe, place, speed);
            }
            from(&mut probe, aim * 0.7, FASTEST);
        }
        println!("size {size}: {held} of {ticks} ticks in contact, {changes} splits and collapses");
        assert!(held > 1000 && changes > 10_000);
    }
}

#[test]
fn a_sphere_pushes_back_along_its_radius_with_stiffness_times_depth() {
    let faces = 40_000u32;
    let sphere = model(generate(Shape::Sphere, faces, 1));
    // Chords of 200 meridians lie below the sphere by no more than this share of its radius, twice
    // over for the diagonals.
    let below = 2.0 * (1.0 - (std::f64::consts::PI / f64::from(faces).sqrt()).cos());
    let radius = 0.5;
    for size in SIZES {
        let mut random = Random::new(3);
        for _ in 0..6 {
            let direction = DVec3::new(
                random.unit() - 0.5,
                random.unit() - 0.5,
                random.unit() - 0.5,
            )
            .normalize();
            let mut probe = Probe::new(&sphere, size, direction * 0.56);
            for depth in [0.002, 0.01, 0.04] {
                let goal = direction * (radius + RADIUS - depth);
                probe.move_to(goal, 0.002, |proxy, _| {
                    assert!(proxy.length() > radius * (1.0 - below));
                });
                for _ in 0..100 {
                    probe.to(goal);
                }
                assert!(probe.world.summary().last.contact_full);
                let force = probe.world.force();
                let measured = force.length() / (STIFFNESS * size);
                let low = depth - radius * below;
                assert!(
                    (low..=depth * (1.0 + 1e-9)).contains(&measured),
                    "{size} m: {measured} for {depth}"
                );
                let aligned = force.normalize().dot(direction);
                assert!(aligned > 0.99, "{size} m, {depth}: {aligned}");
            }
        }
    }
}

#[test]
fn a_scene_scaled_up_or_down_does_the_same() {
    let relief = model(generate(Shape::Relief, 30_000, 1));
    let path = |size: f64| {
        let mut probe = Probe::new(&relief, size, DVec3::X * 0.7);
        let mut proxies = Vec::new();
        let turn = DQuat::from_rotation_z(0.5);
        for place in [DVec3::X * 0.2, turn * DVec3::X * 0.25, DVec3::X * 0.7] {
            probe.move_to(place, 0.001, |proxy, _| proxies.push(proxy));
        }
        let s = probe.world.summary();
        assert!(s.contact > 200, "{} contacts", s.contact);
        proxies
    };
    let reference = path(1.0);
    for size in [1e-3, 1e3] {
        let other = path(size);
        assert_eq!(other.len(), reference.len(), "size {size}");
        let apart = reference.iter().zip(&other).map(|(a, b)| a.distance(*b));
        let apart = apart.fold(0.0, max_or_nan);
        println!("size {size}: {apart:e} of the size apart");
        assert!(apart < 1e-6, "size {size}: {apart}");
    }
}

#[test]
fn a_resting_hand_rests() {
    for shape in [Shape::Plate, Shape::Wedge, Shape::Sphere, Shape::Relief] {
        let model = model(generate(shape, 30_000, 1));
        for encoder in [0.0, 1e-5] {
            rest(&format!("{shape}, encoder {encoder} m"), &model, encoder);
        }
    }
}

/// A hand holds still on a model of 0.15 m for five seconds.
fn rest(name: &str, model: &[u8], encoder: f64) {
    let mut plan = plan("");
    plan.probes[0].trajectory = TrajectoryPlan::Points(Vec::new());
    plan.probes[0].device.encoder_m = encoder;
    let mut world = world(&plan, model, 6.0);
    // Above all of them is free, and down along z lies the surface.
    let mut held = DVec3::new(0.003, 0.002, 0.15);
    while world.summary().last.depth_m < 0.001 && held.z > -0.1 {
        held.z -= 5e-5;
        world.step_held(held);
    }
    assert!(world.summary().last.contact, "{name}: it touches");
    for _ in 0..2000 {
        world.step_held(held);
    }
    let energy = world.summary().last.energy_j;
    let at_first = world.client_mut().hand(0).state().pose.position;
    let mut forces = Vec::new();
    let mut moved: f64 = 0.0;
    for _ in 0..5000 {
        world.step_held(held);
        forces.push(world.force());
        moved = moved.max(
            world
                .client_mut()
                .hand(0)
                .state()
                .pose
                .position
                .distance(at_first),
        );
    }
    let mean = forces.iter().sum::<DVec3>() / forces.len() as f64;
    let spread = forces.iter().map(|f| f.distance_squared(mean)).sum::<f64>();
    let deviation = (spread / forces.len() as f64).sqrt();
    let gained = world.summary().last.energy_j - energy;
    println!(
        "{name}: force {:.3} N, deviation {deviation:.1e} N, moved {moved:.1e} m, energy {gained:.1e} J",
        mean.length()
    );
    // An encoder lets the hand rock by a step, which the surface answers with a step times the
    // stiffness.
    let step_force = STIFFNESS * encoder;
    assert!(mean.length() > 0.1, "{name}");
    assert!(deviation <= 1e-6 + 2.0 * step_force, "{name}: it buzzes");
    assert!(moved <= 1e-8 + 2.0 * encoder, "{name}: it creeps");
    let most = 1e-9 + 5000.0 * step_force * encoder;
    assert!(gained <= most, "{name}: it puts out {gained} J");
    assert!(world.summary().last.contact_full, "{name}");
}
