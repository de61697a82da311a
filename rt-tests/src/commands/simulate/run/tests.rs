//! Runs that are changed after they were drawn.

use super::*;
use crate::commands::simulate::scenario::Reduction;
use std::collections::BTreeSet;

/// A seed without any fault.
fn without_faults(library: &Library) -> Scenario {
    let reduction = Reduction {
        only: Some(BTreeSet::new()),
        ..Reduction::default()
    };
    Scenario::draw(19, &reduction, library).expect("the scene is good")
}

#[test]
fn a_touch_that_comes_only_after_the_faults_is_none_during_them() {
    let library = Library::build().expect("the models are built");
    let mut scenario = without_faults(&library);
    let touched = {
        let mut run = Run::new(&scenario, &library).expect("the scene is served");
        run.all(&mut Trace::default()).expect("nothing is wrong")
    };
    assert!(touched.contact_in_faults.is_some());
    for path in scenario.hands.iter_mut().flatten() {
        *path = path.clone().hovering();
    }
    let mut run = Run::new(&scenario, &library).expect("the scene is served");
    let (check, found) = run.all(&mut Trace::default()).expect_err("it hovers");
    assert_eq!(check, "touched during the faults", "{found}");
}

/// What a station loses that ends or is silent, or a cut link while its controller stalls, no
/// controller meets as loss by chance.
#[test]
fn what_events_lose_is_no_loss_by_chance() {
    let library = Library::build().expect("the models are built");
    let mut scenario = without_faults(&library);
    // Much is under way, and the chance never comes.
    (scenario.link.delay_ticks, scenario.link.loss) = (40, 1e-300);
    let cases: [&[(Kind, [u64; 2])]; 3] = [
        &[(Kind::StationRestart, [0, 1])],
        &[(Kind::StationSilent, [0, 30])],
        &[(Kind::Cut, [0, 40]), (Kind::Stalls, [30, 50])],
    ];
    for kinds in cases {
        scenario.events.clear();
        for at in [800, 1100, 1400, 1700] {
            let event = |&(kind, [from, to]): &(Kind, [u64; 2])| Event {
                kind,
                client: 0,
                from: at + from,
                to: at + to,
            };
            scenario.events.extend(kinds.iter().map(event));
        }
        let mut run = Run::new(&scenario, &library).expect("the scene is served");
        let mut trace = Trace::default();
        let (mut before, mut in_contact) = (0, 0);
        for tick in 0..1800 {
            run.change(tick, &mut trace).expect("nothing is wrong");
            run.tick(tick, &mut trace).expect("nothing is wrong");
            let (is_touching, last_tick) = (run.sides[0].is_touching, run.sides[0].last_tick);
            if last_tick == Some(tick) {
                let link = run.simulation.clients_mut()[0].link();
                let lost: u64 = link.counts().lost.iter().sum();
                if is_touching && !link.is_cut() {
                    in_contact += lost - before;
                }
                before = lost;
            }
        }
        assert!(in_contact > 0, "{kinds:?} lose nothing in contact");
        let met = &run.coverage.in_contact;
        assert!(!met.contains_key(&Kind::Loss), "{kinds:?}: {met:?}");
    }
}

#[test]
fn a_controller_that_is_started_within_a_stall_begins_after_it() {
    let library = Library::build().expect("the models are built");
    let mut scenario = without_faults(&library);
    let event = |kind, [from, to]: [u64; 2]| Event {
        kind,
        client: 0,
        from,
        to,
    };
    scenario.events = vec![
        event(Kind::Stalls, [20, 40]),
        event(Kind::ControllerRestart, [30, 31]),
    ];
    let mut run = Run::new(&scenario, &library).expect("the scene is served");
    let mut trace = Trace::default();
    for tick in 0..41 {
        assert_eq!(run.simulation.tick(), tick);
        run.change(tick, &mut trace).expect("nothing is wrong");
        run.tick(tick, &mut trace).expect("nothing is wrong");
        assert_eq!(run.sides[0].is_new, (30..40).contains(&tick), "{tick}");
    }
}
