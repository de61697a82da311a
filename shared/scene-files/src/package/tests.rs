use super::*;
use crate::NotingFiles;
use proptest::prelude::*;
use scene::{Effect, Pattern, ProbeShape, ScenePlan};
use spm::{SpmParts, write_spm};
use std::fs;

/// A scene that names a file of every kind, in a folder of its own.
struct OnDisk {
    folder: tempfile::TempDir,
    scene: PathBuf,
}

const TEXT: &str = r#"
# Of FOLDER.
[record]
path = "FOLDER/run.mcap"
[[effects]]
texture = { amplitude_m = 1e-4, height_map = { file = "FOLDER/map.png", width_m = 0.1 } }
[[object]]
name = "ground"
model = "FOLDER/models/ground.spm"
size_m = 0.30000000000000004
effects = [{ texture = { amplitude_m = 2e-4, height_map = { file = "map.png", width_m = 0.2 } } }]
[[object]]
generate = { shape = "sphere", faces = 1000 }
size_m = 0.1
pose = { position_m = [0.0, 0.0, 5] }
[[probe]]
shape = { mesh = { file = "tools/tool.spm", size_m = 0.01 } }
trajectory = { csv = "FOLDER/path.csv" }
[[probe]]
trajectory = { tour = { object = "ground", speed_m_per_s = 0.05 } }
"#;

impl OnDisk {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("tools")).unwrap();
        let mut tool = Vec::new();
        write_spm(&SpmParts::hexagon(), &mut tool).unwrap();
        fs::write(at("tools/tool.spm"), tool).unwrap();
        fs::write(at("path.csv"), "0,0,0,0.1\n1,0,0,0.3\n").unwrap();
        let mut picture = png::Encoder::new(fs::File::create(at("map.png")).unwrap(), 2, 2);
        picture.set_color(png::ColorType::Grayscale);
        let mut picture = picture.write_header().unwrap();
        picture.write_image_data(&[0, 50, 100, 150]).unwrap();
        picture.finish().unwrap();
        let scene = at("all kinds.toml");
        let text = TEXT.replace("FOLDER", folder.path().to_str().unwrap());
        fs::write(&scene, text).unwrap();
        Self { folder, scene }
    }

    /// The plan as this machine has it, and the package for others.
    fn packed(&self, overrides: &Overrides) -> (ScenePlan, Package) {
        let noting = NotingFiles::default();
        let plan = scene::load(&self.scene, overrides, &noting).unwrap();
        let package = Package::new(&self.scene, overrides, &noting.into_kept()).unwrap();
        (plan, package)
    }
}

/// The plan from a package alone.
fn unpacked(package: &Package, own: &Overrides) -> Result<ScenePlan, SceneError> {
    let manifest = Manifest::read(&package.contents[&package.manifest]).unwrap();
    let files = manifest.files.iter();
    let contents = files.map(|file| (file.name(), package.contents[&file.hash].clone()));
    let overrides = manifest.under(own);
    let kept = manifest.kept(&overrides, contents.collect());
    scene::load(&manifest.path(), &overrides, &kept)
}

/// The plan without what may differ between machines: paths, and names made of them.
fn without_paths(mut plan: ScenePlan) -> ScenePlan {
    plan.folder = PathBuf::new();
    plan.record.path = None;
    for object in &mut plan.objects {
        if let scene::ModelSource::File(path) = &mut object.model {
            *path = path.file_name().unwrap().into();
        }
    }
    for probe in &mut plan.probes {
        if let ProbeShape::Mesh(mesh) = &mut probe.shape {
            mesh.file.clear();
        }
    }
    plan
}

#[test]
fn a_plan_is_the_same_on_a_machine_without_its_files_and_no_path_travels() {
    let disk = OnDisk::new();
    let overrides = Overrides {
        model: Some(disk.folder.path().join("other.obj")),
        seed: Some(u64::MAX),
        size_m: Some(0.1 + 0.2),
        tolerance_m: Some(1e-4),
        ..Overrides::default()
    };
    // The seed belongs to a tour of the first probe.
    let text = fs::read_to_string(&disk.scene).unwrap();
    let csv = format!("csv = \"{}/path.csv\"", disk.folder.path().display());
    for (text, overrides) in [
        (text.clone(), Overrides::default()),
        (text.replace(&csv, "tour = {}"), overrides),
    ] {
        fs::write(&disk.scene, text).unwrap();
        let (plan, package) = disk.packed(&overrides);
        let folder = disk.folder.path().to_str().unwrap().as_bytes();
        let own = folder.rsplit(|&byte| byte == b'/').next().unwrap();
        for content in package.contents.values() {
            assert!(!content.windows(own.len()).any(|bytes| bytes == own));
        }
        let there = unpacked(&package, &Overrides::default()).unwrap();
        let names = |plan: &ScenePlan| -> Vec<String> {
            plan.objects.iter().map(|of| of.model.name()).collect()
        };
        assert_eq!(names(&there), names(&plan));
        assert_eq!(without_paths(there), without_paths(plan));
    }
}

#[test]
fn a_file_that_two_name_travels_once() {
    let disk = OnDisk::new();
    let (plan, package) = disk.packed(&Overrides::default());
    let manifest = Manifest::read(&package.contents[&package.manifest]).unwrap();
    assert_eq!(manifest.files.len(), 3, "{:?}", manifest.files);
    assert_eq!(package.contents.len(), 4);
    // A surface's effect of the scene is that of every object without one of its own.
    let effect = |of: &scene::ObjectPlan| of.effects[0].effect.clone();
    let patterns = [effect(&plan.objects[0]), effect(&plan.objects[1])];
    let is_map = |of: &Effect| matches!(of, Effect::Texture(of) if matches!(of.pattern, Pattern::HeightMap { .. }));
    assert!(patterns.iter().all(is_map));
}

#[test]
fn what_the_controller_says_itself_wins_over_what_the_station_was_told() {
    let disk = OnDisk::new();
    let told = Overrides {
        tolerance_m: Some(1e-3),
        cache: Some("4MiB".to_owned()),
        ..Overrides::default()
    };
    let (_, package) = disk.packed(&told);
    let own = Overrides {
        tolerance_m: Some(1e-5),
        ..Overrides::default()
    };
    let plan = unpacked(&package, &own).unwrap();
    assert_eq!(plan.accuracy.tolerance_m, 1e-5);
    assert_eq!(plan.cache_bytes, 4 << 20);
    let other = Overrides {
        model: Some("/elsewhere/other.spm".into()),
        ..Overrides::default()
    };
    let plan = unpacked(&package, &other).unwrap();
    assert_eq!(plan.objects[0].model.name(), "other.spm");
}

#[test]
fn a_scene_that_is_too_large_to_travel_is_refused_in_a_sentence() {
    let disk = OnDisk::new();
    let noting = NotingFiles::default();
    scene::load(&disk.scene, &Overrides::default(), &noting).unwrap();
    let mut read = noting.into_kept();
    let path = disk.folder.path().join("path.csv");
    read.contents
        .insert(path, vec![0; MAX_FILE_BYTES as usize + 1]);
    let refused = Package::new(&disk.scene, &Overrides::default(), &read).unwrap_err();
    assert!(refused.to_string().contains("the csv file"), "{refused}");
    let text = fs::read_to_string(&disk.scene).unwrap();
    let long = format!(
        "{text}\n[[probe]]\ndevice = {{ custom = {{ name = \"{}\" }} }}\n",
        "x".repeat(9 << 20)
    );
    read.contents.insert(disk.scene.clone(), long.into_bytes());
    read.contents
        .insert(disk.folder.path().join("path.csv"), Vec::new());
    let refused = Package::new(&disk.scene, &Overrides::default(), &read).unwrap_err();
    assert!(refused.to_string().contains("the text"), "{refused}");
}

#[test]
fn a_manifest_of_another_form_or_with_a_path_as_its_name_is_refused() {
    let disk = OnDisk::new();
    let (_, package) = disk.packed(&Overrides::default());
    let text = String::from_utf8(package.contents[&package.manifest].clone()).unwrap();
    let read = |text: &str| Manifest::read(text.as_bytes());
    assert!(read(&text).is_ok());
    let later = text.replace("\"format\":1,", "\"format\":2,\"more\":0,");
    assert_eq!(read(&later), Err(PackageError::Form(2)));
    for name in [
        "",
        "..",
        "../up",
        "/etc/passwd",
        "a\\u0000b",
        "a\\u001b[2Jb",
        &"x".repeat(300),
    ] {
        let other = text.replace("\"all kinds\"", &format!("\"{name}\""));
        assert_eq!(read(&other), Err(PackageError::Name), "{name}");
    }
    let large = text.replace("\"bytes\":", "\"bytes\":1000000000000");
    assert!(matches!(read(&large), Err(PackageError::TooLarge { .. })));
}

proptest! {
    #[test]
    fn whatever_a_manifest_holds_it_is_read_or_refused(
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let _ = Manifest::read(&bytes);
        let disk = OnDisk::new();
        let (_, mut package) = disk.packed(&Overrides::default());
        let hash = package.manifest;
        let content = package.contents.get_mut(&hash).unwrap();
        for (place, byte) in places {
            let place = place.index(content.len());
            content[place] = byte;
        }
        let Ok(manifest) = Manifest::read(content) else {
            return Ok(());
        };
        let files = manifest.files.iter();
        let found = |hash| package.contents.get(hash).cloned().unwrap_or_default();
        let contents = files.map(|file| (file.name(), found(&file.hash)));
        let overrides = manifest.under(&Overrides::default());
        let kept = manifest.kept(&overrides, contents.collect());
        let _ = scene::load(&manifest.path(), &overrides, &kept);
    }
}
