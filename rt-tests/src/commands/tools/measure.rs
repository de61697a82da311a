//! A tool led over a model, and beside every tick a reference: the same proxy from the same state,
//! with no limit to its work.

use super::check_stop;
use super::row::{Row, TickDifference, TickSums};
use crate::failure::Failure;
use crate::trajectory::virtual_scene::{make_ready_led, virtual_scene};
use glam::DVec3;
use hrtc_core::contact::coupling::Coupling;
use hrtc_core::contact::motion::Twist;
use hrtc_core::contact::rigid_proxy::{StepSettings, ToolProxy};
use hrtc_core::record::max_or_nan;
use hrtc_core::{Stage, StageObserver, ToolBefore};
use scene::ScenePlan;
use simulator::Drive;
use std::sync::atomic::AtomicBool;

/// Steps of the reference in its tick, eight times the product's. That it is not settled then is
/// counted.
const REFERENCE: StepSettings = StepSettings {
    max_steps: 256,
    ..StepSettings::PRODUCT
};

/// Where a proxy is after a tick.
#[derive(Debug, Clone)]
struct Placed {
    /// Force of the coupling without damping, newtons.
    force: DVec3,
    /// Centres of its parts, model units.
    centres: Vec<DVec3>,
    /// Whether nothing of its motion remains.
    is_settled: bool,
}

/// The reference, run before the product's own step.
struct Reference {
    spring: Coupling,
    metres_per_unit: f64,
    placed: Option<Placed>,
}

fn centres(proxy: &ToolProxy) -> Vec<DVec3> {
    proxy.parts(&proxy.pose()).map(|part| part.centre).collect()
}

impl StageObserver for Reference {
    fn ended(&mut self, _: Stage) {}

    fn tool_before(&mut self, probe: usize, tool: &ToolBefore<'_>) {
        if probe != 0 {
            return;
        }
        let mut proxy = tool.proxy.clone();
        proxy.set_steps(REFERENCE);
        let moved = proxy.advance(tool.surface, &tool.goal, u32::MAX);
        let still = Twist::default();
        self.placed = Some(Placed {
            force: proxy
                .wrench(&self.spring, self.metres_per_unit, &still)
                .force,
            centres: centres(&proxy),
            is_settled: moved.ending.is_complete() && !moved.is_unsettled && !moved.is_stuck,
        });
    }
}

/// Ticks between two looks at the flag that ends a measurement.
const LOOK_TICKS: u64 = 256;

/// Leads the tool of a scene over its object, for so many seconds.
///
/// # Errors
/// When the model cannot be served, the tool touches nothing, or `stop` is set: a part of a tour is
/// no row.
pub fn measure(
    plan: &ScenePlan,
    names: [&str; 2],
    seed: u64,
    seconds: f64,
    stop: &AtomicBool,
) -> Result<Row, Failure> {
    check_stop(stop)?;
    let (mut simulation, _) = virtual_scene(plan, seconds)?;
    make_ready_led(&mut simulation)?;
    let frame = simulation.controller().frame();
    let metres_per_unit = frame.map_or(1.0, |frame| frame.metres_per_unit);
    let stiffness_n_per_m = plan.objects[0].surface.stiffness_n_per_m;
    let spring = Coupling {
        stiffness_n_per_m,
        damping_ns_per_m: 0.0,
    };
    let mut reference = Reference {
        spring,
        metres_per_unit,
        placed: None,
    };
    let mut sums = TickSums::new(names, seed, stiffness_n_per_m);
    let ticks = (seconds * plan.loop_.rate_hz).round() as u64;
    let mut device = None;
    for tick in 0..ticks {
        if tick.is_multiple_of(LOOK_TICKS) {
            check_stop(stop)?;
        }
        reference.placed = None;
        let outputs = simulation.advance(Drive::Hands, &mut reference);
        let record = outputs.record;
        let sample = simulation.client().samples()[0];
        let before = std::mem::replace(&mut device, sample.map(|sample| sample.pose.position));
        let Some(expected) = &reference.placed else {
            sums.skip();
            continue;
        };
        let tool = simulation.controller().active_objects()[0].tool(0);
        let Some(tool) = tool else {
            sums.skip();
            continue;
        };
        let still = Twist::default();
        let apart = centres(tool).into_iter().zip(&expected.centres);
        let apart = apart.map(|(here, there)| here.distance(*there));
        sums.add(&TickDifference {
            force: tool.wrench(&spring, metres_per_unit, &still).force,
            expected: expected.force,
            behind_m: apart.fold(0.0, max_or_nan) * metres_per_unit,
            is_late: record.late_contacts > 0,
            is_contact: record.contact,
            is_settled: expected.is_settled,
            units: record.query_work,
            travelled_m: device.zip(before).map_or(0.0, |(a, b)| a.distance(b)),
        });
    }
    if sums.contact_ticks() == 0 {
        return Err(Failure::Run(format!(
            "{} seed {seed}: the tool touches nothing: give more with --seconds",
            names[0]
        )));
    }
    Ok(sums.row())
}
