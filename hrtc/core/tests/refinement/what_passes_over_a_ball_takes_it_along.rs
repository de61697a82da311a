//! A ball that a split or a collapse passes over stays on its side of the surface: the surface
//! winds about it as often as before.

use crate::common::fronts::{Front, models};
use geometry::solid_angle;
use glam::DVec3;
use hrtc_core::contact::sphere_proxy::Proxy;
use simulator::Random;
use spm::{ActiveMesh, OperationFaces, Slot};
use std::f64::consts::TAU;

/// Operations on each front.
const OPERATIONS: u32 = 400;

/// How often the surface winds about a place: about 1 inside of a closed one, 0 outside.
fn winding(mesh: &ActiveMesh, place: DVec3) -> f64 {
    let mut angle = 0.0;
    mesh.for_each_active_face(|face| angle += solid_angle(mesh.corners(face), place));
    angle / (2.0 * TAU)
}

/// A slot that may be split, or whose split may be undone.
fn any_slot(mesh: &ActiveMesh, slots: u32, random: &mut Random) -> Slot {
    loop {
        let slot = random.below(u64::from(slots)) as Slot;
        if mesh.split_is_legal(slot) || mesh.collapse_is_legal(slot) {
            return slot;
        }
    }
}

/// A place on the way of a point of the faces that the operation of a slot will move, or as much as
/// half of that way before or behind it.
fn beside_the_way(mesh: &ActiveMesh, slot: Slot, random: &mut Random) -> DVec3 {
    let mut patch = OperationFaces::new();
    mesh.patch(slot, &mut patch).expect("small fans");
    let k = random.below(patch.deformed().len() as u64) as usize;
    let face = patch.deformed()[k];
    let child = mesh.vt(slot) + u32::from(k >= patch.fans().0.len());
    let parent = mesh.parent(slot);
    let (from, to) = if mesh.is_performed(slot) {
        (child, parent)
    } else {
        (parent, child)
    };
    let (mut a, mut b) = (random.unit(), random.unit());
    if a + b > 1.0 {
        (a, b) = (1.0 - a, 1.0 - b);
    }
    let weights = [1.0 - a - b, a, b];
    let corners = mesh.corners(face);
    let place = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
    let moved = mesh.face(face).corners.iter().position(|&v| v == from);
    let share = moved.map_or(0.0, |corner| weights[corner]);
    let way = (mesh.position(to).as_dvec3() - mesh.position(from).as_dvec3()) * share;
    place + way * (2.0 * random.unit() - 0.5)
}

#[test]
fn a_ball_that_an_operation_passes_over_stays_on_its_side() {
    let mut random = Random::new(51);
    let (mut carried, mut stayed, mut lost) = (0, 0, 0);
    // A wedge is open: no place is on one side of it.
    let closed = models(1500).into_iter().filter(|(name, _)| name != "Wedge");
    for (name, parts) in closed {
        let mut front = Front::new(&parts, 60, &mut random);
        let radius = 1e-4 * front.diagonal();
        let mut out = OperationFaces::new();
        for _ in 0..OPERATIONS {
            let slot = any_slot(&front.mesh, parts.header.vsps, &mut random);
            let place = beside_the_way(&front.mesh, slot, &mut random);
            let before = winding(&front.mesh, place);
            let mut ball = Proxy::new(radius);
            ball.place(place);
            let done = if front.mesh.is_performed(slot) {
                front.mesh.collapse(slot, &mut out)
            } else {
                front.mesh.split(slot, &mut out)
            };
            done.expect("small fans");
            ball.carry(&front.mesh, &out);
            let change = (winding(&front.mesh, place) - before).abs();
            // It was passed over twice.
            if change > 1.5 {
                continue;
            }
            if change < 0.5 {
                assert_eq!(ball.position(), place, "{name}: nothing passed over it");
                stayed += 1;
                continue;
            }
            let now = winding(&front.mesh, ball.position());
            // No number is not on its side.
            let is_on_its_side = (now - before).abs() < 0.5;
            carried += u32::from(is_on_its_side);
            lost += u32::from(!is_on_its_side);
        }
    }
    println!("{carried} carried, {stayed} stayed, {lost} on the other side");
    assert!(carried > 100 && stayed > 100, "{carried} {stayed}");
    // Beside a sharp fold the nearest edge may lead along both of its faces.
    assert!(50 * lost <= carried, "{lost} of {carried}");
}
