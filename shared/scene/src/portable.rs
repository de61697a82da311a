//! The text of a scene for a machine that has none of its files.

use crate::limits::DEFAULT_TOOL_FACES;
use crate::plan::ModelSource;
use crate::source::SceneError;
use crate::typed::{EffectTyped, SceneTyped, ShapeTyped, TrajectoryTyped};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use toml::Spanned;

/// A file that a scene names beside its models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedFile<'a> {
    /// What it is.
    pub kind: FileKind,
    /// Its path as typed: relative to the scene's folder or absolute.
    pub path: &'a str,
    /// Of a tool: its largest number of faces.
    pub max_faces: u32,
}

/// Kind of a file that a scene names beside its models.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FileKind {
    /// The mesh of a tool.
    Tool,
    /// A trajectory.
    Trajectory,
    /// The picture of a texture.
    HeightMap,
}

impl FileKind {
    /// How the names of such files end.
    #[must_use]
    pub fn ending(self) -> &'static str {
        match self {
            Self::Tool => "spm",
            Self::Trajectory => "csv",
            Self::HeightMap => "png",
        }
    }
}

/// The text of a valid scene with every file named by `rename`; models keep the names of their
/// files and lose the folders. Where the recording goes, and comments, are left out. Paths are left
/// in the settings of custom devices only, of which nothing is changed.
///
/// # Errors
/// When the text is no scene, or those of `rename`.
pub fn portable(
    text: &str,
    mut rename: impl FnMut(NamedFile<'_>) -> Result<String, SceneError>,
) -> Result<String, SceneError> {
    let refused = |error: toml::de::Error| SceneError(error.message().replace('\n', "; "));
    let typed: SceneTyped = toml::from_str(text).map_err(refused)?;
    let mut named = Vec::new();
    for (place, file) in files(&typed) {
        named.push((place, rename(file)?));
    }
    for object in &typed.object {
        if let Some(model) = &object.get_ref().model {
            let source = ModelSource::File(model.get_ref().into());
            named.push((model.span(), source.name()));
        }
    }
    let mut table: toml::Table = toml::from_str(&replaced(text, named)).map_err(refused)?;
    if let Some(toml::Value::Table(record)) = table.get_mut("record") {
        record.remove("path");
    }
    Ok(table.to_string())
}

/// The files that a scene names, but for its models.
fn files(typed: &SceneTyped) -> impl Iterator<Item = (Range<usize>, NamedFile<'_>)> {
    let of_objects = typed.object.iter().flat_map(|of| &of.get_ref().effects);
    let height_maps = typed
        .effects
        .iter()
        .chain(of_objects)
        .filter_map(height_map);
    let probes = || typed.probe.iter().map(Spanned::get_ref);
    let tools = probes().filter_map(|probe| match &probe.shape {
        Some(ShapeTyped::Mesh(mesh)) => {
            let faces = mesh
                .faces
                .as_ref()
                .map_or(DEFAULT_TOOL_FACES, |of| *of.get_ref());
            Some((u32::try_from(faces).unwrap_or(0), &mesh.file))
        }
        _ => None,
    });
    let trajectories = probes().filter_map(|probe| match &probe.trajectory {
        Some(TrajectoryTyped::Csv(file)) => Some(file),
        _ => None,
    });
    height_maps
        .map(|file| named(FileKind::HeightMap, 0, file))
        .chain(tools.map(|(faces, file)| named(FileKind::Tool, faces, file)))
        .chain(trajectories.map(|file| named(FileKind::Trajectory, 0, file)))
}

fn named(kind: FileKind, max_faces: u32, file: &Spanned<String>) -> (Range<usize>, NamedFile<'_>) {
    let named = NamedFile {
        kind,
        path: file.get_ref(),
        max_faces,
    };
    (file.span(), named)
}

fn height_map(effect: &Spanned<EffectTyped>) -> Option<&Spanned<String>> {
    let texture = effect.get_ref().texture.as_ref()?;
    texture.height_map.as_ref().map(|map| &map.file)
}

/// The text with these strings in these places.
fn replaced(text: &str, mut strings: Vec<(Range<usize>, String)>) -> String {
    strings.sort_by_key(|(place, _)| place.start);
    let mut replaced = text.to_owned();
    for (place, string) in strings.into_iter().rev() {
        let quoted = toml::Value::String(string).to_string();
        replaced.replace_range(place, &quoted);
    }
    replaced
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_path_is_replaced_and_nothing_else() {
        let text = r#"
# /secret/comment
[record]
keep = "64MiB"
path = "/secret/run.mcap"
[[effects]]
texture = { amplitude_m = 1e-4, height_map = { file = '/secret/world.png', width_m = 0.1 } }
[[object]]
name = "tool.spm"
model = """/secret/"quoted".obj"""
size_m = 0.1 # /secret/too
effects = [{ texture = { amplitude_m = 0.1, height_map = { file = "../secret/map.png", width_m = 0.30000000000000004 } } }]
[[object]]
model = "plain.spm"
size_m = 0.1
[[probe]]
shape = { mesh = { file = "tool.spm", size_m = 0.01, faces = 100 } }
trajectory = { csv = "secret/path.csv" }
[[probe]]
device = { custom = { name = "arm", port = "/dev/arm" } }
"#;
        let mut asked = Vec::new();
        let moved = portable(text, |file| {
            asked.push((file.path.to_owned(), file.max_faces));
            Ok(format!("{}.{}", asked.len(), file.kind.ending()))
        });
        let moved = moved.unwrap();
        assert_eq!(
            asked,
            [
                ("/secret/world.png", 0),
                ("../secret/map.png", 0),
                ("tool.spm", 100),
                ("secret/path.csv", 0)
            ]
            .map(|(path, faces)| (path.to_owned(), faces))
        );
        assert!(!moved.contains("secret"), "{moved}");
        let expected = text
            .replace("'/secret/world.png'", "'1.png'")
            .replace("../secret/map.png", "2.png")
            .replace("file = \"tool.spm\"", "file = \"3.spm\"")
            .replace("secret/path.csv", "4.csv")
            .replace("\"\"\"/secret/\"quoted\".obj\"\"\"", "'\"quoted\".obj'")
            .replace("path = \"/secret/run.mcap\"\n", "");
        let table = |text: &str| toml::from_str::<toml::Table>(text).unwrap();
        assert_eq!(table(&moved), table(&expected));
    }

    #[test]
    fn what_is_no_scene_or_cannot_be_renamed_is_refused() {
        assert!(portable("nonsense", |_| Ok(String::new())).is_err());
        let text =
            "[[object]]\nmodel = \"a\"\nsize_m = 1\n[[probe]]\ntrajectory = { csv = \"p\" }\n";
        let refused = portable(text, |file| Err(SceneError(format!("no {}", file.path))));
        assert_eq!(refused, Err(SceneError("no p".to_owned())));
    }
}
