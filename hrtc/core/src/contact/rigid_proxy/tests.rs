//! What a tick that ends early estimates, and how it goes on.

use super::coupling_target::Estimate;
use super::look_ahead_tube::LookAheadTube;
use super::mesh_change::MeshChange;
use super::{State, ToolAdvance, ToolContact, ToolProxy};
use crate::contact::motion::{Placement, Twist};
use crate::contact::query::{Limit, Surface};
use crate::contact::tool::{Tool, capsule_mesh};
use ab_tree::{AbTree, leaf_key};
use geometry::{Pose, closest_points_of_triangles};
use glam::{DQuat, DVec3};
use spm::{ActiveMesh, Certified, NONE};

/// Squares along a side of the plate, which is 1 long.
const SIDE: u32 = 24;

/// A plate of squares of two faces each.
fn plate() -> (ActiveMesh, AbTree) {
    let (row, faces) = (SIDE + 1, 2 * SIDE * SIDE);
    let mut mesh = ActiveMesh::new(row * row, faces, 0);
    for v in 0..row * row {
        let at = [v % row, v / row].map(|k| k as f32 / SIDE as f32);
        mesh.set_base_vertex(v, [at[0], at[1], 0.0], Certified::EXACT);
    }
    let mut tree = AbTree::new(faces);
    tree.preconstruct(faces);
    let across = |is_there: bool, other: u32| if is_there { other } else { NONE };
    for square in 0..SIDE * SIDE {
        let [x, y] = [square % SIDE, square / SIDE];
        let a = y * row + x;
        let [b, c, d] = [a + 1, a + row, a + row + 1];
        let (lower, upper) = (2 * square, 2 * square + 1);
        // Opposite each corner: within the square, along x, along y.
        let before = across(x > 0, lower.wrapping_sub(1));
        let below = across(y > 0, upper.wrapping_sub(2 * SIDE));
        let after = across(x + 1 < SIDE, lower + 2);
        let above = across(y + 1 < SIDE, lower + 2 * SIDE);
        for (face, corners, neighbours) in [
            (lower, [a, b, c], [upper, before, below]),
            (upper, [d, c, b], [lower, after, above]),
        ] {
            let set = mesh.set_base_face(face, corners, neighbours);
            set.expect("all are there");
            tree.insert(face, leaf_key(face, faces));
        }
    }
    tree.refit(|face| mesh.face_box(face));
    (mesh, tree)
}

/// A capsule of this radius.
const RADIUS: f64 = 0.1;

fn capsule() -> ToolProxy {
    let tool = Tool::new(&capsule_mesh(RADIUS, 0.6, 40, 30)).expect("it is a tool");
    ToolProxy::new(tool, 1.0).expect("it has an extent")
}

/// It lies along x, its axis at a height.
fn lying(height: f64) -> Pose {
    Pose {
        position: DVec3::new(0.5, 0.5, height),
        orientation: DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
    }
}

/// Pressed onto the plate, by so much. It lies there at rest.
fn pressed(surface: Surface<'_>, depth: f64) -> (ToolProxy, Pose) {
    let mut proxy = capsule();
    proxy.place(&lying(1.2 * RADIUS));
    let goal = lying(RADIUS - depth);
    for _ in 0..20 {
        let _ = proxy.advance(surface, &goal, u32::MAX);
    }
    assert!(proxy.state == State::Clear && proxy.is_blocked());
    (proxy, goal)
}

/// Where the budget ends the search for contacts, those that are known hold the coupling as they
/// did: what a part of the pairs tells would let it go through the plate.
#[test]
fn an_unfinished_search_keeps_the_contacts_that_are_known() {
    const DEPTH: f64 = 0.02;
    const TICKS: u32 = 30;
    let (mesh, tree) = plate();
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let (at_rest, goal) = pressed(surface, DEPTH);
    let mut interrupted = 0;
    for budget in (300..8000_u32).step_by(100) {
        let mut proxy = at_rest.clone();
        proxy.near.invalidate_all();
        for tick in 0..TICKS {
            let _ = proxy.advance(surface, &goal, budget);
            let search = proxy.contacts.search_of(&proxy.near, &proxy.at);
            interrupted += u32::from(search.is_some_and(|search| search.next.is_some()));
            if let Some(Estimate { target, .. }) = proxy.estimate {
                let held = target.centre.z - proxy.goal.centre.z;
                assert!(held > 0.9 * DEPTH, "{budget}, tick {tick}: {held}");
            }
        }
    }
    println!("{interrupted} ticks ended in a search");
    assert!(interrupted > 10, "{interrupted}");
}

/// A contact that only the estimate of an early tick obeys is late if the estimate before passed
/// through it, and what one projection of a tick has told the next one does not take back.
#[test]
fn a_contact_is_late_also_where_no_step_found_it() {
    let mut proxy = capsule();
    let at = |z: f64| Placement {
        centre: DVec3::Z * z,
        orientation: DQuat::IDENTITY,
    };
    (proxy.at, proxy.goal) = (at(0.5), at(-0.5));
    proxy.device_travel = 1.0;
    proxy.contacts.carry(&proxy.at);
    proxy.contacts.add(ToolContact {
        normal: DVec3::Z,
        gap: 0.5,
        ..ToolContact::NONE
    });
    let through = Estimate {
        proxy: at(0.5),
        target: at(-0.4),
    };
    proxy.assumed = Some(through);
    let mut answer = ToolAdvance::new();
    // A step had other contacts.
    answer.contact_count = 1;
    let target = proxy.target_allowed_by_contacts(&mut answer);
    assert!(target.centre.z > 0.0, "{target:?}");
    assert_eq!(answer.late_contacts, 1);
    // A later step no longer needs it.
    let away = Twist {
        linear: DVec3::Z,
        ..Twist::default()
    };
    let _ = proxy.allowed(&away, proxy.contact_offset(), Some(&mut answer));
    assert_eq!(answer.late_contacts, 1);
}

/// Where the surface moves so fast that more faces are within the contact offset than there is room
/// for, the tool goes by the offset of a surface at rest, and comes along.
#[test]
fn a_tool_comes_along_where_the_offset_of_a_moving_surface_has_no_room() {
    const TICKS: u32 = 40;
    let (mesh, tree) = plate();
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let (mut proxy, goal) = pressed(surface, 0.02);
    let start = proxy.at.centre;
    // All of the tool is within it, also where only the shortest path is looked at.
    proxy.moving_offset = 4.0 * RADIUS;
    proxy.look_ahead.shorten_to(0.0);
    proxy.near.invalidate_all();
    let step = DVec3::new(0.0, 1e-3, 0.0);
    for tick in 1..=TICKS {
        let there = Pose {
            position: goal.position + step * f64::from(tick),
            ..goal
        };
        let answer = proxy.advance(surface, &there, u32::MAX);
        assert!(!answer.is_stuck, "tick {tick}: {answer:?}");
        assert!(proxy.at.centre.z > 0.99 * RADIUS, "tick {tick}");
    }
    let moved = proxy.at.centre.y - start.y;
    let due = step.y * f64::from(TICKS);
    assert!(moved > 0.8 * due, "{moved} of {due}");
}

/// A collection that goes on along a part of its path knows every pair that comes within its margin
/// on that part.
#[test]
fn a_shortened_collection_knows_what_is_near_its_path() {
    let (mesh, tree) = plate();
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let path = Twist {
        linear: DVec3::new(0.1, 0.05, 0.0),
        angular: DVec3::new(0.0, 0.02, 0.15),
    };
    let mut shortened = 0;
    for share in [0.1, 0.3, 0.6] {
        let part = path.times(share);
        for most in (250..12_000_u32).step_by(700) {
            let mut proxy = capsule();
            proxy.place(&lying(1.05 * RADIUS));
            let start = proxy.at;
            let (near, shape) = (&mut proxy.near, &proxy.shape);
            let tube = LookAheadTube::along(start, path, 0.001, 0.01, shape);
            let _ = near.collect(surface, shape, tube, &mut Limit::from(most));
            if !near.has_partial_collection() {
                continue;
            }
            let _ = near.shorten_collection(shape, share, u32::MAX);
            // It goes on with the tube that it has.
            let _ = near.collect(surface, shape, tube, &mut Limit::from(u32::MAX));
            let (end, margin) = (near.tube.ends()[1], near.tube.left());
            assert!(end.to(&start.moved(&part)).farthest(1.0) < 1e-12, "{share}");
            assert!(margin > 0.005, "{margin}");
            let known: Vec<_> = near.handles().collect();
            let mut all = capsule().near;
            let wide = LookAheadTube::along(start, part, margin, 0.0, shape);
            let _ = all.collect(surface, shape, wide, &mut Limit::from(u32::MAX));
            assert!(all.tube.left() >= margin, "there is room for all");
            for (face, own) in all.handles() {
                let is_near = (0..=8).any(|k| {
                    let at = start.moved(&part.times(0.125 * f64::from(k)));
                    let rotation = at.rotation();
                    let corners = shape.faces[own as usize].vertices;
                    let corners = corners.map(|v| at.centre + rotation * shape.points[v as usize]);
                    let closest = closest_points_of_triangles(mesh.corners(face), corners);
                    closest.distance_squared < margin * margin
                });
                let is_known = !is_near || known.contains(&(face, own));
                assert!(is_known, "{share}, {most}: {face} and {own}");
            }
            shortened += 1;
        }
    }
    println!("{shortened} shortened");
    assert!(shortened > 3, "{shortened}");
}

/// Where the surface changes amid a step, the updated pairs stay; not for ever, since a step with
/// fewer may come to its end between two changes.
#[test]
fn an_interrupted_step_keeps_the_updated_pairs_at_first() {
    let (mesh, tree) = plate();
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let (mut proxy, goal) = pressed(surface, 0.02);
    proxy.near.invalidate_all();
    let _ = proxy.advance(surface, &goal, u32::MAX);
    assert!(proxy.near.tube.left() > 0.0);
    let mut kept = 0;
    while proxy.near.tube.left() > 0.0 && kept < 100 {
        proxy.has_unfinished_step = true;
        let mut answer = ToolAdvance::new();
        let _ = proxy.update(surface, &MeshChange::new(), u32::MAX, &mut answer);
        assert!(!proxy.has_unfinished_step);
        kept += 1;
    }
    assert!((2..30).contains(&kept), "{kept}");
}
