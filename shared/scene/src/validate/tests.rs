use super::*;
use crate::{ModelScale, ModelSource, NoFiles, RefinementPlan, TrajectoryPlan, parse_bytes};
use geometry::Pose;
use glam::DVec3;
use std::io;
use std::path::PathBuf;

const BUNDLED: &str = include_str!("../../../../config/scenes/first-touch.toml");

/// One file in memory.
struct OneFile<'a> {
    path: &'a str,
    content: &'a str,
}

impl Files for OneFile<'_> {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        if path == Path::new(self.path) {
            Ok(self.content.into())
        } else {
            NoFiles.read(path)
        }
    }

    fn absolute(&self, path: &Path) -> io::Result<PathBuf> {
        Ok(Path::new("/current").join(path))
    }
}

fn plain(text: &str) -> Result<ScenePlan, SceneError> {
    let files = OneFile {
        path: "scene.spm",
        content: "[[object]]",
    };
    parse(
        text,
        "test.toml",
        Path::new(""),
        &Overrides::default(),
        &files,
    )
}

/// The bundled scene with one piece of its text exchanged, which must be there.
fn exchanged(old: &str, new: &str) -> String {
    assert!(BUNDLED.contains(old), "the bundled scene has no {old}");
    BUNDLED.replacen(old, new, 1)
}

fn refusal(text: &str) -> String {
    let message = plain(text).unwrap_err().to_string();
    assert!(!message.contains('\n'), "one sentence: {message}");
    assert!(message.starts_with("test.toml"), "{message}");
    message
}

fn line_of(text: &str, needle: &str) -> usize {
    1 + text.lines().position(|line| line.contains(needle)).unwrap()
}

#[test]
fn a_recording_has_a_size_or_is_off() {
    let plan = |record: &str| {
        let text = format!("{record}\n[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n[[probe]]\n");
        parse(&text, "s", Path::new("in"), &Overrides::default(), &NoFiles)
    };
    assert_eq!(plan("").unwrap().record.keep_bytes, Some(512 << 20));
    let named = plan("[record]\nkeep = \"64MiB\"\npath = \"a.mcap\"")
        .unwrap()
        .record;
    assert_eq!(named.keep_bytes, Some(64 << 20));
    assert_eq!(named.path.as_deref(), Some(Path::new("in/a.mcap")));
    assert_eq!(
        plan("[record]\nkeep = \"off\"").unwrap().record.keep_bytes,
        None
    );
    for (typed, said) in [("1KiB", "at least 1MiB"), ("lots", "or \"off\"")] {
        let error = plan(&format!("[record]\nkeep = \"{typed}\"")).unwrap_err();
        assert!(
            error.0.contains("line 2") && error.0.contains(said),
            "{error}"
        );
    }
}

#[test]
fn the_bundled_scene_equals_the_defaults() {
    let bundled = plain(BUNDLED).unwrap();
    let short = plain(
        "[[object]]\ngenerate = { shape = \"relief\", faces = 100000 }\nsize_m = 0.15\n[[probe]]\n",
    )
    .unwrap();
    assert_eq!(bundled, short);
    assert_eq!((bundled.loop_.core, bundled.loop_.picks_core), (None, true));
    assert_eq!(bundled.loop_.operations, 96);
    assert_eq!(bundled.cache_bytes, 16 << 20);
    assert_eq!(bundled.objects[0].scale, ModelScale::Size(0.15));
    assert_eq!(bundled.objects[0].model.name(), "generate:relief:100000");
    assert_eq!(bundled.probes[0].shape.tip_m(), 0.001);
}

#[test]
fn an_unknown_key_is_named_with_its_line() {
    for (old, new, key) in [
        ("rate_hz = 1000", "rate_khz = 1", "rate_khz"),
        ("force_max_n = 8.0", "force_max = 8.0", "force_max"),
        ("size_m = 0.15 ", "size_m = 0.15\nsize_mm = 150 ", "size_mm"),
        ("seed = 1,", "seeds = 1,", "seeds"),
        ("radius_m = 0.001", "radius = 0.001", "radius"),
        ("[accuracy]", "[precision]", "precision"),
        ("{ sphere =", "{ cube =", "cube"),
    ] {
        let text = exchanged(old, new);
        let message = refusal(&text);
        assert!(
            message.contains(&format!("unknown field `{key}`"))
                || message.contains(&format!("unknown variant `{key}`")),
            "{key}: {message}"
        );
        let line = line_of(&text, key);
        assert!(
            message.contains(&format!("line {line}:")),
            "{key}: {message}"
        );
    }
}

#[test]
fn every_bad_number_is_refused_with_its_key_and_line() {
    for (old, bad) in [
        ("rate_hz = 1000", "rate_hz = 99.9"),
        ("rate_hz = 1000", "rate_hz = nan"),
        ("priority = 80", "core = -2"),
        ("priority = 80", "priority = 100"),
        ("spin_us = 0", "spin_us = 501"),
        ("operations = 96", "operations = 0"),
        ("tolerance_m = 0.0", "tolerance_m = -1.0"),
        ("force_max_n = 8.0", "force_max_n = 0"),
        ("torque_max_nm = 0.3", "torque_max_nm = -0.3"),
        ("slew_n_per_s = 2000.0", "slew_n_per_s = inf"),
        ("ramp_s = 0.2", "ramp_s = -0.1"),
        // No ramp: the force would begin and end by a jump.
        ("ramp_s = 0.2", "ramp_s = 0"),
        ("faces = 100000", "faces = 3"),
        ("size_m = 0.15", "size_m = 0.0"),
        ("stiffness_n_per_m = 800.0", "stiffness_n_per_m = -800.0"),
        ("damping_ns_per_m = 0.5", "damping_ns_per_m = -0.5"),
        ("radius_m = 0.001", "radius_m = nan"),
        ("mass_kg = 0.1", "mass_kg = 0"),
        ("encoder_m = 1e-5", "encoder_m = -1e-5"),
        ("stiffness_n_per_m = 200.0", "stiffness_n_per_m = nan"),
        ("damping_ns_per_m = 2.0", "damping_ns_per_m = -2.0"),
        ("seed = 1", "seed = -1"),
        ("speed_m_per_s = 0.1", "speed_m_per_s = 0"),
        ("depth_m = 0.002", "depth_m = -inf"),
    ] {
        let text = exchanged(old, bad);
        let message = refusal(&text);
        let key = bad.split(' ').next().unwrap();
        let line = line_of(&text, bad);
        assert!(
            message.contains(key) && message.contains(&format!("line {line}:")),
            "{bad}: {message}"
        );
    }
}

#[test]
fn a_scene_without_objects_or_probes_is_refused() {
    assert!(refusal("").contains("no [[object]]"));
    let no_probe = &BUNDLED[..BUNDLED.rfind("[[probe]]").unwrap()];
    assert!(refusal(no_probe).contains("no [[probe]]"));
}

#[test]
fn objects_and_probes_are_counted_in_their_order() {
    let second = "\n[[object]]\nname = \"far\"\nmodel = \"a.spm\"\nsize_m = 1\n";
    let row = "\n[[object]]\nmodel = \"b.spm\"\nsize_m = 1\npose = { position_m = [0, 0, 5] }\ngrid = { counts = [3, 2, 1], spacing_m = 0.5 }\n";
    let tours = "\n[[probe]]\ntrajectory = { tour = { object = \"far\" } }\n[[probe]]\ntrajectory = { tour = { object = 7 } }\n";
    let scene = plain(&format!("{BUNDLED}{second}{row}{tours}")).unwrap();
    assert_eq!((scene.objects.len(), scene.probes.len()), (8, 3));
    let places = scene.objects[2..]
        .iter()
        .map(|object| object.pose.position.to_array());
    assert_eq!(
        places.collect::<Vec<_>>(),
        [
            [0.0, 0.0, 5.0],
            [0.5, 0.0, 5.0],
            [1.0, 0.0, 5.0],
            [0.0, 0.5, 5.0],
            [0.5, 0.5, 5.0],
            [1.0, 0.5, 5.0]
        ]
    );
    let toured = scene.probes.iter().map(|probe| match probe.trajectory {
        TrajectoryPlan::Tour { object, .. } => object,
        TrajectoryPlan::Points(_) => usize::MAX,
    });
    assert_eq!(toured.collect::<Vec<_>>(), [0, 1, 7]);
    assert_eq!(scene.active_objects(), 7);
    assert_eq!(plain(BUNDLED).unwrap().active_objects(), 1);
}

#[test]
fn too_many_or_missing_tables_are_refused_with_their_line() {
    for (added, at, expected) in [
        ("[[probe]]\n".repeat(4), 4, "at most 4"),
        (
            "[[object]]\nmodel = \"a\"\nsize_m = 1\ngrid = { counts = [70, 70, 1], spacing_m = 1 }"
                .to_string(),
            4,
            "at most 4096",
        ),
        (
            "[[object]]\nmodel = \"a\"\nsize_m = 1\ngrid = { counts = [1, 0, 1], spacing_m = 1 }"
                .to_string(),
            4,
            "from 1 up",
        ),
        (
            "[[object]]\nmodel = \"a\"\nsize_m = 1\ngrid = { counts = [2, 2, 1], spacing_m = -1 }"
                .to_string(),
            4,
            "spacing_m",
        ),
        (
            "[[object]]\nmodel = \"a\"\nsize_m = 1\ngrid = { counts = [2, 2, 1], spacing = 1 }"
                .to_string(),
            4,
            "unknown field `spacing`",
        ),
        (
            "[[probe]]\ntrajectory = { tour = { object = 1 } }".to_string(),
            2,
            "from 0 to 0",
        ),
        (
            "[[probe]]\ntrajectory = { tour = { object = \"none\" } }".to_string(),
            2,
            "no such object",
        ),
        (
            "[[object]]\nname = \"\"\nmodel = \"a\"\nsize_m = 1".to_string(),
            2,
            "a name of its own",
        ),
    ] {
        let message = refusal(&format!("{}\n{added}", BUNDLED.trim_end()));
        let line = BUNDLED.trim_end().lines().count() + at;
        assert!(message.contains(&format!("line {line}:")), "{message}");
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn model_and_size_are_given_exactly_once() {
    for (old, new, expected) in [
        ("generate", "model = \"a.spm\"\ngenerate", "not both"),
        ("size_m = 0.15 ", "", "size_m"),
        (
            "size_m = 0.15 ",
            "size_m = 1\nmetres_per_unit = 1 ",
            "not both",
        ),
        ("\"relief\"", "\"teapot\"", "sphere, torus"),
        ("[1, 0, 0, 0]", "[0, 0, 0, 0]", "orientation"),
        ("[0, 0, 0]", "[0, nan, 0]", "pose"),
        ("[0, 0, 0]", "[0, 0]", "write 3 numbers"),
        ("{ tour =", "{ tours =", "tours"),
    ] {
        let message = refusal(&exchanged(old, new));
        assert!(message.contains(expected), "{new}: {message}");
        assert!(message.contains(", line "), "{new}: {message}");
    }
    assert!(refusal("[[object]\n").contains("line 1"));
}

#[test]
fn sizes_in_bytes_are_read_with_and_without_a_unit() {
    for (text, bytes) in [
        ("16MiB", 16 << 20),
        ("512KiB", 512 << 10),
        ("1GiB", 1 << 30),
        ("2 MB", 2_000_000),
        ("16777216", 16 << 20),
        (" 7B ", 7),
    ] {
        assert_eq!(parse_bytes(text), Ok(bytes), "{text}");
    }
    for text in [
        "",
        "MiB",
        "-1",
        "0",
        "1.5MiB",
        "16mib",
        "99999999999999999999",
        "9999999GiB",
    ] {
        assert!(parse_bytes(text).is_err(), "{text}");
    }
    let plan = plain(&exchanged("\"16MiB\"", "65536")).unwrap();
    assert_eq!(plan.cache_bytes, 65536);
    let text = exchanged("\"16MiB\"", "\"lots\"");
    let line = line_of(&text, "lots");
    assert!(refusal(&text).contains(&format!("line {line}:")));
    refusal(&exchanged("\"16MiB\"", "-1"));
    refusal(&exchanged("\"16MiB\"", "1.5"));
}

#[test]
fn the_command_line_replaces_values_of_the_scene() {
    let overrides = Overrides {
        model: Some("other.spm".into()),
        size_m: Some(0.3),
        speed_m_per_s: Some(0.5),
        seed: Some(u64::MAX),
        cache: Some("1MiB".to_string()),
        tolerance_m: Some(1e-4),
        rate_hz: Some(5000.0),
        spin_us: Some(100),
        devices: Vec::new(),
    };
    let files = OneFile {
        path: "",
        content: "",
    };
    let plan = parse(BUNDLED, "scene", Path::new("folder"), &overrides, &files).unwrap();
    let ModelSource::File(model) = &plan.objects[0].model else {
        panic!("{:?}", plan.objects[0].model);
    };
    assert_eq!(model, Path::new("/current/other.spm"));
    assert_eq!(plan.objects[0].scale, ModelScale::Size(0.3));
    assert_eq!(plan.cache_bytes, 1 << 20);
    assert_eq!(plan.accuracy.tolerance_m, 1e-4);
    assert_eq!((plan.loop_.rate_hz, plan.loop_.spin_us), (5000.0, 100));
    assert_eq!(
        plan.probes[0].trajectory,
        TrajectoryPlan::Tour {
            object: 0,
            seed: u64::MAX,
            speed_m_per_s: 0.5,
            depth_m: 0.002
        }
    );
    let kept = Overrides {
        model: Some("other.spm".into()),
        ..Overrides::default()
    };
    let kept = parse(BUNDLED, "scene", Path::new(""), &kept, &NoFiles).unwrap();
    assert_eq!(
        kept.objects[0].scale,
        ModelScale::Size(0.15),
        "the scene's size is kept"
    );
    for (overrides, flag) in [
        (
            Overrides {
                size_m: Some(-1.0),
                ..Overrides::default()
            },
            "--size",
        ),
        (
            Overrides {
                speed_m_per_s: Some(f64::NAN),
                ..Overrides::default()
            },
            "--speed",
        ),
        (
            Overrides {
                cache: Some("x".into()),
                ..Overrides::default()
            },
            "--cache",
        ),
        (
            Overrides {
                tolerance_m: Some(-1e-3),
                ..Overrides::default()
            },
            "--tolerance",
        ),
    ] {
        let message = parse(BUNDLED, "scene", Path::new(""), &overrides, &NoFiles).unwrap_err();
        assert!(message.to_string().contains(flag), "{message}");
    }
}

#[test]
fn a_trajectory_is_read_from_the_folder_of_the_scene_and_its_errors_have_lines() {
    let text = exchanged(
        "tour = { seed = 1, speed_m_per_s = 0.1, depth_m = 0.002 }",
        "csv = \"path.csv\"",
    );
    let read_with = |csv: &str, overrides: &Overrides| {
        let files = OneFile {
            path: "folder/path.csv",
            content: csv,
        };
        parse(&text, "scene", Path::new("folder"), overrides, &files)
    };
    let read = |csv: &str| read_with(csv, &Overrides::default());
    let plan = read("t,x,y,z\n# rest\n0, 0,0,1\r\n0.5,1,2,3,0,0,0,2\n").unwrap();
    let TrajectoryPlan::Points(points) = &plan.probes[0].trajectory else {
        panic!("{:?}", plan.probes[0].trajectory);
    };
    assert_eq!(points[0], (0.0, Pose::at(DVec3::Z)));
    assert_eq!(points[1].1.wxyz(), [0.0, 0.0, 0.0, 1.0]);
    for (csv, line, expected) in [
        ("0,0,0,0\n0,0,0,0\n", 2, "strictly increasing"),
        ("0,0,0\n", 1, "columns"),
        ("0,0,0,0,1,0,0,0,9\n", 1, "columns"),
        ("0,0,0,0\n1,a,0,0\n", 2, "finite"),
        ("t,x,y,z\n1,nan,0,0\n", 2, "finite"),
        ("-1,0,0,0\n", 1, "negative"),
        ("0,0,0,0,0,0,0,0\n", 1, "direction"),
        ("0,0,0,0\nt,x,y,z\n", 2, "finite"),
        // Lines that the crate `csv` miscounts (rust-csv 208 and 395).
        ("t,x,y,z\r\n\r\n  # rest\r\n0,0,0\r\n", 4, "columns"),
    ] {
        let message = read(csv).unwrap_err().to_string();
        assert!(message.contains(expected), "{csv:?}: {message}");
        assert!(
            message.contains(&format!("path.csv, line {line}:")),
            "{csv:?}: {message}"
        );
    }
    assert!(
        read("t,x,y,z\n")
            .unwrap_err()
            .to_string()
            .contains("no points")
    );
    let overrides = Overrides {
        seed: Some(1),
        ..Overrides::default()
    };
    let message = read_with("0,0,0,0\n", &overrides).unwrap_err();
    assert!(message.to_string().contains("--seed"), "{message}");
    let message = plain(&text).unwrap_err();
    assert!(
        message.to_string().contains("path.csv cannot be read"),
        "{message}"
    );
}

#[test]
fn a_missing_scene_is_one_sentence() {
    let message = load(Path::new("no/such.toml"), &Overrides::default(), &NoFiles)
        .unwrap_err()
        .to_string();
    assert!(
        message.starts_with("no/such.toml: ") && !message.contains('\n'),
        "{message}"
    );
}

#[test]
fn a_loaded_scene_has_its_files_name_and_folder() {
    let files = OneFile {
        path: "scenes/first-touch.toml",
        content: BUNDLED,
    };
    let path = Path::new(files.path);
    let plan = load(path, &Overrides::default(), &files).unwrap();
    assert_eq!(plan.name, "first-touch");
    assert_eq!(plan.folder, path.parent().unwrap());
}

#[test]
fn geomorphs_are_on_unless_the_scene_turns_them_off() {
    let geomorph = |text: &str| plain(text).unwrap().accuracy.geomorph;
    assert!(geomorph(&exchanged("geomorph = true", "")));
    assert!(geomorph(&exchanged("geomorph = true", "geomorph = true")));
    assert!(!geomorph(&exchanged("geomorph = true", "geomorph = false")));
    let tool = "[[object]]\ngenerate = { shape = \"relief\", faces = 100000 }\nsize_m = 0.15\n[[probe]]\nshape = { capsule = { radius_m = 0.003, length_m = 0.02 } }\n";
    assert!(geomorph(tool));
    assert!(!geomorph(&format!("[accuracy]\ngeomorph = false\n{tool}")));
}

#[test]
fn refinement_is_local_to_a_tolerance_or_global_to_a_tolerance_or_a_count() {
    let plan = plain(&exchanged("tolerance_m = 0.0", "tolerance_m = 1e-4")).unwrap();
    assert_eq!(plan.accuracy.tolerance_m, 1e-4);
    assert_eq!(plan.accuracy.refinement, RefinementPlan::Local);
    let global = |more: &str| {
        let old = "refinement = \"local\"";
        exchanged(old, &format!("refinement = \"global\"\n{more}"))
    };
    let refinement = |text: &str| plain(text).unwrap().accuracy.refinement;
    assert_eq!(
        refinement(&global("")),
        RefinementPlan::Global { lod: None }
    );
    let counted = global("lod = 20000");
    assert_eq!(
        refinement(&counted),
        RefinementPlan::Global { lod: Some(20_000) }
    );
    let typed = Overrides {
        tolerance_m: Some(1e-3),
        ..Overrides::default()
    };
    let plan = parse(&counted, "scene", Path::new(""), &typed, &NoFiles).unwrap();
    assert_eq!(
        plan.accuracy.refinement,
        RefinementPlan::Global { lod: None },
        "--tolerance lies over the scene's lod"
    );
    for (text, expected) in [
        (exchanged("tolerance_m = 0.0", "lod = 5"), "refinement"),
        (global("lod = -1"), "lod"),
        (
            global("lod = 5").replacen("tolerance_m = 0.0", "tolerance_m = 1.0", 1),
            "leave one",
        ),
        (
            exchanged("\"local\"", "\"everywhere\""),
            "expected `local` or `global`",
        ),
    ] {
        let message = refusal(&text);
        assert!(message.contains(expected), "{message}");
        assert!(message.contains(", line "), "{message}");
    }
}

#[test]
fn shapes_that_cannot_be_a_tool_are_refused_with_their_line() {
    for (shape, part) in [
        (
            "{ capsule = { radius_m = 0.01, length_m = 0.015 } }",
            "at least as long",
        ),
        (
            "{ capsule = { radius_m = 0.01, length_m = 0.05, faces = 5 } }",
            "faces",
        ),
        (
            "{ cylinder = { radius_m = -1.0, length_m = 0.05 } }",
            "radius_m",
        ),
        ("{ cylinder = { radius_m = 0.01 } }", "length_m"),
        ("{ cone = { radius_m = 0.01 } }", "cone"),
        (
            "{ mesh = { file = \"none.spm\", size_m = 0.05 } }",
            "cannot be read",
        ),
        (
            "{ mesh = { file = \"scene.spm\", size_m = 0.05 } }",
            "ve-station build",
        ),
        ("{ mesh = { file = \"none.spm\", size_m = 0.0 } }", "size_m"),
    ] {
        let text = exchanged("{ sphere = { radius_m = 0.001 } }", shape);
        let message = refusal(&text);
        let line = line_of(&text, shape);
        assert!(
            message.contains(part) && message.contains(&format!("line {line}")),
            "{shape}: {message}"
        );
    }
}

#[test]
fn a_tool_extends_from_its_tip_to_its_end() {
    let shape = |text: &str| {
        let text = exchanged("{ sphere = { radius_m = 0.001 } }", text);
        let plan = plain(&text).unwrap();
        plan.probes[0].shape.clone()
    };
    let capsule = shape("{ capsule = { radius_m = 0.003, length_m = 0.05 } }");
    assert_eq!((capsule.tip_m(), capsule.extent_m()), (0.003, 0.047));
    let cylinder = shape("{ cylinder = { radius_m = 0.003, length_m = 0.004, faces = 240 } }");
    assert_eq!((cylinder.tip_m(), cylinder.extent_m()), (0.0, 0.005));
}

#[test]
fn a_custom_device_keeps_its_settings_and_line_and_needs_a_name() {
    let device = "device = { custom = { name = \"mine\", port = 3 } }\n";
    let text = format!("[[object]]\nmodel = \"a.spm\"\nsize_m = 1.0\n[[probe]]\n{device}");
    let plan = plain(&text).unwrap();
    let custom = plan.probes[0].custom_device.as_ref().unwrap();
    assert_eq!((custom.name.as_str(), custom.line), ("mine", 5));
    assert_eq!(custom.settings.len(), 1);
    assert_eq!(custom.settings["port"].as_integer(), Some(3));
    // Without a path it is not led.
    assert_eq!(
        plan.probes[0].trajectory,
        TrajectoryPlan::Points(Vec::new())
    );
    let unnamed = refusal(&text.replace("name = \"mine\", ", ""));
    assert!(
        unnamed.contains("line 5") && unnamed.contains("name"),
        "{unnamed}"
    );
}
