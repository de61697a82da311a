//! Ridges, valleys, tips and corners: where several constraints hold at once, or change.

use super::bench::{Bench, model};
use super::case::{Case, Found, ProbeOfCase, Trial, positive};
use super::device::FreeMass;
use super::setup::{Departure, Setup};
use super::shapes;
use super::slides::{PUSHED_SHARE, slide};
use crate::failure::Failure;
use crate::models::surface::unit;
use glam::DVec3;
use hrtc_core::contact::query::closest_point;
use hrtc_core::contact::sphere_proxy::projection::{Plane, project};
use mutants::Mutant;
use rand_xoshiro::Xoshiro256PlusPlus;

/// Rounding of a mesh of single precision, as it shows in a force.
const ROUNDING: f64 = 1e-6;

/// A force that is lost, or back, in one tick, over that force.
const ALL: f64 = 1.0;
/// The same over 2 sin(turn/2) of the flattest ridge, of 10 degrees: 1 / (2 sin 5°) = 5.737. Two
/// forces over it are 10 degrees apart at the most, so that no other change is larger.
const ALL_AT_10_DEGREES: f64 = 5.74;
/// A force that turns at the sharpest edge at once: 2 sin 85° = 1.9924.
const TURNED_BY_170_DEGREES: f64 = 1.993;

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "dihedral of 10-170 degrees; |dF| <= 2 F sin(turn/2)",
        runs: "10 to 170 degrees in steps of 20, 20-220 mm/s, 0.05-0.85 of the radius deep; 1800 slides",
        departs: &[(
            Departure::Account,
            "the way is prescribed: a force that turns does work that no hand paid for",
        )],
        ..Case::of(
            [
                "ridge",
                "6",
                "change of force in a tick over 2 F sin(turn/2)",
            ],
            1.0 + ROUNDING,
            Mutant::DeadZone,
            ridge,
        )
    },
    Case {
        facts: "dihedral of 10-170 degrees; |dF| <= 2 F sin(turn/2)",
        runs: "10 to 170 degrees in steps of 20, 20-220 mm/s, 0.05-0.85 of the radius deep; 1800 slides",
        open: "at an edge the motion before it is taken for that behind it, so that the account expects the \
               device to leave: 5.7; along the force of each tick it is 1.0, but a texture leaks 1e-8",
        known: ALL_AT_10_DEGREES,
        ..Case::of(
            [
                "ridge-account",
                "6",
                "change of force in a tick over 2 F sin(turn/2)",
            ],
            1.0 + ROUNDING,
            Mutant::DeadZone,
            ridge,
        )
    },
    Case {
        facts: "dihedral of 10-170 degrees, shaded; 7 % of F in a tick",
        runs: "10 to 80 degrees, shaded over 5 mm, max_turn 85, 20-100 mm/s",
        departs: &[(
            Departure::Account,
            "the way is prescribed: a force that turns does work that no hand paid for",
        )],
        ..Case::of(
            [
                "shaded-ridge",
                "6",
                "change of force in a tick over the force, shaded",
            ],
            0.07,
            Mutant::Shading,
            shaded_ridge,
        )
    },
    Case {
        facts: "dihedral of 10-170 degrees, shaded; 7 % of F in a tick",
        runs: "10 to 80 degrees, shaded over 5 mm, max_turn 85, 20-100 mm/s",
        open: "the most that was put in is F d/2. A fade of 7 % a tick gives F u t/r² (t: turn a tick, u: \
               motion, r = 0.07): at 0.2 mm, 0.1 m/s and 0.4 degrees 0.14 of 0.10 N mm",
        known: ALL,
        ..Case::of(
            [
                "shaded-ridge-account",
                "6",
                "change of force in a tick over the force, shaded",
            ],
            0.07,
            Mutant::Shading,
            shaded_ridge,
        )
    },
    Case {
        facts: "dihedral of 10-170 degrees, shaded; 7 % of F in a tick",
        runs: "90 to 170 degrees, the same",
        open: "an edge sharper than max_turn, at most 85 degrees, stays sharp by design",
        known: TURNED_BY_170_DEGREES,
        departs: &[(
            Departure::Account,
            "the way is prescribed: a force that turns does work that no hand paid for",
        )],
        ..Case::of(
            [
                "shaded-sharp-ridge",
                "6",
                "the same at edges of 90 to 170 degrees",
            ],
            0.07,
            Mutant::Shading,
            shaded_sharp_ridge,
        )
    },
    Case {
        facts: "1e-8 to 1 rad; inside both to 1e-9 L, |step| <= |device step|",
        runs: "1e-8 to 1 rad in steps of 10, 50 000 goals each, the projection alone",
        probe: ProbeOfCase::None,
        ..Case::of(
            ["valley", "7", "outside one of two planes, of the size"],
            1e-9,
            Mutant::Plane,
            valley,
        )
    },
    Case {
        facts: "1e-8 to 1 rad; inside both to 1e-9 L, |step| <= |device step|",
        runs: "a mesh of two slopes of 1e-3 to 1 rad, 50 000 places each",
        ..Case::of(
            [
                "valley-touched",
                "7",
                "a ball outside one of two slopes, of the size",
            ],
            1e-9,
            Mutant::Plane,
            valley_touched,
        )
    },
    Case {
        facts: "3 to 64 planes; the true projection to 1e-9 L; at most 16 iterations",
        runs: "3, 4, 5, 8, 16, 32, 64 planes, 1000 each, the projection alone",
        probe: ProbeOfCase::None,
        ..Case::of(
            [
                "tip",
                "8",
                "from the exact projection on 3 to 64 planes, of the size",
            ],
            1e-9,
            Mutant::Plane,
            tip,
        )
    },
    Case {
        facts: "3 to 64 planes; the true projection to 1e-9 L; at most 16 iterations",
        runs: "a pit of 3 to 64 faces; two ticks, of 8 steps each, at every place",
        ..Case::of(
            [
                "pit-touched",
                "8",
                "a ball in a pit from the exact projection, of the size",
            ],
            1e-9,
            Mutant::Plane,
            pit_touched,
        )
    },
    Case {
        runs: "a hand of 200 N/m, encoder of 10 um, noise of a step; ten minutes",
        ..Case::of(
            [
                "corner-at-rest",
                "",
                "stray of the proxy in a noisy corner, radii",
            ],
            1e-5,
            Mutant::Plane,
            rest_in_corner,
        )
    },
];

/// Rounds within which a projection is to be found.
const MAX_ROUNDS: u32 = 16;
/// How far a reference point may be outside a half-space, in shares of the numbers' size.
const FEASIBLE: f64 = 1e-11;

fn within(random: &mut Xoshiro256PlusPlus) -> DVec3 {
    DVec3::new(unit(random), unit(random), unit(random)) * 2.0 - 1.0
}

/// Case 6: the change of the force in a tick over 2 F sin(turn / 2), the largest, where the probe
/// slides over a ridge whose normals turn by 10 to 170 degrees.
fn ridge(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for degrees in (10..=170).step_by(20) {
        let turn = f64::from(degrees).to_radians();
        // Over the ridge it jumps.
        let setup = defaults.with_motions_of_a_tick();
        let mut bench = Bench::new(&model(shapes::roof(turn), true)?, setup)?;
        let (sin, cos) = (0.5 * turn).sin_cos();
        bench.settle(DVec3::Z * 0.01)?;
        for k in 0..size.of(4, 200) {
            let speed = 0.02 + 0.2 * unit(random);
            // The first so shallow that nothing may be taken for none.
            let least = if k == 0 { 0.0 } else { 0.8 * unit(random) };
            let depth = setup.radius_m * (0.05 + least);
            // Along both slopes at a depth below where the probe would touch, over the ridge.
            let reach = 0.004;
            let place = |s: f64| {
                let slope = DVec3::new(s * cos, 0.0, -s.abs() * sin);
                let normal = DVec3::new(s.signum() * sin, 0.0, cos);
                slope + normal * (setup.radius_m - depth)
            };
            bench.travel(place(-reach) + DVec3::new(-sin, 0.0, cos) * 0.01);
            // At 60 degrees and more this alone lets all of the force go.
            let allowed = 2.0 * (0.5 * turn).sin();
            let none_n = PUSHED_SHARE * setup.stiffness_n_per_m * depth;
            let limits = [allowed, none_n];
            slide(&mut bench, place, [reach, speed], limits, &mut found);
        }
    }
    Ok(found)
}

/// Case 6, shaded: the change of the force in a tick over the force, the largest, where the probe
/// slides over a ridge whose normals turn by 10 to 80 degrees, and the force is shaded over 5 mm.
fn shaded_ridge(trial: Trial<'_>) -> Result<Found, Failure> {
    shaded(trial, [10, 20, 30, 40, 50, 60, 70, 80])
}

/// The same where they turn by 90 to 170 degrees.
fn shaded_sharp_ridge(trial: Trial<'_>) -> Result<Found, Failure> {
    shaded(trial, [90, 110, 130, 150, 170])
}

fn shaded(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    turns: impl IntoIterator<Item = u32>,
) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for degrees in turns {
        let (sin, cos) = (0.5 * f64::from(degrees).to_radians()).sin_cos();
        let mesh = shapes::roof(f64::from(degrees).to_radians());
        let setup = Setup {
            effects: "{ shading = { radius_m = 0.005, max_turn_deg = 85 } }",
            ..defaults
        };
        let mut bench = Bench::new(&model(mesh, true)?, setup)?;
        bench.settle(DVec3::Z * 0.01)?;
        for _ in 0..size.of(4, 200) {
            let speed = 0.02 + 0.08 * unit(random);
            let depth = setup.radius_m * (0.2 + 0.6 * unit(random));
            let reach = 0.01;
            // At an even depth below where the probe would touch: along a slope, round the edge,
            // along the other slope.
            let off = setup.radius_m - depth;
            let round = 0.5 * f64::from(degrees).to_radians() * off;
            let place = |direction: f64| {
                let along = (direction.abs() - round).max(0.0) * direction.signum();
                let turn = direction.clamp(-round, round) / off;
                DVec3::new(along * cos, 0.0, -along.abs() * sin)
                    + DVec3::new(turn.sin(), 0.0, turn.cos()) * off
            };
            bench.travel(place(-reach) + DVec3::Z * 0.01);
            // The limit is that of a millisecond.
            let allowed = setup.ms(1).max(1.0);
            // How much of a force is left where it is turned is not asked, but some must be.
            slide(
                &mut bench,
                place,
                [reach, speed],
                [allowed, 0.0],
                &mut found,
            );
        }
    }
    Ok(found)
}

/// Case 7: how far the proxy is outside one of two planes of a valley, or moves farther than the
/// device, over the numbers' size, the largest; angles of 1e-8 to 1 rad.
fn valley(Trial { size, random, .. }: Trial<'_>) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for exponent in -8..=0 {
        let turn = 10f64.powi(exponent);
        for _ in 0..size.of(200, 50_000) {
            let normal = within(random).normalize_or(DVec3::Z);
            let aside = normal.any_orthonormal_vector();
            let (sin, cos) = (0.5 * turn).sin_cos();
            let planes = [sin, -sin].map(|sin| Plane {
                normal: (normal * cos + aside * sin).normalize(),
                // The proxy stands free of both.
                offset: -0.1 * unit(random),
            });
            let goal = within(random);
            let step = project(goal, &planes).point;
            for plane in &planes {
                found.most(positive(plane.offset - plane.normal.dot(step)));
            }
            found.most(positive(step.length() - goal.length()));
        }
    }
    Ok(found)
}

/// Case 8: distance of the step from the exact projection, over the numbers' size, the largest,
/// among 3 to 64 planes around a tip or pit; infinite where it took more than 16 rounds.
fn tip(Trial { size, random, .. }: Trial<'_>) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    for count in [3, 4, 5, 8, 16, 32, 64] {
        for _ in 0..size.of(20, 1000) {
            let steep = 0.1 + 2.0 * unit(random);
            let planes: Vec<Plane> = (0..count)
                .map(|k| {
                    let turn = std::f64::consts::TAU * (f64::from(k) + 0.3 * unit(random))
                        / f64::from(count);
                    Plane {
                        normal: DVec3::new(turn.cos(), turn.sin(), steep).normalize(),
                        offset: -0.05 * unit(random),
                    }
                })
                .collect();
            let goal = within(random) - DVec3::Z;
            let step = project(goal, &planes);
            found.most(step.point.distance(exact(goal, &planes)));
            found.must(step.rounds <= MAX_ROUNDS);
            found.log("rounds", f64::from(step.rounds));
        }
    }
    Ok(found)
}

/// The closest point to the goal in an intersection of half-spaces: the best feasible one among the
/// closest points on all single planes, pairs and triples.
fn exact(goal: DVec3, planes: &[Plane]) -> DVec3 {
    let mut best = (f64::INFINITY, goal);
    let mut consider = |point: Option<DVec3>| {
        let Some(point) = point.filter(|p| p.is_finite()) else {
            return;
        };
        let distance = point.distance(goal);
        let feasible = |p: &Plane| p.normal.dot(point) >= p.offset - FEASIBLE;
        if distance < best.0 && planes.iter().all(feasible) {
            best = (distance, point);
        }
    };
    consider(Some(goal));
    for (i, a) in planes.iter().enumerate() {
        consider(Some(goal + a.normal * (a.offset - a.normal.dot(goal))));
        for (j, b) in planes.iter().enumerate().take(i) {
            consider(on_two(goal, a, b));
            for c in &planes[..j] {
                consider(on_three(a, b, c));
            }
        }
    }
    best.1
}

fn on_two(goal: DVec3, a: &Plane, b: &Plane) -> Option<DVec3> {
    // goal + x a + y b on both planes.
    let g = a.normal.dot(b.normal);
    let (p, q) = (a.offset - a.normal.dot(goal), b.offset - b.normal.dot(goal));
    let det = a.normal.cross(b.normal).length_squared();
    (det > 0.0).then(|| goal + a.normal * ((p - g * q) / det) + b.normal * ((q - g * p) / det))
}

fn on_three(a: &Plane, b: &Plane, c: &Plane) -> Option<DVec3> {
    let (bc, ca, ab) = (
        b.normal.cross(c.normal),
        c.normal.cross(a.normal),
        a.normal.cross(b.normal),
    );
    let det = a.normal.dot(bc);
    (det != 0.0).then(|| (bc * a.offset + ca * b.offset + ab * c.offset) / det)
}

/// Case 7 through a mesh: how far a ball is outside one of the two slopes of a valley, or went
/// farther than the device, over the size, the largest; angles of 1e-3 to 1 rad: finer ones are
/// rounded off in a mesh.
fn valley_touched(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = defaults;
    let mut found = Found::new(0.0);
    for turn in [1e-3, 1e-2, 0.1, 1.0] {
        let mut bench = Bench::new(&model(shapes::roof(-turn), true)?, setup)?;
        bench.settle(DVec3::Z * 0.02)?;
        bench.travel(DVec3::Z * 5e-4);
        let (mut place, mut last) = (DVec3::Z * 5e-4, None::<DVec3>);
        for _ in 0..size.of(500, 50_000) {
            // Drawn back to the middle, half a radius below the touch.
            let step = within(random) * 3e-4 - (place - DVec3::Z * 5e-4) * 0.1;
            let step = step * setup.jump();
            place += step;
            let proxy = bench.touch(place).proxy;
            let room = distance(&bench, proxy);
            found.must(room.is_some());
            let outside = setup.radius_m - room.unwrap_or(f64::NAN);
            found.most(positive(outside) / setup.size_m);
            if let Some(last) = last.replace(proxy) {
                found.most(positive(proxy.distance(last) - step.length()) / setup.size_m);
            }
        }
    }
    Ok(found)
}

/// Case 8 through a mesh: distance of a ball in a pit from the exact projection, over the size, the
/// largest, after two ticks at a place: of 8 steps each. Logged: the same a tick later.
fn pit_touched(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = defaults;
    let mut found = Found::new(0.0);
    for count in [3, 4, 5, 8, 16, 32, 64] {
        let steep = 0.3 + unit(random);
        let mut bench = Bench::new(&model(shapes::pit(count, steep), true)?, setup)?;
        bench.settle(DVec3::Z * 0.15)?;
        let planes = planes_of(&bench);
        let offset: Vec<Plane> = planes
            .iter()
            .map(|plane| Plane {
                offset: plane.offset + setup.radius_m,
                ..*plane
            })
            .collect();
        bench.travel(exact(DVec3::ZERO, &offset));
        for _ in 0..size.of(30, 1000) {
            let place = within(random) * 1e-3 - DVec3::Z * 1e-3;
            let due = exact(place, &offset);
            let apart = |proxy: DVec3| proxy.distance(due) / setup.size_m;
            // It ends with two ticks at the place.
            found.most(apart(bench.travel(place).proxy));
            found.log("a tick later", apart(bench.touch(place).proxy));
        }
    }
    Ok(found)
}

/// Distance of a place from the surface, metres.
fn distance(bench: &Bench, place: DVec3) -> Option<f64> {
    let frame = bench.controller().frame()?;
    let (nearest, _) = closest_point(bench.surface(), frame.to_model(place), None);
    Some(nearest?.closest.distance_squared.sqrt() * frame.metres_per_unit)
}

/// The planes of a mesh's faces, each once, world, metres.
fn planes_of(bench: &Bench) -> Vec<Plane> {
    let Some(frame) = bench.controller().frame() else {
        return Vec::new();
    };
    let mut planes: Vec<Plane> = Vec::new();
    let mesh = bench.mesh();
    mesh.for_each_active_face(|face| {
        let [a, b, c] = mesh.corners(face).map(|corner| frame.to_world(corner));
        let normal = (b - a).cross(c - a).normalize();
        let offset = normal.dot(a);
        planes.push(Plane { normal, offset });
    });
    planes
}

/// Ten minutes in a corner of three planes, in a hand and under a noisy encoder: how far the proxy
/// strays from where it belongs, in radii, the largest. Logged: the swing of the force in the
/// second half.
fn rest_in_corner(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let setup = Setup {
        encoder_m: 1e-5,
        ..defaults
    };
    let mut bench = Bench::new(&model(shapes::corner(), true)?, setup)?;
    let home = DVec3::splat(setup.radius_m);
    let above = home + DVec3::splat(0.005);
    bench.settle(above)?;
    let mut hand = FreeMass::held(above, DVec3::ZERO, bench.period_s(), 1e-5, [200.0, 2.0]);
    let mut found = Found::new(0.0);
    let mut force = DVec3::ZERO;
    let ticks = setup.ticks(size.of(20_000, 600_000));
    let mut is_pushed = false;
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for tick in 0..ticks {
        let share = (setup.ms(tick) / 1000.0).min(1.0);
        hand.intend(above.lerp(home - DVec3::splat(6e-3), share), DVec3::ZERO);
        let noise = within(random).round() * 1e-5;
        let response = bench.touch(hand.advance(force) + noise);
        force = response.force;
        if tick >= setup.ticks(3000) {
            // The account may have taken it, but it never pulls in.
            found.must(force.dot(DVec3::ONE) >= 0.0);
            is_pushed |= response.pushes(&setup);
            found.most(response.proxy.distance(home) / setup.radius_m);
        }
        if tick >= ticks / 2 {
            range = [range[0].min(force.length()), range[1].max(force.length())];
        }
    }
    // What touches nothing does not stray.
    found.must(is_pushed);
    found.log("swing of the force, N", range[1] - range[0]);
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_open_ridge_may_come_to_is_what_a_force_can_do_there() {
        let all = 1.0 / (2.0 * 5f64.to_radians().sin());
        assert!(all <= ALL_AT_10_DEGREES && ALL_AT_10_DEGREES < 1.001 * all);
        let turned = 2.0 * 85f64.to_radians().sin();
        assert!(turned <= TURNED_BY_170_DEGREES && TURNED_BY_170_DEGREES < 1.001 * turned);
    }
}
