//! What a report says and writes.

use super::page::contact_bands;
use super::*;
use geometry::Wrench;
use hrtc::result::{Accumulator, RunMeta};
use hrtc::tick_record::{STAGES, TickRecord};
use hrtc_core::Capacity;
use hrtc_core::bodies::MovedObject;
use hrtc_core::record::CoreRecord;
use realtime::pacer::Miss;
use scene::{MAX_PROBES, NoFiles, Overrides, parse};
use std::path::Path;

fn finished(contact: bool) -> Finished {
    let mut run = Accumulator::new(1_000_000, 1);
    for tick in 0..5000 {
        let touches = contact && tick % 1000 > 400;
        let mut wrenches = [Wrench::ZERO; MAX_PROBES];
        wrenches[0].force = glam::DVec3::X * f64::from(u8::from(touches));
        run.push(&TickRecord {
            tick,
            skipped: 0,
            misses: [Miss::default(); 2],
            wake_ns: 9_000,
            period_ns: 1_000_000,
            work_cpu_ns: 20_000,
            work_wall_ns: 20_000,
            stage_ns: [4_000; STAGES.len()],
            page_faults: 0,
            allocations: 0,
            chunks_arrived: 0,
            station: 1,
            wrenches,
            core: CoreRecord {
                contact: touches,
                contact_full: tick % 7 != 0,
                contact_bounded: true,
                ready: true,
                ..CoreRecord::default()
            },
            ..TickRecord::default()
        });
    }
    let mut finished = run.finish(RunMeta {
        scene: "a<b".to_string(),
        model: "m&n".to_string(),
        ..RunMeta::default()
    });
    finished.result.greatest_speed_m_per_s = 0.05;
    finished.result.contact_offset_m = 5e-6;
    finished.result.force_limit_n = 10.0;
    finished.result.rings_m = vec![0.0, 1e-5, 2e-4];
    finished.result.capacities = vec![Capacity::new("regions known", 100, 7)];
    finished
}

fn plan() -> ScenePlan {
    let scene = include_str!("../../../../../config/scenes/first-touch.toml");
    parse(scene, "s", Path::new(""), &Overrides::default(), &NoFiles).unwrap()
}

#[test]
fn a_report_is_written_whole_and_its_pictures_stand_in_it_and_beside_it() {
    let plan = plan();
    let folder = tempfile::tempdir().unwrap();
    let machine = Machine::read();
    for contact in [true, false] {
        let finished = finished(contact);
        let report = Report {
            plan: &plan,
            finished: &finished,
            machine: &machine,
            notes: &["a note".to_string()],
            picture: Some(b"png"),
        };
        let out = folder.path().join("deep/er");
        report.write(&out).unwrap();
        let page = std::fs::read_to_string(out.join("report.html")).unwrap();
        assert!(page.contains("a&lt;b on m&amp;n") && !page.contains("a<b"));
        assert_eq!(page.matches("<svg").count(), 3);
        assert_eq!(page.matches("src=").count(), 1);
        assert!(page.contains("src=\"touch.png\"") && out.join("touch.png").is_file());
        for name in ["force", "timing", "resolution"] {
            let svg = std::fs::read_to_string(out.join(format!("{name}.svg"))).unwrap();
            assert!(svg.contains("</svg>") && !svg.contains("NaN"));
        }
        let json = std::fs::read(out.join("result.json")).unwrap();
        let back: Finished = serde_json::from_slice(&json).unwrap();
        assert!(back.result.ticks == 5000 && back.series.len() == finished.series.len());
        assert_eq!(
            std::fs::read_dir(&out).unwrap().count(),
            6,
            "nothing half-written"
        );
        let words = report.words();
        assert!(words.contains(if contact {
            "in contact"
        } else {
            "nothing was touched"
        }));
        let thicker = "contacts act 5 µm off the surface";
        assert_eq!(words.contains(thicker), contact, "{words}");
        assert_eq!(words.contains("clamped, at 10 N"), contact, "{words}");
        assert!(words.contains("a note"));
        assert!(words.contains("rings around it for 10 µm, 200 µm"));
        assert!(words.contains("regions known: at most 7 of 100 in use"));
        assert!(words.contains("0.050 m/s") && words.contains("resolution follows speed"));
    }
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let finished = finished(false);
    let report = Report {
        plan: &plan,
        finished: &finished,
        machine: &machine,
        notes: &[],
        picture: None,
    };
    assert_eq!(report.write(&file).unwrap_err().status(), 2);
}

#[test]
fn contact_is_banded_where_it_was() {
    let finished = finished(true);
    let bands = contact_bands(&finished.series);
    assert_eq!(bands.len(), 5, "{bands:?}");
    for (index, (from, to)) in bands.iter().enumerate() {
        assert!((from - (index as f64 + 0.4)).abs() < 0.01);
        assert!((to - (index as f64 + 1.0)).abs() < 0.01);
    }
}

#[test]
fn where_nothing_is_touched_no_error_and_no_resolution_is_drawn() {
    let (plan, finished, machine) = (plan(), finished(true), Machine::read());
    let report = Report {
        plan: &plan,
        finished: &finished,
        machine: &machine,
        notes: &[],
        picture: None,
    };
    let charts = report.resolution_charts();
    for curve in charts[1..].iter().map(|chart| &chart.curves[0]) {
        assert_eq!(curve.points.len(), finished.series.len(), "{}", curve.label);
        for ((_, height, _), bucket) in curve.points.iter().zip(&finished.series) {
            assert_eq!(height.is_nan(), bucket.contact_ticks == 0, "{bucket:?}");
        }
    }
}

#[test]
fn figures_of_several_objects_are_not_said_of_the_first() {
    let (plan, mut finished, machine) = (plan(), finished(true), Machine::read());
    let r = &mut finished.result;
    (r.faces, r.objects, r.active_objects_max) = (20_022, 4, 3);
    r.torque_nm_max = 1.5e-3;
    r.moved = vec![MovedObject {
        object: 1,
        position_m: [0.2, -0.0, -4e-5],
        orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
        turned_rad: 0.0,
        farthest_m: 0.01,
        awake_ticks: 7,
    }];
    let report = Report {
        plan: &plan,
        finished: &finished,
        machine: &machine,
        notes: &[],
        picture: None,
    };
    let words = report.words();
    assert!(
        words.contains("max 0 of all objects that were awake"),
        "{words}"
    );
    assert!(
        words.contains("4 objects, of which 3 can be awake"),
        "{words}"
    );
    assert_eq!(
        words
            .matches("(of one of the objects that were awake")
            .count(),
        2
    );
    assert!(words.contains("first model m&n (20"), "{words}");
    assert!(words.contains("at (0.2000, 0.0000, 0.0000) m"), "{words}");
    assert!(words.contains("torque max 1.5 mN m"), "{words}");
}

#[test]
fn records_that_are_lost_are_said_in_place_of_a_run_without_a_miss() {
    let mut r = finished(false).result;
    assert_eq!(missed(&r).len(), 1);
    assert!(missed(&r)[0].starts_with("no period missed"));
    r.unaccounted_periods = 3;
    let said = missed(&r);
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].starts_with("3 period(s) are not in these figures"));
    r.missed = 2;
    assert!(missed(&r)[0].starts_with("2 period(s) missed") && missed(&r).len() == 2);
}

#[test]
fn energy_that_was_pushed_in_before_the_end_is_said() {
    let only_out = energy_words(-7e-3, 0.0, false);
    assert!(
        only_out.contains("took 7.000 mJ out and pushed none in"),
        "{only_out}"
    );
    let both = energy_words(-7e-3, 2e-3, false);
    assert!(
        both.contains("7.000 mJ out in all") && both.contains("up to 2.000 mJ in"),
        "{both}"
    );
    for has_effects in [false, true] {
        let pushed = energy_words(1e-3, 2e-3, has_effects);
        assert!(pushed.contains("pushed 1.000 mJ into the hand"), "{pushed}");
        assert_eq!(pushed.contains("a magnet"), has_effects, "{pushed}");
    }
}

#[test]
fn errors_of_no_contact_are_none_and_not_zero() {
    assert_eq!(errors(&ShortSpread::default(), 0), "none");
    assert_eq!(errors(&ShortSpread::default(), 1), "p50 0, max 0");
}
