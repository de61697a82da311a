//! The settings beside the tolerance, each turned alone from the product's defaults.

use super::check_stop;
use super::result::{Knob, Point};
use crate::failure::{Chosen, Failure};
use crate::models::source::shape_soup;
use crate::report::output::write_whole_at;
use crate::report::units::{bytes, grouped};
use crate::trajectory::scene_model::SceneModel;
use hrtc_core::Controller;
use hrtc_core::cache::Cache;
use hrtc_core::contact::rigid_proxy::StepSettings;
use hrtc_core::governor::{CostGroup, WorkCosts};
use hrtc_core::lod::predict::{Course, Sources};
use scene::{
    AccuracyPlan, Effect, EffectPlan, ModelSource, NoFiles, Overrides, ProbeShape, RefinementPlan,
    ScenePlan, parse,
};
use spm::write_spm;
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model, is_mesh_file, read_mesh};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Cells of the grid, in those of the default.
const GRIDS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// Faces of the base mesh; those with more than a quarter of the full mesh are left out.
const BASE_FACES: [u32; 4] = [100, 400, 1600, 6400];
/// Caches, in bytes for each record of the model beyond the least that takes it: from that to one
/// with room for half of the model and more.
const CACHE_BYTES_A_RECORD: [f64; 4] = [0.0, 10.0, 50.0, 250.0];
/// Splits and collapses a millisecond.
const OPERATIONS: [usize; 5] = [6, 12, 24, 96, 192];
/// How many times slower than the reference machine.
const SLOWER: [f64; 6] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
/// Ticks a second.
const RATES_HZ: [f64; 4] = [500.0, 1000.0, 2000.0, 4000.0];
/// Faces of the tool.
const TOOL_FACES: [u32; 3] = [60, 240, 960];
/// Steps of a tool in a tick.
const ITERATIONS: [u32; 4] = [1, 2, 4, StepSettings::PRODUCT.max_steps];
/// Contact offsets, as fractions of the radius of gyration.
const OFFSETS: [f64; 4] = [1e-5, 1e-4, 1e-3, 1e-2];
/// What is predicted from.
const PREDICTORS: [(&str, Sources); 4] = [
    ("where the probe is", of(false, None, false)),
    ("neighbours", of(true, None, false)),
    ("a straight course", of(true, Some(Course::Linear), false)),
    ("all", Sources::ALL),
];
/// Scenes with every effect and with a tool.
const EFFECTS_SCENE: &str = include_str!("../../../../config/scenes/effects.toml");
const TOOL_SCENE: &str = include_str!("../../../../config/scenes/tool.toml");

const fn of(neighbours: bool, course: Option<Course>, landing: bool) -> Sources {
    Sources {
        neighbours,
        course,
        landing,
    }
}

/// A setting to be measured.
#[derive(Clone)]
pub struct Variant {
    /// What is turned, and to what.
    pub point: Point,
    /// The scene that asks for it.
    pub plan: ScenePlan,
    /// What no key of a scene sets.
    pub beside: Beside,
}

/// What no key of a scene sets.
#[derive(Debug, Clone, Copy)]
pub struct Beside {
    /// Sources of the prediction, where they are not the product's.
    pub sources: Option<Sources>,
    /// How a tool steps.
    pub steps: StepSettings,
    /// How many times slower than the reference machine the processor is.
    pub slow: f64,
}

impl Default for Beside {
    fn default() -> Self {
        Self {
            sources: None,
            steps: StepSettings::PRODUCT,
            slow: 1.0,
        }
    }
}

impl Beside {
    /// Sets it, before the first tick.
    pub fn set(&self, controller: &mut Controller) {
        if let Some(sources) = self.sources {
            controller.set_sources(sources);
        }
        controller.set_steps(self.steps);
        controller.set_costs(WorkCosts::REFERENCE.scaled([self.slow; CostGroup::ALL.len()]));
    }
}

/// Settings that are measured on the same touch.
pub struct Family {
    /// Its settings.
    pub variants: Vec<Variant>,
    /// The scene whose touch is recorded for them on the full mesh; none for that of the tolerance.
    pub touch: Option<ScenePlan>,
}

/// The table `accuracy` of a scene.
#[must_use]
pub fn accuracy_setting(plan: &AccuracyPlan) -> String {
    match plan.refinement {
        RefinementPlan::Local => format!("accuracy.tolerance_m = {:?}", plan.tolerance_m),
        RefinementPlan::Global { lod: None } => format!(
            "accuracy.refinement = \"global\", tolerance_m = {:?}",
            plan.tolerance_m
        ),
        RefinementPlan::Global { lod: Some(lod) } => {
            format!("accuracy.refinement = \"global\", lod = {lod}")
        }
    }
}

/// All knobs of a model; built models go into the folder.
///
/// # Errors
/// When the model cannot be built with another grid or base mesh, or the command is to end.
pub fn families(
    model: &SceneModel,
    folder: &Path,
    stop: &AtomicBool,
) -> Result<Vec<Family>, Failure> {
    let same = |variants| Family {
        variants,
        touch: None,
    };
    let mut all = vec![
        same(caches(model)),
        same(predictors(model)),
        same(operations(model)),
        same(processors(model)),
        same(geomorphs(model)),
    ];
    if let Some(mesh) = soup(model)? {
        let builds = Builds {
            mesh: &mesh,
            folder,
            stop,
        };
        all.insert(0, same(grids(model, &builds)?));
        all.insert(1, same(base_meshes(model, &builds)?));
    }
    all.extend(rates(model));
    all.extend(effects(model)?);
    all.extend(tools(model)?);
    Ok(all)
}

/// A setting of a scene that is like the model's own but for what `turn` changes.
fn variant(
    model: &SceneModel,
    (knob, value): (Knob, f64),
    label: String,
    setting: String,
    turn: impl FnOnce(&mut ScenePlan),
) -> Variant {
    let mut plan = model.plan.clone();
    turn(&mut plan);
    let mut point = Point::new(&model.mesh.name, knob, value);
    point.label = label;
    point.setting = setting;
    Variant {
        point,
        plan,
        beside: Beside::default(),
    }
}

/// The mesh that the model was built from; none where it was given as an SPM file.
fn soup(model: &SceneModel) -> Result<Option<SoupMesh>, Failure> {
    match &model.plan.objects[0].model {
        ModelSource::Generate { shape, faces } => shape_soup(shape, *faces).map(Some),
        ModelSource::File(path) if is_mesh_file(path) => read_mesh(path)
            .map(Some)
            .map_err(|error| Failure::Input(error.in_file(path).to_string())),
        ModelSource::File(_) => Ok(None),
    }
}

/// How the model is built anew.
struct Builds<'a> {
    mesh: &'a SoupMesh,
    folder: &'a Path,
    stop: &'a AtomicBool,
}

impl Builds<'_> {
    /// Builds it; the file's source.
    fn build(&self, options: &BuildOptions, name: &str) -> Result<ModelSource, Failure> {
        check_stop(self.stop)?;
        let failed = |error: &dyn std::fmt::Display| Failure::Run(format!("a build: {error}"));
        let mesh = self.mesh.clone();
        let parts = build_model(mesh, options, &NoProgress).map_err(|error| failed(&error))?;
        let mut bytes = Vec::new();
        write_spm(&parts, &mut bytes).map_err(|error| failed(&error))?;
        let path = self.folder.join(name);
        write_whole_at(Chosen::Temporary, &path, &bytes)?;
        Ok(ModelSource::File(path))
    }
}

fn grids(model: &SceneModel, builds: &Builds<'_>) -> Result<Vec<Variant>, Failure> {
    let divisions = f64::from(model.mesh.file.model_header().grid.divisions);
    let mut variants = Vec::new();
    for cells in GRIDS.map(|share| (share * divisions) as u32) {
        if cells == 0 {
            continue;
        }
        let options = BuildOptions {
            regions: Some(cells),
            ..BuildOptions::default()
        };
        let source = builds.build(&options, &format!("grid-{cells}.spm"))?;
        let setting = format!("no key of a scene: ve-station build --regions {cells}");
        let knob = (Knob::Grid, f64::from(cells));
        variants.push(variant(
            model,
            knob,
            format!("{cells} cells"),
            setting,
            |plan| {
                plan.objects[0].model = source;
            },
        ));
    }
    Ok(variants)
}

fn base_meshes(model: &SceneModel, builds: &Builds<'_>) -> Result<Vec<Variant>, Failure> {
    let most = model.mesh.file.model_header().faces / 4;
    let mut variants = Vec::new();
    for faces in BASE_FACES.into_iter().filter(|&faces| faces <= most) {
        let options = BuildOptions {
            base_faces: Some(faces),
            ..BuildOptions::default()
        };
        let source = builds.build(&options, &format!("base-{faces}.spm"))?;
        let label = format!("{} faces", grouped(faces.into()));
        let setting = format!("no key of a scene: ve-station build --base-faces {faces}");
        let knob = (Knob::BaseMesh, f64::from(faces));
        variants.push(variant(model, knob, label, setting, |plan| {
            plan.objects[0].model = source;
        }));
    }
    Ok(variants)
}

fn caches(model: &SceneModel) -> Vec<Variant> {
    let header = model.mesh.file.model_header();
    let (least, records) = (Cache::least_bytes(&header), f64::from(header.vsps));
    let sizes = CACHE_BYTES_A_RECORD.map(|each| least + (each * records) as usize);
    let one = |size: usize| {
        let label = bytes(size as u64);
        let knob = (Knob::Cache, size as f64);
        variant(
            model,
            knob,
            label,
            format!("cache.bytes = {size}"),
            |plan| {
                plan.cache_bytes = size;
            },
        )
    };
    sizes.into_iter().map(one).collect()
}

fn predictors(model: &SceneModel) -> Vec<Variant> {
    let one = |(place, (label, sources)): (usize, (&str, Sources))| {
        let setting = "no key of a scene; the product predicts from all".to_string();
        let knob = (Knob::Predictor, place as f64);
        Variant {
            beside: Beside {
                sources: Some(sources),
                ..Beside::default()
            },
            ..variant(model, knob, label.to_string(), setting, |_| ())
        }
    };
    PREDICTORS.into_iter().enumerate().map(one).collect()
}

fn operations(model: &SceneModel) -> Vec<Variant> {
    let one = |count: usize| {
        let setting = format!("loop.operations = {count}");
        let knob = (Knob::Operations, count as f64);
        variant(model, knob, format!("{count} a ms"), setting, |plan| {
            plan.loop_.operations = count;
        })
    };
    OPERATIONS.into_iter().map(one).collect()
}

fn processors(model: &SceneModel) -> Vec<Variant> {
    let one = |slow: f64| {
        let setting = "no key of a scene: the machine".to_string();
        let label = format!("{slow} times slower");
        Variant {
            beside: Beside {
                slow,
                ..Beside::default()
            },
            ..variant(model, (Knob::Processor, slow), label, setting, |_| ())
        }
    };
    SLOWER.map(one).into()
}

fn geomorphs(model: &SceneModel) -> Vec<Variant> {
    let one = |is_on: bool| {
        let label = if is_on { "on" } else { "off" };
        let setting = format!("accuracy.geomorph = {is_on}");
        let knob = (Knob::Geomorph, f64::from(u8::from(is_on)));
        variant(model, knob, label.to_string(), setting, |plan| {
            plan.accuracy.geomorph = is_on;
        })
    };
    [false, true].map(one).into()
}

/// A setting whose touch is another one.
fn alone(variant: Variant) -> Family {
    Family {
        touch: Some(variant.plan.clone()),
        variants: vec![variant],
    }
}

fn rates(model: &SceneModel) -> impl Iterator<Item = Family> + '_ {
    RATES_HZ.into_iter().map(|rate_hz| {
        let label = format!("{} kHz", rate_hz / 1e3);
        let setting = format!("loop.rate_hz = {rate_hz}");
        alone(variant(
            model,
            (Knob::Rate, rate_hz),
            label,
            setting,
            |plan| {
                plan.loop_ = plan.loop_.at_rate(rate_hz);
            },
        ))
    })
}

fn bundled(text: &str, name: &str) -> Result<ScenePlan, Failure> {
    Ok(parse(
        text,
        name,
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )?)
}

/// Each effect of the bundled scene alone, from the first tick on.
fn effects(model: &SceneModel) -> Result<Vec<Family>, Failure> {
    let scene = bundled(EFFECTS_SCENE, "effects.toml")?;
    let listed = scene.objects[0].effects.iter().chain(&scene.effects);
    let one = |(place, listed): (usize, &EffectPlan)| {
        let effect = EffectPlan {
            from_s: 0.0,
            until_s: f64::INFINITY,
            ..listed.clone()
        };
        let name = effect.effect.name();
        let setting = if effect.effect.is_of_surface() {
            format!("object.effects = [{{ {name} = {{ ... }} }}]")
        } else {
            format!("effects = [{{ {name} = {{ ... }} }}]")
        };
        let knob = (Knob::Effect, place as f64);
        alone(variant(model, knob, name.to_string(), setting, |plan| {
            if effect.effect.is_of_surface() {
                plan.objects[0].effects = Arc::from(vec![effect]);
            } else {
                plan.effects = vec![effect];
            }
        }))
    };
    // A boundary keeps the hand from the object: there is no touch to compare.
    let touching = listed.filter(|listed| !matches!(listed.effect, Effect::Boundary(_)));
    Ok(touching.enumerate().map(one).collect())
}

fn tools(model: &SceneModel) -> Result<Vec<Family>, Failure> {
    let probe = bundled(TOOL_SCENE, "tool.toml")?.probes.swap_remove(0);
    let with_tool = |knob: (Knob, f64), label: String, setting: String, faces: Option<u32>| {
        let mut shape = probe.shape.clone();
        if let (ProbeShape::Capsule { faces, .. }, Some(count)) = (&mut shape, faces) {
            *faces = count;
        }
        variant(model, knob, label, setting, |plan| {
            plan.probes[0].shape = shape;
            plan.probes[0].device = probe.device;
        })
    };
    let faces = TOOL_FACES.map(|count| {
        let setting = format!("probe.shape = {{ capsule = {{ ..., faces = {count} }} }}");
        let knob = (Knob::ToolFaces, f64::from(count));
        alone(with_tool(
            knob,
            format!("{count} faces"),
            setting,
            Some(count),
        ))
    });
    let stepped = |knob: (Knob, f64), label: String, steps: StepSettings| {
        let setting = "no key of a scene: fixed in the code".to_string();
        let mut variant = with_tool(knob, label, setting, None);
        variant.beside.steps = steps;
        variant
    };
    let iterations = ITERATIONS.map(|max_steps| {
        let steps = StepSettings {
            max_steps,
            ..StepSettings::PRODUCT
        };
        let label = format!("at most {max_steps} a tick");
        stepped((Knob::Iterations, f64::from(max_steps)), label, steps)
    });
    let offsets = OFFSETS.map(|contact_offset| {
        let steps = StepSettings {
            contact_offset: [contact_offset; 2],
            ..StepSettings::PRODUCT
        };
        let label = format!("{contact_offset:.0e} of the gyration");
        stepped((Knob::ContactOffset, contact_offset), label, steps)
    });
    // All of these beside one touch of the product's tool.
    let variants: Vec<Variant> = iterations.into_iter().chain(offsets).collect();
    let touch = variants.first().map(|variant| variant.plan.clone());
    let stepped = Family { variants, touch };
    Ok(faces.into_iter().chain([stepped]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use spm_builder::generate::{Shape, generate};

    #[test]
    fn nothing_is_built_once_the_command_is_to_end() {
        let folder = tempfile::tempdir().expect("a folder");
        let mesh = generate(Shape::Relief, 1000, 1);
        let built = |is_to_end: bool| {
            let builds = Builds {
                mesh: &mesh,
                folder: folder.path(),
                stop: &AtomicBool::new(is_to_end),
            };
            builds.build(&BuildOptions::default(), "grid-1.spm")
        };
        let path = folder.path().join("grid-1.spm");
        assert_eq!(
            built(true).err(),
            Some(Failure::Run("ended on request".to_string()))
        );
        assert!(!path.exists());
        assert!(built(false).is_ok() && path.is_file());
    }
}
