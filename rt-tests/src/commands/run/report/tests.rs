//! What a report says and writes.

use super::page::contact_bands;
use super::*;
use geometry::Wrench;
use hrtc::result::{Accumulator, RunMeta};
use hrtc::tick_record::{STAGES, TickRecord};
use hrtc_core::Capacity;
use hrtc_core::record::CoreRecord;
use realtime::pacer::Miss;
use scene::{MAX_PROBES, NoFiles, Overrides, parse};
use std::path::Path;

fn finished(contact: bool) -> Finished {
    let mut run = Accumulator::new(1_000_000, 1).unwrap();
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

#[test]
fn a_report_is_written_whole_and_its_pictures_stand_in_it_and_beside_it() {
    let scene = include_str!("../../../../../config/scenes/first-touch.toml");
    let plan = parse(scene, "s", Path::new(""), &Overrides::default(), &NoFiles).unwrap();
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
        assert_eq!(words.contains("clamped at 10 N"), contact, "{words}");
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
