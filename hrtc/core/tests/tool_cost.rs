//! The cost of a tick of the tool's proxy, a measurement:
//! `cargo test --release -p hrtc-core --test tool_cost -- --ignored --nocapture`.

mod common;

use common::fronts::{Front, full_mesh, scaled};
use common::guided_tool::GuidedTool;
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::contact::query::closest_point;
use hrtc_core::contact::rigid_proxy::ToolContact;
use hrtc_core::contact::tool::{ToolMesh, capsule_mesh, cylinder_mesh};
use std::time::Instant;

/// Longest side of the model, metres.
const SIZE: f64 = 0.15;
const SPEED: f64 = 0.1;
const DEPTH: f64 = 0.002;
const PERIOD: f64 = 1e-3;
const TICKS: usize = 10_000;
const BUDGET: u32 = 1 << 16;

/// A hand that slides over what it feels: it presses along the normal and moves across it, and
/// where it is held up it turns aside.
struct Walk {
    at: DVec3,
    heading: DVec3,
    normal: DVec3,
    orientation: DQuat,
}

impl Walk {
    /// A step on from where the tool is held; in the air, towards the surface.
    fn step(
        &mut self,
        front: &Front,
        proxy: DVec3,
        goal: DVec3,
        contacts: &[ToolContact],
        step: f64,
    ) {
        let (nearest, _) = closest_point(front.surface(), proxy, None);
        let away =
            (proxy - nearest.expect("the front has faces").closest.point).normalize_or(self.normal);
        let normal = contacts.iter().fold(DVec3::ZERO, |sum, c| sum + c.normal);
        // A hand turns slowly over what is rough.
        let normal = normal.normalize_or(away);
        let before = self.normal;
        self.normal = before.lerp(normal, 0.002).normalize();
        self.orientation = DQuat::from_rotation_arc(before, self.normal) * self.orientation;
        let pull = proxy - goal;
        let behind = pull.reject_from_normalized(self.normal);
        let turn = if behind.length() > 0.25 * DEPTH {
            0.02
        } else {
            2e-4
        };
        let along = self.heading + self.normal.cross(self.heading) * turn;
        self.heading = along.reject_from_normalized(self.normal).normalize();
        let deeper = DEPTH - pull.dot(normal);
        let way = self.heading * step - normal * deeper.clamp(-step, step) + behind * 0.1;
        self.at += way.clamp_length_max(step);
    }
}

fn run(name: &str, front: &Front, mesh: &ToolMesh, lying: bool) {
    let mut hand = GuidedTool::new(mesh.clone());
    let (_, [a, b, c]) = front.faces[front.faces.len() / 2];
    let normal = (b - a).cross(c - a).normalize();
    let top = front
        .faces
        .iter()
        .map(|(_, t)| t[0])
        .max_by(|p, q| p.y.total_cmp(&q.y));
    let (a, normal) = if lying {
        (top.expect("there are faces"), DVec3::Y)
    } else {
        (a, normal)
    };
    let up = if lying { DVec3::X } else { DVec3::Z };
    let mut walk = Walk {
        at: a,
        heading: normal.any_orthonormal_vector(),
        normal,
        orientation: DQuat::from_rotation_arc(up, normal),
    };
    let low = mesh.positions.iter().fold(f64::INFINITY, |low, p| {
        low.min(if lying { p.x } else { p.z })
    });
    let pose = |walk: &Walk| Pose {
        position: walk.at - walk.normal * low,
        orientation: walk.orientation,
    };
    walk.at += walk.normal * 0.01;
    for _ in 0..115 {
        let _ = hand.proxy.advance(front.surface(), &pose(&walk), BUDGET);
        walk.at -= walk.normal * SPEED * PERIOD;
    }
    let mut answer = hand.proxy.advance(front.surface(), &pose(&walk), BUDGET);
    let mut times = Vec::with_capacity(TICKS);
    let (mut contact, mut met, mut unfinished, mut steps, mut dropped) = (0, 0, 0, 0, 0);
    let (mut nodes, mut looks, mut gathered) = (0u64, 0u64, 0);
    let mut most = 0.0f64;
    let (mut turned, mut went) = (0.0, 0.0);
    let mut last = pose(&walk);
    for k in 0..TICKS {
        let held = hand.proxy.pose().position;
        walk.step(
            front,
            held,
            pose(&walk).position,
            answer.contacts(),
            SPEED * PERIOD,
        );
        let goal = pose(&walk);
        turned += goal.orientation.angle_between(last.orientation);
        went += goal.position.distance(last.position);
        last = goal;
        let start = Instant::now();
        answer = hand.proxy.advance(front.surface(), &goal, BUDGET);
        times.push(start.elapsed().as_nanos() as u64);
        contact += usize::from(!answer.contacts().is_empty());
        unfinished += usize::from(!answer.ending.is_complete());
        steps += answer.steps;
        dropped += answer.dropped;
        nodes += u64::from(answer.work.node_pairs);
        looks += u64::from(answer.work.faces);
        gathered += usize::from(answer.work.node_pairs > 0);
        most = most.max(hand.proxy.pose().position.distance(goal.position));
        if k % 20 == 0 {
            met += usize::from(hand.meets(front));
        }
    }
    times.sort_unstable();
    let quantile = |share: f64| times[((times.len() - 1) as f64 * share) as usize] as f64 * 1e-3;
    let per = |sum: u64| sum as f64 / TICKS as f64;
    println!(
        "{name}: p50 {:.1} p99 {:.1} p999 {:.1} max {:.1} us; contact {contact} gathered {gathered} steps {:.2} node pairs {:.0} looks {:.0} dropped {dropped} unfinished {unfinished} met {met} high water {:?} farthest {most:.4} device {:.2e} m {:.2e} rad a tick",
        quantile(0.5),
        quantile(0.99),
        quantile(0.999),
        quantile(1.0),
        per(u64::from(steps)),
        per(nodes),
        per(looks),
        hand.proxy.high_water(),
        went / TICKS as f64,
        turned / TICKS as f64,
    );
    assert_eq!(met, 0, "{name}: a face meets the tool");
}

#[test]
#[ignore = "a measurement"]
fn sliding_over_the_dragon() {
    for model in ["dragon.obj", "stanford-bunny.obj"] {
        let whole = full_mesh(model, 100_000);
        let sides = whole
            .positions
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, u), p| {
                (l.min(*p), u.max(*p))
            });
        let front = Front::of_mesh(&scaled(&whole, SIZE / (sides.1 - sides.0).max_element()));
        println!(
            "{model}: {} faces, diagonal {:.3}",
            front.faces.len(),
            front.diagonal()
        );
        let diagonal = front.diagonal();
        let capsule = capsule_mesh(0.015 * diagonal, 0.1 * diagonal, 24, 20);
        let cylinder = cylinder_mesh(0.015 * diagonal, 0.1 * diagonal, 960);
        run("capsule on its tip", &front, &capsule, false);
        run("capsule lying", &front, &capsule, true);
        run("cylinder on its end", &front, &cylinder, false);
        run("cylinder lying", &front, &cylinder, true);
    }
}
