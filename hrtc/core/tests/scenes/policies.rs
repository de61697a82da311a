//! Both policies of detail end at what is asked for where there is time, and keep a tick's budget
//! where there is not; the more important object is finer under both.

use crate::common::{World, scene_plan, scene_world, spm};
use glam::DVec3;
use hrtc_core::governor::{CostGroup, MeasuredTick, WorkCosts};
use scene::PolicyPlan;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

const SIZE_M: f64 = 0.1;
const POLICIES: [PolicyPlan; 2] = [PolicyPlan::Predictive, PolicyPlan::Reactive];

/// Two equal balls, each touched by a probe alike, on a machine so many times slower.
fn start(policy: PolicyPlan, importances: [f64; 2], slow: f64) -> World {
    let centre = |k: usize| DVec3::X * (0.2 * k as f64);
    let balls = [0, 1].map(|k| ("sphere", SIZE_M, centre(k)));
    let mut plan = scene_plan(&balls, 2, 16 << 20);
    plan.accuracy.policy = policy;
    for (object, importance) in plan.objects.iter_mut().zip(importances) {
        object.importance = importance;
    }
    let sphere = spm(
        generate(Shape::Sphere, 200_000, 1),
        &BuildOptions::default(),
    );
    let mut world = scene_world(&plan, &[("sphere", &sphere)], 0.0);
    let costs = WorkCosts::REFERENCE.scaled([slow; CostGroup::ALL.len()]);
    world.controller_mut().set_costs(costs);
    world
}

/// Ticks in which a probe touched, those of them at full resolution, and the mean distance of the
/// contact from the ball, metres.
#[derive(Debug, Clone, Copy, Default)]
struct Touch {
    contacts: u64,
    full: u64,
    away_m: f64,
}

/// Presses and slides for so many ticks: the touch of each probe, and the changes of the finest
/// tolerance.
fn stroke(world: &mut World, rad_per_tick: f64, ticks: u64) -> ([Touch; 2], u64) {
    let (mut touches, mut changes, mut before) = ([Touch::default(); 2], 0, f64::NAN);
    for tick in 0..ticks {
        let angle = rad_per_tick * tick as f64;
        let out = DVec3::new(angle.sin(), 0.0, angle.cos());
        let places = [0, 1].map(|k| Some(DVec3::X * (0.2 * k as f64) + 0.5 * SIZE_M * out));
        let outputs = world.step_places(&places);
        let (record, contacts) = (outputs.record, outputs.contacts.clone());
        let now = record.finest_tolerance_m;
        changes += u64::from(std::mem::replace(&mut before, now) != now);
        for ((sum, of), touched) in touches.iter_mut().zip(&record.probes).zip(contacts) {
            assert!(!of.contact || of.contact_bounded);
            sum.full += u64::from(of.contact_full);
            if let Some(touched) = touched {
                sum.contacts += 1;
                // The ball of the model has a radius of one.
                let away = 1.0 - touched.contact.point.length();
                sum.away_m += 0.5 * SIZE_M * away.abs();
            }
        }
        world
            .controller_mut()
            .note_work(MeasuredTick::of_work(record.spent_ns));
    }
    for sum in &mut touches {
        // No number without a contact.
        sum.away_m /= sum.contacts as f64;
    }
    (touches, changes)
}

#[test]
fn with_time_both_end_at_full_resolution_and_stay_there() {
    for policy in POLICIES {
        let mut world = start(policy, [1.0; 2], 1.0);
        stroke(&mut world, 0.0, 1000);
        let (touches, changes) = stroke(&mut world, 2e-4, 2000);
        println!("{policy:?}: {touches:?}, {changes} changes");
        // The first tick counts as a change.
        assert_eq!(changes, 1, "{policy:?}");
        assert!(touches.iter().all(|of| of.full >= 1990), "{policy:?}");
    }
}

#[test]
fn without_time_both_get_coarser_and_the_more_important_object_less() {
    for policy in POLICIES {
        let mut world = start(policy, [1.0, 4.0], 12.0);
        stroke(&mut world, 0.0, 1000);
        let ([less, more], _) = stroke(&mut world, 2.5e-3, 3000);
        println!("{policy:?}: {less:?} {more:?}");
        assert!(less.contacts.min(more.contacts) > 1500, "{policy:?}");
        assert!(less.full < 3000, "{policy:?}");
        assert!(more.away_m < less.away_m, "{policy:?}");
    }
}
