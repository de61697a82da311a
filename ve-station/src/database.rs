//! Database agent: every model of a scene as an open SPM file.
//!
//! An SPM file is opened as it is. A mesh file and a generated shape are built once into the user's
//! cache folder (`$HRTC_CACHE`, else `hrtc/models` in the user's cache), under a name that holds
//! the hash of the content and the versions of builder and format. Files appear there whole, by
//! rename, and one builds at a time: of two stations that need the same model the second waits.
//! (Where there are no locks, and between machines, both may build it; their files are equal.)
//! Beyond 16 GiB those go that were not used for longest.

use crate::file_bytes::FileBytes;
use crate::tuning::models::NAME_CHARS;
use protocol::Request;
use scene::{ModelSource, ScenePlan};
use spm::{FORMAT_VERSION, FileError, SpmFile};
use spm_builder::generate::{self, Shape};
use spm_builder::{BUILDER_VERSION, BuildError, BuildOptions, MeshFormat, Progress};
use station_core::station::{ServedModel, ServedObject};
use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;
use xxhash_rust::xxh3::Xxh3Default;

/// The seed of shapes that a scene generates: a scene names shape and faces only.
pub const GENERATE_SEED: u64 = 1;

/// Bytes of built models that are kept at the most, beside those that were used of late: a hundred
/// of a million faces.
const MAX_BUILT_BYTES: u64 = 16 << 30;
/// Time for which one that was used is kept, however many there are: a scene may be about to open
/// it again.
const KEPT: Duration = Duration::from_secs(24 * 3600);

/// Why a model of the scene cannot be served: one sentence.
#[derive(Debug, Error)]
pub enum DatabaseError {
    /// The operating system says no.
    #[error("the model {}: {error}; correct the path in the scene (relative paths start at its folder) or on the command line (at the current one)", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// No SPM file, or a damaged one.
    #[error("the model {}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        error: FileError,
    },
    /// Two models of one name, by which controllers tell models apart.
    #[error("the models {} and {} differ and are both named \"{name}\", so that controllers would take them for one: rename one of the files, in the scene too", first.display(), second.display())]
    SameName {
        /// The name.
        name: String,
        /// The file of the first.
        first: PathBuf,
        /// The file of the other.
        second: PathBuf,
    },
    /// A mesh file is another one than it was a moment ago.
    #[error("the model {} was replaced while it was opened: start again", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// It cannot be built.
    #[error("{0}")]
    Build(#[from] BuildError),
    /// A shape that there is not.
    #[error("{0}")]
    Shape(#[from] generate::UnknownShape),
    /// No place for built models.
    #[error("no folder to keep built models in: set HRTC_CACHE to one that can be written")]
    NoCache,
    /// The cache cannot be written.
    #[error("cannot keep built models in {} ({error}): set HRTC_CACHE to a folder that can be written", folder.display())]
    Cache {
        /// The folder.
        folder: PathBuf,
        /// Why.
        error: io::Error,
    },
}

/// The models of a scene, each opened once, and which object has which.
#[derive(Debug)]
pub struct Database {
    /// Models.
    pub models: Vec<ServedModel<FileBytes>>,
    /// Objects in the scene's order.
    pub objects: Vec<ServedObject>,
}

impl Database {
    /// Opens the models of a scene; builds what is not there yet.
    ///
    /// # Errors
    /// One sentence on the first model that cannot be served.
    pub fn open(plan: &ScenePlan, progress: &dyn Progress) -> Result<Self, DatabaseError> {
        let mut models: Vec<ServedModel<FileBytes>> = Vec::new();
        let mut objects = Vec::new();
        let mut opened: BTreeMap<&ModelSource, usize> = BTreeMap::new();
        let mut named: BTreeMap<String, (usize, &ModelSource)> = BTreeMap::new();
        for object in &plan.objects {
            let name = object.model.name();
            let model = match opened.get(&object.model) {
                Some(&model) => model,
                None => {
                    let file = open_source(&object.model, &plan.folder, progress)?;
                    // Two names of the same content are one model: clients count records by
                    // content.
                    let hash = file.model_header().model;
                    let same = models
                        .iter()
                        .position(|m| m.file.model_header().model == hash);
                    let model = same.unwrap_or(models.len());
                    if same.is_none() {
                        models.push(ServedModel {
                            name: name.clone(),
                            file,
                        });
                    }
                    let of_name = named.entry(name.clone());
                    let (first, source) = *of_name.or_insert((model, &object.model));
                    if first != model {
                        return Err(same_name(name, [source, &object.model], &plan.folder));
                    }
                    opened.insert(&object.model, model);
                    model
                }
            };
            objects.push(ServedObject {
                model,
                name: Request::name_hash(&name),
            });
        }
        Ok(Self { models, objects })
    }
}

/// Refuses two different models of one name.
fn same_name(name: String, models: [&ModelSource; 2], folder: &Path) -> DatabaseError {
    let [first, second] = models.map(|source| match source {
        ModelSource::File(path) => folder.join(path),
        ModelSource::Generate { .. } => name.clone().into(),
    });
    DatabaseError::SameName {
        name,
        first,
        second,
    }
}

/// The folder of built models.
fn cache_folder() -> Result<PathBuf, DatabaseError> {
    scene_files::cache_folder().ok_or(DatabaseError::NoCache)
}

fn open_source(
    source: &ModelSource,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<SpmFile<FileBytes>, DatabaseError> {
    match source {
        ModelSource::File(path) => {
            let path = folder.join(path);
            if spm_builder::is_mesh_file(&path) {
                open_mesh(&path, &cache_folder()?, progress)
            } else {
                open_spm(&path)
            }
        }
        ModelSource::Generate { shape, faces } => {
            let parsed: Shape = shape.parse()?;
            let content = format!("{shape}-{faces}-{GENERATE_SEED}");
            open_cached(&cache_folder()?, &content, progress, &|output| {
                progress.phase("generating", 0);
                let mesh = generate::generate(parsed, *faces, GENERATE_SEED);
                build_into(mesh, output, progress)
            })
        }
    }
}

/// Versions of all that decides what a build gives.
fn versions() -> String {
    format!("b{BUILDER_VERSION}f{FORMAT_VERSION}")
}

/// Opens the SPM of a mesh file, built when the cache does not hold it.
fn open_mesh(
    path: &Path,
    cache: &Path,
    progress: &dyn Progress,
) -> Result<SpmFile<FileBytes>, DatabaseError> {
    let content = content_name(path, read_model(path)?.as_ref());
    open_cached(cache, &content, progress, &|output| {
        let in_file = |error: BuildError| error.in_file(path);
        let format = MeshFormat::of(path).ok_or(BuildError::UnknownFormat);
        let format = format.map_err(in_file)?;
        // Who waited for another build may find another file by now.
        let bytes = read_model(path)?;
        if content_name(path, bytes.as_ref()) != content {
            return Err(DatabaseError::Changed {
                path: path.to_owned(),
            });
        }
        let mesh = spm_builder::read_mesh_bytes(bytes.as_ref(), format).map_err(in_file)?;
        drop(bytes);
        build_into(mesh, output, progress).map_err(|e| match e {
            DatabaseError::Build(error) => error.in_file(path).into(),
            other => other,
        })
    })
}

/// The name of a mesh file's content in the cache: how the file is called, and a hash.
fn content_name(path: &Path, content: &[u8]) -> String {
    let mut hash = Xxh3Default::new();
    hash.update(content);
    // The ending decides how the bytes are read.
    let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
    hash.update(ending.as_encoded_bytes());
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let stem: String = stem.chars().take(NAME_CHARS).collect();
    format!("{stem}-{:016x}", hash.digest())
}

fn build_into(
    mesh: spm_builder::SoupMesh,
    output: &Path,
    progress: &dyn Progress,
) -> Result<(), DatabaseError> {
    spm_builder::check_room(output, mesh.triangles.len() as u64)?;
    let parts = spm_builder::build_model(mesh, &BuildOptions::default(), progress)?;
    spm_builder::write_spm_file(&parts, output)
        .map(|_| ())
        .map_err(|error| cache_error(output, error))
}

/// Opens a file of the cache; makes it when it is not there or no longer sound, block by block.
///
/// One builds at a time: who comes meanwhile waits, and finds what was built. What killed builds
/// and other versions of the builder left behind is removed first, and what there is no room for.
fn open_cached(
    cache: &Path,
    content: &str,
    progress: &dyn Progress,
    make: &dyn Fn(&Path) -> Result<(), DatabaseError>,
) -> Result<SpmFile<FileBytes>, DatabaseError> {
    let path = cache.join(format!("{content}-{}.spm", versions()));
    let sound = || {
        let file = open_spm(&path).ok()?;
        file.check_all().ok()?;
        scene_files::note_use(&path);
        Some(file)
    };
    if let Some(file) = sound() {
        return Ok(file);
    }
    let failed = |error| cache_error(&path, error);
    fs::create_dir_all(cache).map_err(failed)?;
    // The folder itself, so that no file is left.
    let lock = File::open(cache).map_err(failed)?;
    // Any other refusal: there are no locks here, and nobody can wait for another.
    if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
        progress.phase("waiting for another build", 0);
        let _ = lock.lock();
    }
    if let Some(file) = sound() {
        return Ok(file);
    }
    remove_other_versions(cache, content, &path).map_err(failed)?;
    let is_built = |name: &str| content_of(name).is_some();
    scene_files::make_room(cache, MAX_BUILT_BYTES, KEPT, is_built);
    // Cleans up behind killed builds.
    // Its own sentence asks for another output, which nobody named here.
    spm_builder::try_output(&path).map_err(|error| failed(error.kind().into()))?;
    make(&path)?;
    open_spm(&path)
}

/// Of what content a file of the cache was built, by its name: other files are not ours.
fn content_of(name: &str) -> Option<&str> {
    let (content, versions) = name.strip_suffix(".spm")?.rsplit_once('-')?;
    let (builder, format) = versions.strip_prefix('b')?.split_once('f')?;
    let are_numbers = [builder, format].iter().all(|n| n.parse::<u32>().is_ok());
    are_numbers.then_some(content)
}

/// Removes what another version made of the same content.
fn remove_other_versions(cache: &Path, content: &str, keep: &Path) -> io::Result<()> {
    for entry in fs::read_dir(cache)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if content_of(&name) == Some(content) && path != keep {
            // Another user's, or gone meanwhile: it is only room.
            let _ = fs::remove_file(&path);
        }
    }
    Ok(())
}

fn cache_error(path: &Path, error: io::Error) -> DatabaseError {
    DatabaseError::Cache {
        folder: path.parent().unwrap_or(path).to_owned(),
        error,
    }
}

/// Reads an SPM file and checks what is checked on open.
///
/// # Errors
/// When it cannot be opened, or is no sound SPM file.
pub fn open_spm(path: &Path) -> Result<SpmFile<FileBytes>, DatabaseError> {
    SpmFile::open(read_model(path)?).map_err(|error| DatabaseError::File {
        path: path.to_owned(),
        error,
    })
}

fn read_model(path: &Path) -> Result<FileBytes, DatabaseError> {
    FileBytes::open(path).map_err(|error| DatabaseError::Open {
        path: path.to_owned(),
        error,
    })
}

#[cfg(test)]
mod tests;
