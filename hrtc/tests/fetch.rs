//! A controller without a file of the scene: station and controller over real iceoryx2, in one
//! process, each test in a domain and with a cache folder of its own. The station's folder is gone
//! before the controller starts.

use file_transfer::DownloadError;
use glam::DVec3;
use haptic_device::{Capabilities, Device, Pose, Sample, TickTime, WrenchCommand};
use hrtc::devices::DeviceRegistry;
use hrtc::fetch::{FetchError, FetchOptions, Fetched, fetch};
use hrtc::recorder::replay;
use hrtc::run::{RunArgs, run_with};
use hrtc::setup::ForceLimits;
use hrtc::tuning::OTHER_VERSION_HEARD;
use protocol::{Hello, PROTOCOL_VERSION, Role, file_chunks};
use scene::{FileKind, Overrides};
use scene_files::{FileCache, recordings_folder};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model, write_spm_file};
use station_core::station::Station;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;
use transport::Domain;
use ve_station::connection::Connection;
use ve_station::serve::{ServeArgs, ServeReport, serve};

const CLIENT: u64 = 0xF11E;
/// Longer than a station takes to come up on a busy machine.
const LONG: Duration = Duration::from_secs(60);

/// Runs a test as a process of its own with an empty cache folder and an empty folder of state:
/// they are named by variables of the process. Whether this is that process.
fn has_own_cache(test: &str) -> bool {
    const OWN: &str = "HRTC_TEST_HAS_OWN_CACHE";
    if std::env::var_os(OWN).is_some() {
        return true;
    }
    let [cache, state] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args([test, "--exact", "--nocapture"]);
    command.env(OWN, "1").env("HRTC_CACHE", cache.path());
    command.env("XDG_STATE_HOME", state.path());
    assert!(command.status().unwrap().success(), "{test}");
    false
}

fn write_model(path: &Path, faces: u32) {
    let mesh = generate(Shape::Sphere, faces, 1);
    let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
    write_spm_file(&parts, path).unwrap();
}

/// A ball, and what `text` adds to its scene.
fn ball(text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_model(&folder.path().join("ball.spm"), 2000);
    let object = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[loop]\ncore = -1\n";
    let text = object.to_owned() + &text.replace("FOLDER", folder.path().to_str().unwrap());
    std::fs::write(folder.path().join("ball.toml"), text).unwrap();
    folder
}

/// A ball with a tool and a path over it; the path names its folder.
fn ball_with_files() -> tempfile::TempDir {
    let probe = "[[probe]]\nshape = { mesh = { file = \"tool.spm\", size_m = 0.01, faces = 240 } }\n\
                 trajectory = { csv = \"FOLDER/path.csv\" }\n";
    let folder = ball(probe);
    write_model(&folder.path().join("tool.spm"), 400);
    let points = (0..20_000).map(|k| {
        let t = f64::from(k) * 1e-3;
        format!("{t},0,0,{}\n", 0.053 + 0.003 * (4.0 * t).cos())
    });
    std::fs::write(folder.path().join("path.csv"), points.collect::<String>()).unwrap();
    folder
}

/// Stops a station also when the test fails.
struct Stops<'a>(&'a AtomicBool);

impl Drop for Stops<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Serves a folder's scene, which is removed before `run` is called with the domain.
fn with_station<T>(
    test: &str,
    folder: tempfile::TempDir,
    run: impl FnOnce(&Domain) -> T,
) -> (T, ServeReport) {
    let domain = Domain::new(&format!("fetch-{test}-{}", std::process::id())).unwrap();
    let served = ServeArgs {
        scene: folder.path().join("ball.toml"),
        domain: domain.name().to_owned(),
        overrides: Overrides::default(),
        view: None,
        json: false,
    };
    let stop = AtomicBool::new(false);
    let outcome = thread::scope(|scope| {
        let station = scope.spawn(|| serve(&served, &stop).unwrap());
        // Its heartbeat says that all files are read.
        let node = domain.node().unwrap();
        let hello = domain.heartbeats(&node).unwrap();
        while hello.incoming.receive().unwrap().is_none() {
            thread::sleep(Duration::from_millis(1));
        }
        drop((hello, node));
        drop(folder);
        let stops = Stops(&stop);
        let outcome = run(&domain);
        drop(stops);
        (outcome, station.join().unwrap())
    });
    domain.remove_files();
    outcome
}

fn options(cache: Option<FileCache>) -> FetchOptions {
    FetchOptions {
        client: CLIENT,
        place: "in a test".to_owned(),
        station_timeout: LONG,
        cache,
    }
}

#[test]
fn a_run_without_a_scene_is_that_of_the_station_and_replays_alone() {
    if !has_own_cache("a_run_without_a_scene_is_that_of_the_station_and_replays_alone") {
        return;
    }
    let records = tempfile::tempdir().unwrap();
    let file = records.path().join("run.mcap");
    let (ended, report) = with_station("run", ball_with_files(), |domain| {
        let mut args = RunArgs::of_station(domain.name());
        args.seconds = Some(2.0);
        args.record = Some(file.clone());
        run_with(&DeviceRegistry::new(), &args, &AtomicBool::new(false))
    });
    ended.unwrap();
    assert!(report.file_chunks > 0);
    assert!(report.counters.records > 0, "nothing was refined");
    // Neither the cache nor the station is needed.
    let cache = std::env::var_os("HRTC_CACHE").unwrap();
    assert_eq!(std::fs::read_dir(&cache).unwrap().count(), 2);
    std::fs::remove_dir_all(&cache).unwrap();
    let found = replay(&file).unwrap();
    assert!(
        found.equal && found.whole && found.ticks > 1000,
        "{found:?}"
    );
}

/// Recordings of earlier runs are deleted for what is kept.
#[test]
fn how_much_of_recordings_is_kept_here_is_not_for_the_station_to_say() {
    if !has_own_cache("how_much_of_recordings_is_kept_here_is_not_for_the_station_to_say") {
        return;
    }
    let folder = recordings_folder().unwrap();
    let earlier = folder.join("earlier.mcap");
    for (keep, files) in [("1MiB", 2), ("off", 1)] {
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(&earlier, vec![0; 2 << 20]).unwrap();
        let scene = ball(&format!("[record]\nkeep = \"{keep}\"\n[[probe]]\n"));
        let (ended, _) = with_station("keep", scene, |domain| {
            let mut args = RunArgs::of_station(domain.name());
            args.seconds = Some(0.5);
            run_with(&DeviceRegistry::new(), &args, &AtomicBool::new(false))
        });
        ended.unwrap();
        assert!(earlier.exists(), "{keep}");
        // Beside it is the recording of this run, if the scene has any.
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), files, "{keep}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

#[test]
fn a_second_fetch_needs_the_manifest_only_and_a_damaged_file_comes_again() {
    let kept = tempfile::tempdir().unwrap();
    let cache = FileCache::new(kept.path());
    let (fetched, report) = with_station("cache", ball_with_files(), |domain| {
        let never = AtomicBool::new(false);
        let fetch = || fetch(domain, &options(Some(cache.clone())), &never).unwrap();
        let (first, second) = (fetch(), fetch());
        let path = &first.manifest.files;
        let path = path.iter().find(|of| of.kind == FileKind::Trajectory);
        let path = cache.path(FileKind::Trajectory, path.unwrap().hash);
        let mut content = std::fs::read(&path).unwrap();
        content[100] ^= 1;
        std::fs::write(&path, content).unwrap();
        [first, second, fetch()]
    });
    let [first, second, third] = &fetched;
    let same = |of: &Fetched| of.contents == first.contents && of.manifest == first.manifest;
    assert!(same(second) && same(third));
    assert_eq!([first.kept, second.kept, third.kept], [0, 2, 1]);
    let chunks = |kind| {
        let files = first.manifest.files.iter().filter(|of| of.kind == kind);
        files.map(|file| file_chunks(file.bytes)).sum::<u64>()
    };
    let (tool, path) = (chunks(FileKind::Tool), chunks(FileKind::Trajectory));
    assert!(tool > 1 && path > 100, "{tool} {path}");
    let manifest = second.chunks;
    assert_eq!(manifest, 1);
    assert_eq!(first.chunks, manifest + tool + path);
    assert_eq!(third.chunks, manifest + path);
    let sent = first.chunks + second.chunks + third.chunks;
    assert!(report.file_chunks >= sent);
}

/// Pushes into the ball, far deeper than it may push back.
struct Presser {
    ticks: u64,
    forces: Arc<Mutex<Vec<f64>>>,
    enough: Arc<AtomicBool>,
}

impl Device for Presser {
    fn capabilities(&self) -> Capabilities {
        Capabilities::translational("presser", 100.0)
    }
    fn read(&mut self, time: TickTime) -> Option<Sample> {
        self.ticks += u64::from(time.periods);
        // 2 s a push, from 14 mm above to 16 mm below the surface.
        let phase = std::f64::consts::TAU * (self.ticks % 2000) as f64 / 2000.0;
        let z = 0.049 + 0.015 * phase.cos();
        Some(Sample::at(Pose::at(DVec3::Z * z)))
    }
    fn write(&mut self, command: WrenchCommand) {
        let force = command.wrench.force.length();
        let mut forces = self.forces.lock().unwrap();
        let pushed_before = forces.last().is_some_and(|&force| force > 1.0);
        forces.push(force);
        // A whole push is over.
        let is_over = pushed_before && force < 1.0;
        self.enough.fetch_or(is_over, Ordering::Relaxed);
    }
    fn safe_off(&mut self) {}
}

/// The largest force of a run of the station's scene, newtons.
fn pushed(test: &str, plan_n: f64, told_n: f64) -> f64 {
    let scene = format!(
        "[safety]\nforce_max_n = {plan_n:?}\n[[probe]]\ndevice = {{ custom = {{ name = \"presser\" }} }}\n"
    );
    let forces = Arc::new(Mutex::new(Vec::new()));
    let enough = Arc::new(AtomicBool::new(false));
    let registry = {
        let (forces, enough) = (Arc::clone(&forces), Arc::clone(&enough));
        DeviceRegistry::new().with("presser", move |_| {
            Ok(Box::new(Presser {
                ticks: 0,
                forces: Arc::clone(&forces),
                enough: Arc::clone(&enough),
            }))
        })
    };
    let (ended, _) = with_station(test, ball(&scene), |domain| {
        let mut args = RunArgs::of_station(domain.name());
        args.seconds = Some(60.0);
        args.record = Some("off".into());
        args.limits = ForceLimits {
            max_force_n: Some(told_n),
            max_torque_nm: None,
        };
        run_with(&registry, &args, &enough)
    });
    ended.unwrap();
    assert!(enough.load(Ordering::Relaxed), "the ball never pushed");
    let forces = forces.lock().unwrap();
    forces.iter().copied().fold(0.0, f64::max)
}

#[test]
fn what_the_controller_is_told_of_force_wins_over_the_plan_and_only_downwards() {
    if !has_own_cache("what_the_controller_is_told_of_force_wins_over_the_plan_and_only_downwards")
    {
        return;
    }
    for (plan_n, told_n) in [(10.0, 3.0), (3.0, 10.0)] {
        let most = pushed("limits", plan_n, told_n);
        assert!(
            (2.9..=3.0 + 1e-9).contains(&most),
            "{plan_n}, {told_n}: {most} N"
        );
    }
}

#[test]
fn a_cache_that_cannot_be_written_costs_the_keeping_only() {
    let kept = tempfile::tempdir().unwrap();
    let file = kept.path().join("file");
    std::fs::write(&file, "").unwrap();
    let (fetched, _) = with_station("unwritable", ball_with_files(), |domain| {
        let cache = FileCache::new(&file.join("below"));
        fetch(domain, &options(Some(cache)), &AtomicBool::new(false))
    });
    let fetched = fetched.unwrap();
    assert_eq!((fetched.contents.len(), fetched.kept), (2, 0));
}

#[test]
fn where_no_scene_is_to_be_had_a_sentence_says_why() {
    let domain = Domain::new(&format!("fetch-none-{}", std::process::id())).unwrap();
    let never = AtomicBool::new(false);
    let soon = FetchOptions {
        station_timeout: Duration::from_millis(10),
        ..options(None)
    };
    let refused = fetch(&domain, &soon, &never).unwrap_err();
    assert!(matches!(refused, FetchError::NoStation { .. }), "{refused}");
    assert!(
        refused.to_string().contains("ve-station serve"),
        "{refused}"
    );
    let refused = fetch(&domain, &options(None), &AtomicBool::new(true)).unwrap_err();
    assert!(matches!(refused, FetchError::Stopped), "{refused}");

    let beside = |role: Role, options: &FetchOptions| {
        let stop = AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                let node = domain.node().unwrap();
                let hello = domain.heartbeats(&node).unwrap();
                let other = Hello::of_version(PROTOCOL_VERSION + 1, role, 1, 0);
                while !stop.load(Ordering::Relaxed) {
                    hello.outgoing.send_copy(other).unwrap();
                    thread::sleep(Duration::from_millis(10));
                }
            });
            let _stops = Stops(&stop);
            fetch(&domain, options, &never).unwrap_err()
        })
    };
    let refused = beside(Role::Station, &options(None));
    let version = format!("version {}", PROTOCOL_VERSION + 1);
    assert!(refused.to_string().contains(&version), "{refused}");
    // A controller is none, whatever it speaks.
    let longer = FetchOptions {
        station_timeout: 2 * OTHER_VERSION_HEARD,
        ..options(None)
    };
    let refused = beside(Role::Controller, &longer);
    assert!(matches!(refused, FetchError::NoStation { .. }), "{refused}");

    let stop = AtomicBool::new(false);
    let refused = thread::scope(|scope| {
        scope.spawn(|| {
            let station = Station::<Vec<u8>>::new(1, vec![], vec![]);
            Connection::open(&domain, station).unwrap().run(&stop);
        });
        let _stops = Stops(&stop);
        fetch(&domain, &options(None), &never).unwrap_err()
    });
    let is_none = matches!(refused, FetchError::Download(DownloadError::NoScene));
    assert!(is_none, "{refused}");
    domain.remove_files();
}
