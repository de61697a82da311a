//! A scene and its files for a machine that has none of them: a *manifest* with the scene's text,
//! in which the path of every file that is read with it is a hash and an ending, and the contents
//! of these hashes. What the settings of a custom device say is left as it is.

use crate::KeptFiles;
use protocol::FileHash;
use scene::{FileKind, NamedFile, Overrides, SceneError};
use serde::{Deserialize, Serialize};
use spm::{SpmFile, prefix_parts, write_spm};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Largest manifest, bytes: several times the text of a scene with all the objects that one may
/// have.
pub const MAX_MANIFEST_BYTES: u64 = 8 << 20;
/// Largest file, bytes: a day of a trajectory at 30 points a second.
pub const MAX_FILE_BYTES: u64 = 256 << 20;
/// Most bytes of all files of a scene together.
pub const MAX_SCENE_BYTES: u64 = 1 << 30;
/// Longest name of a scene, bytes: that of a file, with room for what a recording's name adds.
const MAX_NAME_BYTES: usize = 200;
/// Version of the manifest's form.
const FORMAT: u32 = 1;

/// Why a scene cannot travel: one sentence.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PackageError {
    /// Another version's manifest.
    #[error(
        "the station's scene has form {0}, this program reads form {FORMAT}: install the same release on both sides"
    )]
    Form(u32),
    /// Not a manifest.
    #[error("what the station gives as its scene cannot be read ({0}): restart the station")]
    Unreadable(String),
    /// Not a name for a scene.
    #[error(
        "the name of the station's scene is no file name of at most {MAX_NAME_BYTES} bytes: rename its scene file"
    )]
    Name,
    /// Too many bytes.
    #[error(
        "{what} of the scene has {bytes} bytes, more than the {most} that controllers are given: use a smaller one, or copy the scene's files to the controller and give it the scene file"
    )]
    TooLarge {
        /// What it is.
        what: String,
        /// Its size.
        bytes: u64,
        /// The largest.
        most: u64,
    },
    /// A file that the scene names was not read with it.
    #[error("{0}")]
    Scene(#[from] SceneError),
}

/// What a manifest says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    format: u32,
    /// Name of the scene.
    pub name: String,
    /// What the station's command line says over the scene.
    pub overrides: Overrides,
    /// Files that the scene names, each content once.
    pub files: Vec<ManifestFile>,
    /// The scene's text.
    pub scene: String,
}

/// A file of a scene.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestFile {
    /// What it is.
    pub kind: FileKind,
    /// Hash of its content, 32 hexadecimal digits.
    #[serde(with = "digits")]
    pub hash: FileHash,
    /// Its size.
    pub bytes: u64,
}

impl ManifestFile {
    /// Its name in the scene's text.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}.{}", self.hash, self.kind.ending())
    }
}

/// A hash as text.
mod digits {
    use protocol::FileHash;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(hash: &FileHash, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(hash)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<FileHash, D::Error> {
        let text = String::deserialize(from)?;
        text.parse().map_err(D::Error::custom)
    }
}

/// Of a manifest of any version.
#[derive(Deserialize)]
struct Form {
    format: u32,
}

/// A scene as it travels: the manifest and the other contents, by hash.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Package {
    /// Hash of the manifest.
    pub manifest: FileHash,
    /// All contents, the manifest's among them.
    pub contents: BTreeMap<FileHash, Vec<u8>>,
}

impl Package {
    /// Packs a scene that was loaded from `scene` under these overrides, with all that was read for
    /// it. No path of this machine is in it but those that the settings of a custom device say:
    /// only its driver knows what they mean.
    ///
    /// # Errors
    /// When a file is too large, or was not read.
    pub fn new(
        scene: &Path,
        overrides: &Overrides,
        read: &KeptFiles,
    ) -> Result<Self, PackageError> {
        let text = read.contents.get(scene).map(Vec::as_slice);
        let text = std::str::from_utf8(text.unwrap_or_default());
        let text = text.map_err(|error| PackageError::Unreadable(error.to_string()))?;
        let folder = scene.parent().unwrap_or(Path::new(""));
        let mut contents = BTreeMap::new();
        let mut files: Vec<ManifestFile> = Vec::new();
        let text = scene::portable(text, |named| {
            let content = read.contents.get(&folder.join(named.path));
            let content = content.and_then(|content| needed(named, content));
            let content = content.ok_or_else(|| {
                SceneError(format!("the scene's file {} was not read", named.path))
            })?;
            let file = ManifestFile {
                kind: named.kind,
                hash: FileHash::of(&content),
                bytes: content.len() as u64,
            };
            let name = file.name();
            contents.insert(file.hash, content);
            if !files.contains(&file) {
                files.push(file);
            }
            Ok(name)
        })?;
        let model = overrides.model.clone().map(scene::ModelSource::File);
        let manifest = Manifest {
            format: FORMAT,
            name: name_of(scene),
            overrides: Overrides {
                model: model.map(|model| model.name().into()),
                devices: Vec::new(),
                ..overrides.clone()
            },
            files,
            scene: text,
        };
        manifest.check()?;
        let bytes = serde_json::to_vec(&manifest);
        let bytes = bytes.map_err(|error| PackageError::Unreadable(error.to_string()))?;
        check_size("the text", bytes.len() as u64, MAX_MANIFEST_BYTES)?;
        let manifest = FileHash::of(&bytes);
        contents.insert(manifest, bytes);
        Ok(Self { manifest, contents })
    }
}

impl Manifest {
    /// Reads a manifest that another machine sent.
    ///
    /// # Errors
    /// When it is of another version, damaged, or names too much.
    pub fn read(bytes: &[u8]) -> Result<Self, PackageError> {
        let refused = |error: serde_json::Error| PackageError::Unreadable(error.to_string());
        let form: Form = serde_json::from_slice(bytes).map_err(refused)?;
        if form.format != FORMAT {
            return Err(PackageError::Form(form.format));
        }
        let manifest: Self = serde_json::from_slice(bytes).map_err(refused)?;
        manifest.check()?;
        Ok(manifest)
    }

    /// Checks name and sizes.
    fn check(&self) -> Result<(), PackageError> {
        let is_file_name = Path::new(&self.name).file_name() == Some(self.name.as_ref());
        let is_plain = !self.name.contains(|c: char| c.is_control() || c == '/');
        if !is_file_name || !is_plain || self.name.len() > MAX_NAME_BYTES {
            return Err(PackageError::Name);
        }
        let mut all = 0u64;
        for file in &self.files {
            let what = format!("the {} file", file.kind.ending());
            check_size(&what, file.bytes, MAX_FILE_BYTES)?;
            all = all.saturating_add(file.bytes);
            check_size("all files together", all, MAX_SCENE_BYTES)?;
        }
        Ok(())
    }

    /// Where the scene's text stands among [`Manifest::kept`]; no name of a content has a folder.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        format!("{}.toml", self.name).into()
    }

    /// What the station's command line says, where this machine's says nothing.
    #[must_use]
    pub fn under(&self, own: &Overrides) -> Overrides {
        let (own, theirs) = (own.clone(), self.overrides.clone());
        Overrides {
            model: own.model.or(theirs.model),
            size_m: own.size_m.or(theirs.size_m),
            speed_m_per_s: own.speed_m_per_s.or(theirs.speed_m_per_s),
            seed: own.seed.or(theirs.seed),
            cache: own.cache.or(theirs.cache),
            tolerance_m: own.tolerance_m.or(theirs.tolerance_m),
            rate_hz: own.rate_hz.or(theirs.rate_hz),
            spin_us: own.spin_us.or(theirs.spin_us),
            // Of this machine alone.
            devices: own.devices,
        }
    }

    /// The scene and its files, to be loaded without a disk under these overrides.
    #[must_use]
    pub fn kept(
        &self,
        overrides: &Overrides,
        mut contents: BTreeMap<String, Vec<u8>>,
    ) -> KeptFiles {
        let path = self.path().display().to_string();
        contents.insert(path, self.scene.clone().into_bytes());
        let contents = contents.into_iter();
        // Only the station opens models, and only their names are compared.
        let absolute = overrides.model.iter().map(|of| (of.clone(), of.clone()));
        KeptFiles {
            contents: contents.map(|(name, of)| (name.into(), of)).collect(),
            absolute: absolute.collect(),
        }
    }
}

/// What a controller needs of a file: of a tool's only the level of detail that the scene takes,
/// never the sequence. `None` for a tool that is no SPM file.
fn needed(named: NamedFile<'_>, content: &[u8]) -> Option<Vec<u8>> {
    if named.kind != FileKind::Tool {
        return Some(content.to_vec());
    }
    let file = SpmFile::open(content.to_vec()).ok()?;
    let parts = prefix_parts(&file, named.max_faces).ok()?;
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).ok()?;
    Some(bytes)
}

/// Name of a scene: the stem of its file, as [`scene::load`] has it.
fn name_of(scene: &Path) -> String {
    let stem = scene.file_stem().unwrap_or(scene.as_os_str());
    stem.to_string_lossy().into_owned()
}

fn check_size(what: &str, bytes: u64, most: u64) -> Result<(), PackageError> {
    if bytes <= most {
        return Ok(());
    }
    Err(PackageError::TooLarge {
        what: what.to_owned(),
        bytes,
        most,
    })
}

#[cfg(test)]
mod tests;
