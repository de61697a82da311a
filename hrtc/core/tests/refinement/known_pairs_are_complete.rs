//! In any tick, every pair of faces within the known margin is among the candidates of the tool, as
//! a search of all pairs finds them: whatever the tool does, while the surface is split and
//! collapsed, and with budgets that collect in parts.

use crate::common::fronts::{Front, models};
use geometry::{Pose, closest_points_of_triangles};
use glam::DVec3;
use hrtc_core::contact::rigid_proxy::ToolProxy;
use hrtc_core::contact::tool::{Tool, ToolMesh, capsule_mesh};
use simulator::Random;
use spm::{OperationFaces, SpmParts};
use std::collections::HashSet;

/// Performs or undoes fewer operations than so many anywhere, and tells the proxy.
fn change(
    front: &mut Front,
    parts: &SpmParts,
    proxy: &mut ToolProxy,
    random: &mut Random,
    most: u64,
) {
    let mut out = OperationFaces::new();
    for _ in 0..random.below(most) {
        let i = random.below(u64::from(parts.header.vsps)) as u32;
        let Front { mesh, tree, .. } = front;
        if mesh.split_is_legal(i) {
            mesh.split(i, &mut out).expect("the builder's records fit");
            for (&face, leaf) in out.made_or_removed().iter().zip(out.leaves) {
                assert!(tree.insert(face, leaf));
            }
        } else if mesh.collapse_is_legal(i) {
            mesh.collapse(i, &mut out).expect("small fans");
            out.made_or_removed().iter().for_each(|&f| tree.remove(f));
        } else {
            continue;
        }
        out.deformed().iter().for_each(|&f| tree.deform(f));
        proxy.carry(mesh, &out);
    }
    let Front { mesh, tree, .. } = front;
    tree.refit(|f| mesh.face_box(f));
}

/// Pairs within the known margin that are not known, and those that are; by all faces.
fn missed(front: &Front, proxy: &ToolProxy, mesh: &ToolMesh) -> (usize, usize) {
    let margin = proxy.known_margin();
    let known: HashSet<_> = proxy.known_pairs().collect();
    let pose = proxy.pose();
    let faces: Vec<_> = mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| pose.transform_point(mesh.positions[v as usize])))
        .collect();
    let ball = |t: &[DVec3; 3]| {
        let middle = t.iter().sum::<DVec3>() / 3.0;
        (
            middle,
            t.iter().fold(0.0f64, |r, p| r.max(p.distance(middle))),
        )
    };
    let balls: Vec<_> = faces.iter().map(ball).collect();
    let (mut missing, mut within) = (0, 0);
    front.mesh.for_each_active_face(|face| {
        let corners = front.mesh.corners(face);
        let (middle, radius) = ball(&corners);
        for (own, (t, (centre, reach))) in (0u32..).zip(faces.iter().zip(&balls)) {
            if centre.distance(middle) > reach + radius + margin {
                continue;
            }
            // Rounding of the tool's place is not what is asked.
            let distance = closest_points_of_triangles(corners, *t)
                .distance_squared
                .sqrt();
            if distance < margin * (1.0 - 1e-9) {
                within += 1;
                missing += usize::from(!known.contains(&(face, own)));
            }
        }
    });
    (missing, within)
}

#[test]
fn whatever_moves_and_changes() {
    let (mut checked, mut in_parts, mut met) = (0, 0, 0);
    for (seed, (name, parts)) in (1..).zip(models(4000)) {
        // With many operations a tick there are always some beside the tool.
        for (budget, operations) in [
            (300, 6),
            (1500, 6),
            (1 << 17, 6),
            // Escapes that a tick cannot decide.
            (1000, 200),
            (1500, 200),
            (1 << 17, 200),
        ] {
            let mut random = Random::new(seed);
            let mut front = Front::new(&parts, 70, &mut random);
            let (size, middle) = (front.diagonal(), 0.5 * (front.lower + front.upper));
            let mesh = capsule_mesh(0.02 * size, 0.15 * size, 12, 10);
            let tool = Tool::new(&mesh).expect("it is a tool");
            let mut proxy = ToolProxy::new(tool, 1.0).expect("it has an extent");
            let mut at = Pose::at(middle + DVec3::Z * size);
            for k in 0..600 {
                if k % 20 == 0 {
                    at.orientation = at.orientation.slerp(random.orientation(), 0.1);
                }
                let pull = (middle - at.position) * 0.01;
                let way = pull + random.vector() * 0.01 * size;
                at.position += way.clamp_length_max(0.008 * size);
                if k % 3 == 0 {
                    change(&mut front, &parts, &mut proxy, &mut random, operations);
                }
                let answer = proxy.advance(front.surface(), &at, budget);
                in_parts += u32::from(!answer.ending.is_complete());
                if (k % 3 == 0 || k % 4 == 0) && proxy.known_margin() > 0.0 {
                    let (missing, within) = missed(&front, &proxy, &mesh);
                    assert_eq!(
                        missing, 0,
                        "{name}, budget {budget}, {operations} operations, tick {k}, of {within}"
                    );
                    checked += 1;
                    met += within;
                }
            }
        }
    }
    println!("{checked} ticks with {met} pairs, {in_parts} ticks unfinished");
    assert!(
        checked > 500 && met > 5_000 && in_parts > 100,
        "{checked} {met} {in_parts}"
    );
}
