use super::*;
use spm_builder::NoProgress;
use spm_builder::write_mesh;
use std::cell::RefCell;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::SystemTime;

fn mesh_file(folder: &Path, name: &str, shape: Shape) -> PathBuf {
    let path = folder.join(name);
    write_mesh(&generate::generate(shape, 600, 1), &path).unwrap();
    path
}

fn built(cache: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(cache)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    files.sort();
    files
}

/// Counts the phases that a build goes through.
#[derive(Default)]
struct Phases(AtomicU32);

impl Progress for Phases {
    fn phase(&self, _: &'static str, _: u64) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
    fn done(&self, _: u64) {}
}

#[test]
fn a_mesh_file_is_built_once_and_again_when_its_content_changes() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let path = mesh_file(folder.path(), "m.obj", Shape::Sphere);
    let phases = Phases::default();
    let first = open_mesh(&path, &cache, &phases).unwrap().model_header();
    let after_first = phases.0.load(Ordering::Relaxed);
    assert!(after_first > 0);
    assert_eq!(
        open_mesh(&path, &cache, &phases).unwrap().model_header(),
        first
    );
    assert_eq!(
        phases.0.load(Ordering::Relaxed),
        after_first,
        "not built again"
    );
    assert_eq!(built(&cache).len(), 1);
    mesh_file(folder.path(), "m.obj", Shape::Torus);
    assert_ne!(
        open_mesh(&path, &cache, &phases).unwrap().model_header(),
        first
    );
    assert_eq!(built(&cache).len(), 2);
}

/// Replaces a mesh file while its build waits for another one, and ends that.
struct Replaces<'a> {
    path: &'a Path,
    other_build: RefCell<Option<File>>,
}

impl Progress for Replaces<'_> {
    fn phase(&self, name: &'static str, _: u64) {
        if name == "waiting for another build" {
            write_mesh(&generate::generate(Shape::Torus, 600, 1), self.path).unwrap();
            drop(self.other_build.take());
        }
    }
    fn done(&self, _: u64) {}
}

#[test]
fn a_mesh_file_that_is_replaced_before_its_build_is_not_cached_as_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    fs::create_dir(&cache).unwrap();
    let path = mesh_file(folder.path(), "m.obj", Shape::Sphere);
    let lock = File::open(&cache).unwrap();
    lock.lock().unwrap();
    let replaces = Replaces {
        path: &path,
        other_build: RefCell::new(Some(lock)),
    };
    let error = open_mesh(&path, &cache, &replaces).unwrap_err();
    assert!(replaces.other_build.borrow().is_none(), "it has waited");
    assert!(matches!(error, DatabaseError::Changed { .. }), "{error}");
    assert!(error.to_string().contains("m.obj was replaced"), "{error}");
    assert!(built(&cache).is_empty());
    let torus = open_mesh(&path, &cache, &NoProgress).unwrap();
    mesh_file(folder.path(), "m.obj", Shape::Sphere);
    let sphere = open_mesh(&path, &cache, &NoProgress).unwrap();
    assert_ne!(torus.model_header(), sphere.model_header());
}

#[test]
fn a_mesh_file_with_a_long_name_is_built_once_too() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let name = format!("{}.obj", "\u{fc}".repeat(120));
    let path = mesh_file(folder.path(), &name, Shape::Sphere);
    let [first, second] = [(); 2].map(|()| {
        let phases = Phases::default();
        open_mesh(&path, &cache, &phases).unwrap();
        phases.0.into_inner()
    });
    assert!(first > 0);
    assert_eq!(second, 0, "not built again");
}

#[test]
fn a_damaged_file_of_the_cache_is_built_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = mesh_file(folder.path(), "m.obj", Shape::Sphere);
    let sound = open_mesh(&path, folder.path(), &NoProgress)
        .unwrap()
        .model_header();
    let cached = built(folder.path())
        .into_iter()
        .find(|p| p.extension().unwrap() == "spm")
        .unwrap();
    fs::remove_file(&cached).unwrap();
    fs::write(&cached, b"hrtc-spm, but cut short").unwrap();
    assert_eq!(
        open_mesh(&path, folder.path(), &NoProgress)
            .unwrap()
            .model_header(),
        sound
    );
}

#[test]
fn a_damaged_block_in_the_middle_of_a_cached_file_is_built_again() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let path = mesh_file(folder.path(), "m.obj", Shape::Terrain);
    open_mesh(&path, &cache, &NoProgress).unwrap();
    let cached = built(&cache).remove(0);
    let sound = fs::read(&cached).unwrap();
    let mut damaged = sound.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    fs::write(&cached, damaged).unwrap();
    open_mesh(&path, &cache, &NoProgress)
        .unwrap()
        .check_all()
        .unwrap();
    assert_eq!(fs::read(&cached).unwrap(), sound);
}

#[test]
fn what_killed_builds_and_other_versions_left_is_removed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let path = mesh_file(folder.path(), "m.obj", Shape::Sphere);
    open_mesh(&path, &cache, &NoProgress).unwrap();
    let cached = built(&cache).remove(0);
    let name = cached.file_name().unwrap().to_string_lossy().into_owned();
    let old = name.replace(&versions(), "b1f1");
    let kept = [
        "sphere-600-1-b1f1.spm",
        "notes.txt",
        &name.replace(&versions(), "bright"),
    ];
    for file in kept.iter().copied().chain([".ve-station-killed", &old]) {
        fs::write(cache.join(file), b"left").unwrap();
    }
    let killed = cache.join(".ve-station-killed");
    let killed = File::options().write(true).open(killed).unwrap();
    killed.set_modified(SystemTime::UNIX_EPOCH).unwrap();
    // Somebody writes it.
    let written = cache.join(".ve-station-written");
    let writer = File::create(&written).unwrap();
    writer.lock().unwrap();
    fs::remove_file(&cached).unwrap();
    open_mesh(&path, &cache, &NoProgress).unwrap();
    let mut expected: Vec<PathBuf> = kept.iter().map(|file| cache.join(file)).collect();
    expected.extend([cached, written]);
    expected.sort();
    assert_eq!(built(&cache), expected);
}

/// With files that are as long as models, but hold nothing.
#[test]
fn of_too_many_built_models_those_go_that_were_not_used_for_longest() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    fs::create_dir(&cache).unwrap();
    let make = |name: &str, bytes: u64, used: SystemTime| {
        let file = File::create(cache.join(name)).unwrap();
        file.set_len(bytes).unwrap();
        file.set_modified(used).unwrap();
    };
    // One that could not be renamed is a model too.
    let old = ["unrenamed-a-0", "b-0", "c-0"];
    let long_ago = |days: u32| SystemTime::UNIX_EPOCH + days * KEPT;
    for (days, name) in (0..).zip(old) {
        make(&format!("{name}-b1f1.spm"), 6 << 30, long_ago(days));
    }
    make("of-today-b1f1.spm", 6 << 30, SystemTime::now());
    make("not-ours.spm", 6 << 30, long_ago(0));
    let others = || {
        let is_there = |name: &&str| cache.join(format!("{name}-b1f1.spm")).exists();
        let of = old.into_iter().chain(["of-today"]);
        of.filter(is_there).collect::<Vec<_>>()
    };
    let open = |shape: Shape| {
        let path = mesh_file(folder.path(), &format!("{shape}.obj"), shape);
        open_mesh(&path, &cache, &NoProgress).unwrap();
        path
    };
    let sphere = open(Shape::Sphere);
    assert_eq!(others(), ["c-0", "of-today"]);
    // Used again, it is not the next that goes; of what is used there may be more.
    let name = content_name(&sphere, &fs::read(&sphere).unwrap());
    let built = cache.join(format!("{name}-{}.spm", versions()));
    make("of-today-b1f1.spm", 20 << 30, SystemTime::now());
    let file = File::options().write(true).open(&built).unwrap();
    file.set_modified(long_ago(0)).unwrap();
    open(Shape::Sphere);
    open(Shape::Torus);
    assert_eq!(others(), ["of-today"]);
    assert!(built.exists());
    assert!(cache.join("not-ours.spm").exists());
}

#[test]
fn of_several_that_need_a_model_one_builds_it() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let path = mesh_file(folder.path(), "m.obj", Shape::Torus);
    let alone = Phases::default();
    open_mesh(&path, &folder.path().join("another"), &alone).unwrap();
    let phases: Vec<Phases> = (0..4).map(|_| Phases::default()).collect();
    std::thread::scope(|scope| {
        for phases in &phases {
            scope.spawn(|| open_mesh(&path, &cache, phases).unwrap());
        }
    });
    let whole = alone.0.into_inner();
    // The others go through one phase at the most: they wait.
    let builds = phases
        .iter()
        .filter(|phases| phases.0.load(Ordering::Relaxed) >= whole);
    assert_eq!(builds.count(), 1);
}

#[test]
fn two_that_build_the_same_model_at_once_end_with_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let path = mesh_file(folder.path(), "m.obj", Shape::Torus);
    let heads: Vec<_> = std::thread::scope(|scope| {
        let builders: Vec<_> = (0..4)
            .map(|_| {
                scope.spawn(|| {
                    open_mesh(&path, &cache, &NoProgress)
                        .unwrap()
                        .model_header()
                })
            })
            .collect();
        builders.into_iter().map(|b| b.join().unwrap()).collect()
    });
    assert!(heads.iter().all(|h| *h == heads[0]));
    assert_eq!(built(&cache).len(), 1, "no temporary file is left");
}

/// A scene of a folder with an object of each of these models.
fn scene_of(folder: &Path, models: &[&str]) -> ScenePlan {
    let objects: String = models
        .iter()
        .map(|model| format!("[[object]]\nmodel = \"{model}\"\nsize_m = 0.1\n"))
        .collect();
    let text = format!("{objects}[[probe]]\n");
    let overrides = scene::Overrides::default();
    scene::parse(&text, "test", folder, &overrides, &scene::NoFiles).unwrap()
}

#[test]
fn different_models_of_one_file_name_are_refused_and_copies_are_not() {
    let folder = tempfile::tempdir().unwrap();
    for (scan, shape) in [
        ("scan1", Shape::Sphere),
        ("scan2", Shape::Torus),
        ("copy", Shape::Sphere),
    ] {
        let scan = folder.path().join(scan);
        fs::create_dir(&scan).unwrap();
        let mesh = generate::generate(shape, 600, 1);
        build_into(mesh, &scan.join("mesh.spm"), &NoProgress).unwrap();
    }
    let open = |models: &[&str]| Database::open(&scene_of(folder.path(), models), &NoProgress);
    let copies = open(&["scan1/mesh.spm", "copy/mesh.spm", "scan1/mesh.spm"]).unwrap();
    assert_eq!(copies.models.len(), 1);
    let refused = open(&["scan1/mesh.spm", "copy/mesh.spm", "scan2/mesh.spm"]);
    let sentence = refused.unwrap_err().to_string();
    for part in ["scan1/mesh.spm", "scan2/mesh.spm", "\"mesh.spm\"", "rename"] {
        assert!(sentence.contains(part), "{sentence}");
    }
}

#[test]
fn two_objects_of_one_model_share_its_map() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = generate::generate(Shape::Sphere, 600, 1);
    for name in ["a.spm", "copy.spm"] {
        build_into(mesh.clone(), &folder.path().join(name), &NoProgress).unwrap();
    }
    build_into(
        generate::generate(Shape::Torus, 600, 1),
        &folder.path().join("other.spm"),
        &NoProgress,
    )
    .unwrap();
    let plan = scene_of(folder.path(), &["a.spm", "other.spm", "a.spm", "copy.spm"]);
    let database = Database::open(&plan, &NoProgress).unwrap();
    let models: Vec<usize> = database.objects.iter().map(|o| o.model).collect();
    assert_eq!(models, [0, 1, 0, 0]);
    assert_eq!(database.models.len(), 2);
    assert_ne!(database.objects[0].name, database.objects[3].name);
}

#[test]
fn what_cannot_be_opened_is_named_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("text.spm"), "not an SPM").unwrap();
    fs::write(at("empty.spm"), "").unwrap();
    fs::write(at("empty.obj"), "").unwrap();
    fs::write(
        at("nan.obj"),
        "v nan nan nan\nv nan 0 0\nv 0 nan 0\nf 1 2 3\n",
    )
    .unwrap();
    fs::create_dir(at("folder.spm")).unwrap();
    for name in [
        "missing.spm",
        "missing.obj",
        "text.spm",
        "empty.spm",
        "empty.obj",
        "nan.obj",
        "folder.spm",
    ] {
        let source = at(name);
        let result = if spm_builder::is_mesh_file(&source) {
            open_mesh(&source, &at("cache"), &NoProgress)
        } else {
            open_spm(&source)
        };
        let sentence = result
            .err()
            .unwrap_or_else(|| panic!("{name} was opened"))
            .to_string();
        assert!(sentence.contains(name), "{sentence}");
        assert!(!sentence.contains('\n'), "{sentence}");
    }
    let left = at("cache");
    assert!(
        !left.exists() || built(&left).is_empty(),
        "nothing half-built is left"
    );
}
