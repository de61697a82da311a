//! A tool in grooves and pits, on plates and edges, between sheets.

use super::bench::{Bench, model};
use super::case::{Case, Found, ProbeOfCase, Size, Trial, positive};
use super::setup::Setup;
use super::tool_shapes::{circle, groove, longest_side, prism, rectangle, tool};
use super::{case, shapes};
use crate::failure::Failure;
use crate::models::surface::unit;
use geometry::Pose;
use glam::{DQuat, DVec2, DVec3};
use hrtc_core::record::max_or_nan;
use mutants::Mutant;
use scene::{DrivenPlan, MovablePlan, ProbeShape};
use spm_builder::SoupMesh;
use spm_builder::generate::{Shape, generate};
use std::f64::consts::FRAC_PI_2;

/// How far a tool that nothing holds may lag, metres.
pub(super) const BEHIND_M: f64 = 5e-5;
/// A change of force that is not felt, newtons.
const FELT_N: f64 = 0.05;
/// What a contact keeps away by, and facets, of a force: as a share.
const OFFSET_SHARE: f64 = 0.02;

/// A row of a tool's cases.
pub(super) const fn of(
    name: &'static str,
    measure: &'static str,
    limit: f64,
    mutant: Mutant,
    run: case::Run,
) -> Case {
    Case {
        probe: ProbeOfCase::Tool,
        ..Case::of([name, "", measure], limit, mutant, run)
    }
}

/// The cases of this file.
pub const CASES: &[Case] = &[
    Case {
        facts: "issue 23: 0.1 m/s on 3 mm without a turn limit felt",
        runs: "cylinder of 3 mm, 64 sides, 0.1 m/s, 0.5 mm deep; 100 rounds",
        ..of(
            "rolling",
            "stray of the force from K times the depth, of 0.05 N",
            1.0,
            Mutant::ToolPairs,
            rolling,
        )
    },
    Case {
        facts: "issue 23: rolling on an edge",
        runs: "the same along an edge of 90 degrees, across which it lies",
        ..of(
            "rolling-on-edge",
            "stray of the force from K times the depth, of 0.05 N",
            1.0,
            Mutant::ToolPairs,
            rolling_on_edge,
        )
    },
    Case {
        facts: "issue 23: a groove of 15 degrees, friction within 5 % of theory",
        runs: "rod of 1 mm in a groove of 15 degrees, 0.3 mm deep, friction 0.3; along it at 20 mm/s",
        ..of(
            "wedge-in-groove",
            "friction along a groove beside mu F / sin(7.5 degrees), relative",
            0.05,
            Mutant::Sign,
            wedge,
        )
    },
    Case {
        facts: "issue 23: tip in the jaws of the dragon: see rt-tests tools",
        runs: "rod of 1 mm in a pit of 16 slopes; 1 mm deep, swings of 1 mm; 10 000 places",
        ..of(
            "tip-in-cavity",
            "change of force in a tick over 2 K times the device's motion",
            1.0,
            Mutant::ToolStiff,
            cavity,
        )
    },
    Case {
        facts: "issue 23: flat on a plate: torque step bounded by theory",
        runs: "20 by 12 by 8 mm, 0.5 mm deep, tilted to and fro by 0.2 degrees; 100 s",
        ..of(
            "box-on-plate",
            "change of torque in a tick over K times the squared radii about the device times the turn",
            1.0,
            Mutant::ToolStiff,
            flat,
        )
    },
    Case {
        facts: "issue 23: flat on a plate: torque by theory",
        runs: "the same",
        ..of(
            "box-tilted",
            "half of K times the squared radius of gyration times the tilt, over the largest torque",
            1.0,
            Mutant::ToolTorque,
            flat_torque,
        )
    },
    Case {
        facts: "issue 23: tool larger than the object",
        runs: "a plate of 40 mm on a ball of 4 mm, 0.3 mm deep",
        ..of(
            "tool-larger-than-object",
            "stray of the force from K times the depth, of that",
            OFFSET_SHARE,
            Mutant::ToolStiff,
            larger,
        )
    },
    Case {
        facts: "issue 23: at most 3 times the cost of a thousand",
        runs: "capsules of 1 and 10 thousand faces over a relief of 20 000 faces, 0.1 m/s",
        ..of(
            "ten-thousand-faces",
            "counted work a tick in contact, of that of a thousand faces",
            3.0,
            Mutant::Sign,
            many_faces,
        )
    },
    Case {
        facts: "issue 23: closing sheets",
        runs: "the walls of a groove of 15 degrees close at 0.1 m/s on a rod of 1 mm that is held; 2 mm",
        ..of(
            "closing-sheets",
            "stray of the force from K times the depth, of K times 0.05 mm; infinite where it is none",
            1.0,
            Mutant::ToolStiff,
            closing,
        )
    },
];

/// A cylinder lies on a plate and rolls.
fn rolling(trial: Trial<'_>) -> Result<Found, Failure> {
    rolls(trial, shapes::plate(), DQuat::IDENTITY)
}

/// A cylinder lies across an edge, which is along y, and rolls along it.
fn rolling_on_edge(trial: Trial<'_>) -> Result<Found, Failure> {
    let along_y = DQuat::from_rotation_z(FRAC_PI_2);
    rolls(trial, shapes::roof(FRAC_PI_2), along_y)
}

/// A cylinder rolls over an object, along x as it is `turned`.
fn rolls(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
    object: SoupMesh,
    turned: DQuat,
) -> Result<Found, Failure> {
    let (radius, depth, speed) = (3e-3, 5e-4, 0.1);
    let mut mesh = prism(&circle(radius, 64), 0.01);
    for p in &mut mesh.positions {
        // Its middle at the device.
        p[2] -= 0.005;
    }
    let mut bench = Bench::with_tool(&model(object, true)?, defaults, tool(&mesh))?;
    let place = |x: f64, z: f64| turned * DVec3::new(x, 0.0, z);
    let rolled_to = |x: f64| {
        let lying = DQuat::from_rotation_x(FRAC_PI_2);
        turned * DQuat::from_rotation_y(x / radius) * lying
    };
    bench.turn(rolled_to(0.0));
    bench.settle(DVec3::Z * 0.01)?;
    let mut found = Found::new(0.0);
    let due = defaults.stiffness_n_per_m * depth;
    let mut rolled = 0.0;
    for _ in 0..size.of(1, 100) {
        let start = 0.01 * unit(random);
        bench.press(place(start, radius - depth), DVec3::Z);
        for tick in 1..=defaults.ticks(400) {
            let x = speed * 1e-3 * defaults.ms(tick);
            let response = bench.sample(Some(Pose {
                position: place(start + x, radius - depth),
                orientation: rolled_to(rolled + x),
            }));
            if tick > defaults.ticks(20) {
                found.most(response.force.distance(DVec3::Z * due) / FELT_N);
            }
        }
        rolled += 400.0 * speed * 1e-3;
        bench.turn(rolled_to(rolled));
        bench.travel(place(start + 0.04, 0.01));
        bench.travel(DVec3::Z * 0.01);
    }
    Ok(found)
}

/// Friction of a rod that is pressed into a groove and drawn along it: both walls push with F / (2
/// sin 7.5 degrees) each.
fn wedge(Trial { size, defaults, .. }: Trial<'_>) -> Result<Found, Failure> {
    let angle = 15f64.to_radians();
    let object = groove(angle, 0.02, 0.1);
    let setup = Setup {
        size_m: longest_side(&object),
        effects: "{ friction = { static = 0.3, dynamic = 0.3 } }",
        ..defaults
    };
    let rod = ProbeShape::Capsule {
        radius_m: 1e-3,
        length_m: 0.012,
        faces: 960,
    };
    let mut bench = Bench::with_tool(&model(object, true)?, setup, rod)?;
    bench.turn(DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2));
    let rests = 1e-3 / (0.5 * angle).sin();
    bench.settle(DVec3::Z * 0.019)?;
    bench.press(DVec3::new(0.0, -0.01, rests - 3e-4), DVec3::Z);
    let mut found = Found::new(0.0);
    for tick in 0..setup.ticks(size.of(600, 2000)) {
        let ms = setup.ms(tick);
        let y = -0.01 + 2e-5 * ms.min(900.0);
        let force = bench.touch(DVec3::new(0.0, y, rests - 3e-4)).force;
        if (300.0..900.0).contains(&ms) {
            let due = 0.3 * force.z / (0.5 * angle).sin();
            found.most((-force.y / due - 1.0).abs());
        }
    }
    Ok(found)
}

/// A rod's tip in a pit: the feasible set of straight walls is convex, so the proxy moves no
/// farther than the device, and the force changes by no more than twice that.
fn cavity(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let mut bench = Bench::new(&model(shapes::pit(16, 1.5), true)?, defaults)?;
    bench.settle(DVec3::Z * 0.06)?;
    let mut found = Found::new(0.0);
    let phase = 6.3 * unit(random);
    let place = |tick: u64| {
        let turn = 0.02 * defaults.ms(tick) + phase;
        DVec3::new(turn.sin(), (1.3 * turn).cos(), 0.5 * (0.7 * turn).sin()) * 1e-3
    };
    bench.press(place(0), DVec3::Z);
    let mut before = bench.touch(place(0));
    let mut most_n = 0.0;
    for tick in 1..size.of(1000, 10_000) {
        let response = bench.touch(place(tick));
        most_n = max_or_nan(most_n, response.force.length());
        let moved = place(tick).distance(place(tick - 1));
        let change = response.force.distance(before.force);
        if tick > defaults.ticks(20) {
            found.must(response.record.contact);
            // What the energy account takes or gives back is its own, and is not felt.
            let by_account = before.record.force_withheld - response.record.force_withheld;
            let by_account = by_account.abs() * response.force.length();
            found.must(by_account <= defaults.unfelt_n(response.force.length()));
            found.most((change - by_account) / (2.0 * defaults.stiffness_n_per_m * moved));
        }
        before = response;
    }
    // The tip rests 1.8 radii above the ground of the pit, around which the device is led.
    found.must(most_n >= 0.5 * defaults.stiffness_n_per_m * defaults.radius_m);
    Ok(found)
}

/// Half of the sides of the box on a plate across, metres. It stands on the device.
const BOX_M: DVec2 = DVec2::new(0.01, 0.006);
/// Its height, metres.
const BOX_LENGTH_M: f64 = 0.008;
/// How far it is tilted about an axis, radians: 0.2 degrees.
const TILT: f64 = 0.2 * std::f64::consts::PI / 180.0;

/// The squared radius of gyration of a box's surface about its middle, m²: in the metric of the
/// coupling a turn by an angle is that radius times it. `half`: half of the sides. Over a side at
/// `h` the square of its coordinate is h², and over one along it the mean is h²/3.
fn squared_gyration(half: DVec3) -> f64 {
    // A quarter of the area of a pair of sides, by its normal.
    let areas = DVec3::new(half.y * half.z, half.z * half.x, half.x * half.y);
    let whole = areas.element_sum();
    let squares = half * half;
    (squares * (areas + (DVec3::splat(whole) - areas) / 3.0)).element_sum() / whole
}

/// The same of the box on the plate.
fn squared_gyration_of_box() -> f64 {
    squared_gyration(BOX_M.extend(0.5 * BOX_LENGTH_M))
}

/// A box lies flat on a plate and is tilted to and fro: changes of the torque in a tick, over the
/// most that there can be. With the radius of gyration g and the lever arm a of the box's middle
/// about the device, a turn by u is a motion of `√(g² + a²) u` in the metric of the coupling. The
/// proxy is the nearest placement that is free, so the deflection changes by no more than that, and
/// a torque about the device is K times the deflection times the same radius: K (g² + a²) u. Flat
/// on a plate it is K g² u, 0.83 of that.
fn flat(Trial { size, defaults, .. }: Trial<'_>) -> Result<Found, Failure> {
    let arm = 0.5 * BOX_LENGTH_M;
    let radii = squared_gyration_of_box() + arm * arm;
    let mut found = Found::new(0.0);
    let due = 0.5 * defaults.stiffness_n_per_m * squared_gyration_of_box() * TILT;
    let most_nm = tilted(size, defaults, &mut found, |found, change_nm, turn| {
        found.most(change_nm / (defaults.stiffness_n_per_m * radii * turn));
    })?;
    found.must(most_nm >= due);
    Ok(found)
}

/// Half of the torque that is due at the largest tilt about one axis, over the largest that was
/// seen: the tilts about two axes add up, and the account may take a part.
fn flat_torque(Trial { size, defaults, .. }: Trial<'_>) -> Result<Found, Failure> {
    let mut found = Found::new(0.0);
    let due = 0.5 * defaults.stiffness_n_per_m * squared_gyration_of_box() * TILT;
    let most_nm = tilted(size, defaults, &mut found, |_, _, _| {})?;
    // Over none it is infinite.
    found.most(due / most_nm);
    Ok(found)
}

/// Tilts the box on the plate, which must stay in contact, and looks at each change of its torque,
/// N m, and the turn in that tick, radians. The largest torque, N m.
fn tilted(
    size: &Size,
    defaults: Setup,
    found: &mut Found,
    mut look: impl FnMut(&mut Found, f64, f64),
) -> Result<f64, Failure> {
    let mesh = prism(&rectangle(BOX_M), BOX_LENGTH_M);
    let mut bench = Bench::with_tool(&model(shapes::plate(), true)?, defaults, tool(&mesh))?;
    bench.settle(DVec3::Z * 0.01)?;
    let place = DVec3::Z * -5e-4;
    bench.press(place, DVec3::Z);
    let tilt = |tick: u64| {
        let turn = 0.01 * defaults.ms(tick);
        DVec3::new(turn.sin(), (1.3 * turn).sin(), 0.0) * TILT
    };
    let mut before = bench.touch(place);
    let mut most_nm = 0.0;
    for tick in 1..size.of(2000, 100_000) {
        let response = bench.sample(Some(Pose {
            position: place,
            orientation: DQuat::from_scaled_axis(tilt(tick)),
        }));
        let turned = (tilt(tick) - tilt(tick - 1)).length();
        look(found, response.torque.distance(before.torque), turned);
        found.must(response.record.contact);
        most_nm = max_or_nan(most_nm, response.torque.length());
        before = response;
    }
    Ok(most_nm)
}

/// A plate much larger than the ball that it is pressed onto.
fn larger(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let depth = 3e-4;
    let setup = Setup {
        size_m: 4e-3,
        ..defaults
    };
    let mut plate = prism(&rectangle(DVec2::splat(0.02)), 0.002);
    let ball = model(generate(Shape::Sphere, 2000, 1), true)?;
    for p in &mut plate.positions {
        p[0] += 1e-4;
    }
    let mut bench = Bench::with_tool(&ball, setup, tool(&plate))?;
    bench.settle(DVec3::Z * 0.01)?;
    let mut found = Found::new(0.0);
    let due = defaults.stiffness_n_per_m * depth;
    for _ in 0..size.of(5, 500) {
        // Over the middle of the plate, so that nothing tilts it.
        let aside = (unit(random) - 0.5) * 2e-5;
        bench.travel(DVec3::new(aside - 1e-4, aside, 5e-3));
        bench.press(DVec3::new(aside - 1e-4, aside, 2e-3 - depth), DVec3::Z);
        for _ in 0..setup.ticks(50) {
            bench.touch(DVec3::new(aside - 1e-4, aside, 2e-3 - depth));
        }
        let force = bench
            .touch(DVec3::new(aside - 1e-4, aside, 2e-3 - depth))
            .force;
        found.most((force.z - due).abs() / due);
    }
    Ok(found)
}

/// The counted work of a capsule of ten thousand faces over that of one of a thousand.
fn many_faces(Trial { size, defaults, .. }: Trial<'_>) -> Result<Found, Failure> {
    let bytes = model(generate(Shape::Relief, 20_000, 1), false)?;
    let mut found = Found::new(0.0);
    let mut work = [0.0; 2];
    for (work, faces) in work.iter_mut().zip([1000, 10_000]) {
        let capsule = ProbeShape::Capsule {
            radius_m: 3e-3,
            length_m: 0.03,
            faces,
        };
        let mut bench = Bench::with_tool(&bytes, defaults, capsule)?;
        bench.settle(DVec3::Z * defaults.size_m)?;
        let place = |tick: u64| {
            // 0.1 m/s around the body.
            let turn = 1.4e-3 * defaults.ms(tick);
            DVec3::new(turn.sin(), 0.0, turn.cos()) * (0.36 * defaults.size_m)
        };
        bench.travel(place(0));
        let (mut contacts, mut is_pushed) = (0.0, false);
        for tick in 1..size.of(2000, 20_000) {
            let turn = 1.4e-3 * defaults.ms(tick);
            let response = bench.sample(Some(Pose {
                position: place(tick),
                orientation: DQuat::from_rotation_y(turn),
            }));
            if response.record.contact {
                contacts += 1.0;
                *work += f64::from(response.record.query_work);
                found.must(response.force.dot(place(tick)) >= 0.0);
                is_pushed |= response.force.length() > 0.0;
            }
        }
        // Work without a force shows nothing.
        found.must(is_pushed);
        *work /= contacts;
    }
    found.most(positive(work[1] / work[0]));
    found.log("units a tick of a thousand faces", work[0]);
    Ok(found)
}

/// A groove comes up on a rod that is held in it: its walls close on the rod from both sides.
fn closing(
    Trial {
        size,
        random,
        defaults,
    }: Trial<'_>,
) -> Result<Found, Failure> {
    let (angle, speed) = (15f64.to_radians(), 0.1);
    let object = groove(angle, 0.02, 0.1);
    let setup = Setup {
        size_m: longest_side(&object),
        movable: Some(MovablePlan::Driven(DrivenPlan {
            linear_m_per_s: DVec3::Z * speed,
            angular_rad_per_s: DVec3::ZERO,
            anchor_m: DVec3::ZERO,
            period_s: None,
        })),
        ..defaults
    };
    let bytes = model(object, true)?;
    let rests = 1e-3 / (0.5 * angle).sin();
    let mut found = Found::new(0.0);
    for _ in 0..size.of(2, 200) {
        let rod = ProbeShape::Capsule {
            radius_m: 1e-3,
            length_m: 0.012,
            faces: 960,
        };
        let mut bench = Bench::with_tool(&bytes, setup, rod)?;
        bench.turn(DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2));
        // The walls come to it after the soft start.
        let place = DVec3::new(0.0, -0.006, rests + 0.03 + 1e-4 * unit(random));
        for _ in 0..setup.ticks(360) {
            let response = bench.touch(place);
            let depth = bench.pose().position.z + rests - place.z;
            if depth > 2e-3 {
                break;
            }
            if depth > 1e-4 {
                let due = setup.stiffness_n_per_m * depth;
                found.must(response.force.z > 0.0);
                let behind = (response.force.z - due).abs();
                found.most(behind / (setup.stiffness_n_per_m * BEHIND_M));
            }
        }
    }
    found.must(found.passes > 0);
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of 2 by 2 by 2: a face at 1 along its normal, and a third across twice.
    #[test]
    fn the_gyration_of_a_box_is_that_of_its_sides() {
        let cube = squared_gyration(DVec3::ONE);
        assert!((cube - 5.0 / 3.0).abs() < 1e-12, "{cube}");
        // Two sides of 2 by 2, and nothing between: a plate has 2/3.
        let plate = squared_gyration(DVec3::new(1.0, 1.0, 1e-12));
        assert!((plate - 2.0 / 3.0).abs() < 1e-9, "{plate}");
        // The whole torque of a tilt on a plate keeps to the limit, that of three springs does not.
        let arm = 0.5 * BOX_LENGTH_M;
        let share = squared_gyration_of_box() / (squared_gyration_of_box() + arm * arm);
        assert!(share > 0.8 && share < 0.85 && 3.0 * share > 1.0, "{share}");
    }
}
