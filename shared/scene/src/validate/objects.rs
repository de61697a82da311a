//! The objects of a scene: tables, their names and their copies.

use super::movable::movable_plan;
use crate::limits::{
    GENERATED_FACES, IMPORTANCE, LENGTH_M, MAX_LENGTH_M, NOT_NEGATIVE, POSITIVE, Range,
};
use crate::plan::{MAX_OBJECTS, ModelScale, ModelSource, ObjectPlan, SHAPES, SurfacePlan};
use crate::source::{SceneError, Source, key};
use crate::typed::{GenerateTyped, GridTyped, ObjectTyped};
use geometry::Pose;
use glam::DVec3;
use std::sync::Arc;
use toml::Spanned;

/// The objects of a scene and their names.
pub(super) struct Objects<'a> {
    /// Objects in their order, copies included.
    pub(super) plans: Vec<ObjectPlan>,
    /// Names, each with the index of its object.
    names: Vec<(&'a str, usize)>,
    /// The objects of each table.
    pub(super) copies: Vec<std::ops::Range<usize>>,
}

impl<'a> Objects<'a> {
    pub(super) fn new(
        source: &Source,
        typed: &'a [Spanned<ObjectTyped>],
    ) -> Result<Self, SceneError> {
        let mut all = Self {
            plans: Vec::new(),
            names: Vec::new(),
            copies: Vec::new(),
        };
        for table in typed {
            let object = table.get_ref();
            if let Some(name) = &object.name {
                let known = all.names.iter().any(|(other, _)| other == name.get_ref());
                if known || name.get_ref().trim().is_empty() {
                    return Err(source.value(
                        name,
                        "the name is empty or another object's; give each object a name of its own, or none",
                    ));
                }
                all.names.push((name.get_ref(), all.plans.len()));
            }
            let first = all.plans.len();
            let plan = object_plan(source, object, table.span().start)?;
            match &object.grid {
                None => all.plans.push(plan),
                Some(grid) => all.plans.extend(copies(source, &plan, grid)?),
            }
            if all.plans.len() > MAX_OBJECTS {
                return Err(source.value(
                    table,
                    &format!("these are more than {MAX_OBJECTS} objects, the most that a scene may have; take some out"),
                ));
            }
            all.copies.push(first..all.plans.len());
        }
        if all.plans.is_empty() {
            return Err(source
                .whole("there is no [[object]]; name the model to touch in an [[object]] table"));
        }
        Ok(all)
    }

    /// Index of the object that a tour names.
    pub(super) fn index(
        &self,
        source: &Source,
        typed: &Spanned<toml::Value>,
    ) -> Result<usize, SceneError> {
        let found = match typed.get_ref() {
            toml::Value::Integer(number) => usize::try_from(*number)
                .ok()
                .filter(|&index| index < self.plans.len()),
            toml::Value::String(name) => {
                let named = self.names.iter().find(|(other, _)| other == name);
                named.map(|&(_, index)| index)
            }
            _ => None,
        };
        found.ok_or_else(|| {
            source.value(
                typed,
                &format!(
                    "there is no such object; write a number from 0 to {} or the name of an object in quotes",
                    self.plans.len() - 1
                ),
            )
        })
    }
}

/// Copies of an object on a grid along the axes of the world, x fastest; the first is the object
/// itself.
fn copies(
    source: &Source,
    plan: &ObjectPlan,
    grid: &GridTyped,
) -> Result<Vec<ObjectPlan>, SceneError> {
    let spacing = source.required(key!(grid.spacing_m), LENGTH_M)?;
    let counts = grid.counts.get_ref().0;
    let total = counts
        .iter()
        .try_fold(1i64, |total, &n| total.checked_mul(n));
    let fits =
        counts.iter().all(|&n| n >= 1) && total.is_some_and(|total| total <= MAX_OBJECTS as i64);
    if !fits {
        return Err(source.value(
            &grid.counts,
            &format!("counts is {counts:?}; write three whole numbers from 1 up whose product is at most {MAX_OBJECTS}"),
        ));
    }
    let offset = |place: [i64; 3]| DVec3::from_array(place.map(|k| k as f64)) * spacing;
    let last = plan.pose.position + offset(counts.map(|n| n - 1));
    // The others are between it and the first.
    if !last.cmple(DVec3::splat(MAX_LENGTH_M)).all() {
        return Err(source.value(
            &grid.spacing_m,
            &format!("spacing_m is {spacing}: the last copy would be beyond {MAX_LENGTH_M:e} m; write less, or smaller counts"),
        ));
    }
    let [nx, ny, nz] = counts;
    let places = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    Ok(places
        .map(|place| {
            let mut copy = plan.clone();
            copy.pose.position += offset(place);
            copy
        })
        .collect())
}

/// Checks an object; `start` is the byte where its table begins.
fn object_plan(
    source: &Source,
    typed: &ObjectTyped,
    start: usize,
) -> Result<ObjectPlan, SceneError> {
    let surface = &typed.surface;
    Ok(ObjectPlan {
        model: model_source(source, typed, start)?,
        scale: model_scale(source, typed, start)?,
        pose: pose(source, typed)?,
        surface: SurfacePlan {
            stiffness_n_per_m: source.number(key!(surface.stiffness_n_per_m), 800.0, POSITIVE)?,
            damping_ns_per_m: source.number(key!(surface.damping_ns_per_m), 0.5, NOT_NEGATIVE)?,
        },
        // Checked last, since their limits depend on the loop and the probes.
        effects: Arc::new([]),
        movable: typed
            .movable
            .as_ref()
            .map(|movable| movable_plan(source, movable.get_ref()))
            .transpose()?,
        importance: source.number(key!(typed.importance), 1.0, IMPORTANCE)?,
    })
}

fn model_source(
    source: &Source,
    typed: &ObjectTyped,
    start: usize,
) -> Result<ModelSource, SceneError> {
    match (&typed.model, &typed.generate) {
        (Some(file), None) if !file.get_ref().trim().is_empty() => {
            Ok(ModelSource::File(file.get_ref().into()))
        }
        (None, Some(generate)) => generate_plan(source, generate),
        (Some(file), _) => Err(source.value(
                file,
                "give either model = \"file.spm\" or generate = { shape = \"relief\", faces = 100000 }, not both and not an empty name",
            )),
        (None, None) => Err(source.at(
                start,
                "the object has no model; give model = \"file.spm\" or generate = { shape = \"relief\", faces = 100000 }",
            )),
    }
}

fn model_scale(
    source: &Source,
    typed: &ObjectTyped,
    start: usize,
) -> Result<ModelScale, SceneError> {
    match (&typed.size_m, &typed.metres_per_unit) {
        (Some(size), None) => {
            let size = source.required(("size_m", size), LENGTH_M)?;
            Ok(ModelScale::Size(size))
        }
        (None, Some(unit)) => {
            let range = Range::Within(1e-12, 1e12);
            let unit = source.required(("metres_per_unit", unit), range)?;
            Ok(ModelScale::MetresPerUnit(unit))
        }
        (Some(size), Some(_)) => Err(source.value(
            size,
            "give either size_m (its longest side) or metres_per_unit, not both",
        )),
        (None, None) => Err(source.at(
            start,
            "the object has no size; give size_m (its longest side, metres) or metres_per_unit",
        )),
    }
}

fn pose(source: &Source, typed: &ObjectTyped) -> Result<Pose, SceneError> {
    match &typed.pose {
        None => Ok(Pose::IDENTITY),
        Some(pose) => Pose::from_wxyz(
            pose.get_ref().position_m.map_or([0.0; 3], |of| of.0),
            pose.get_ref().orientation_wxyz.map_or([1.0, 0.0, 0.0, 0.0], |of| of.0),
        )
        .filter(|pose| pose.position.abs().max_element() <= MAX_LENGTH_M)
        .ok_or_else(|| {
            source.value(
                pose,
                "the pose needs finite numbers, a position within 1e7 m and an orientation (w, x, y, z) that is not all zero",
            )
        }),
    }
}

fn generate_plan(source: &Source, typed: &GenerateTyped) -> Result<ModelSource, SceneError> {
    let shape = typed.shape.get_ref();
    if !SHAPES.contains(&shape.as_str()) {
        return Err(source.value(
            &typed.shape,
            &format!(
                "there is no shape \"{shape}\"; take one of {}",
                SHAPES.join(", ")
            ),
        ));
    }
    let faces = source.required(key!(typed.faces), GENERATED_FACES)?;
    Ok(ModelSource::Generate {
        shape: shape.clone(),
        faces: faces as u32,
    })
}

#[cfg(test)]
mod tests {
    use crate::{NoFiles, Overrides, SceneError, ScenePlan, parse};
    use std::path::Path;

    /// The objects of a grid along z, on line 6, that begins at a height.
    fn grid(z_m: f64, count: u32, spacing_m: f64) -> Result<ScenePlan, SceneError> {
        let text = format!(
            "[[probe]]\n[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n\
             pose = {{ position_m = [0, 0, {z_m:?}] }}\n\
             grid = {{ counts = [1, 1, {count}], spacing_m = {spacing_m:?} }}\n"
        );
        let none = Overrides::default();
        parse(&text, "test.toml", Path::new(""), &none, &NoFiles)
    }

    #[test]
    fn a_copy_is_no_farther_than_an_object_may_be() {
        for (z_m, count, spacing_m) in [(0.0, 4096, 1e7), (0.0, 3, 5.1e6), (1.0, 2, 1e7)] {
            let refused = grid(z_m, count, spacing_m).unwrap_err().0;
            let place = "test.toml, line 6: spacing_m is ";
            assert!(refused.starts_with(place), "{refused}");
            assert!(refused.contains("beyond 1e7 m"), "{refused}");
        }
        for (z_m, count, spacing_m) in [(0.0, 3, 5e6), (-1e7, 3, 1e7), (1e7, 1, 1e7)] {
            let plan = grid(z_m, count, spacing_m).unwrap();
            let last = plan.objects.last().unwrap().pose.position.z;
            assert_eq!(last, z_m + f64::from(count - 1) * spacing_m);
        }
    }
}
