//! The shape of a probe.

use crate::limits::{DEFAULT_RADIUS_M, DEFAULT_TOOL_FACES, LENGTH_M, TOOL_FACES};
use crate::plan::{ProbeShape, ToolMeshPlan};
use crate::source::{Keyed, SceneError, Source, key};
use crate::typed::{MeshTyped, RodTyped, ShapeTyped, Whole};
use glam::DVec3;
use spm::{FileError, SpmFile, prefix_mesh};

/// Checks a shape; a mesh is read.
pub(super) fn probe_shape(
    source: &Source,
    typed: Option<&ShapeTyped>,
) -> Result<ProbeShape, SceneError> {
    match typed {
        None => Ok(ProbeShape::Sphere {
            radius_m: DEFAULT_RADIUS_M,
        }),
        Some(ShapeTyped::Sphere(sphere)) => Ok(ProbeShape::Sphere {
            radius_m: source.number(key!(sphere.radius_m), DEFAULT_RADIUS_M, LENGTH_M)?,
        }),
        Some(ShapeTyped::Capsule(rod)) => {
            let (radius_m, length_m, faces) = rod_numbers(source, rod)?;
            if length_m < 2.0 * radius_m {
                return Err(source.value(
                    &rod.length_m,
                    "a capsule is at least as long as it is thick: length_m counts from end to end",
                ));
            }
            Ok(ProbeShape::Capsule {
                radius_m,
                length_m,
                faces,
            })
        }
        Some(ShapeTyped::Cylinder(rod)) => {
            let (radius_m, length_m, faces) = rod_numbers(source, rod)?;
            Ok(ProbeShape::Cylinder {
                radius_m,
                length_m,
                faces,
            })
        }
        Some(ShapeTyped::Mesh(mesh)) => Ok(ProbeShape::Mesh(tool_mesh(source, mesh)?)),
    }
}

fn faces(source: &Source, typed: Keyed<Whole>) -> Result<u32, SceneError> {
    let faces = source.number(typed, DEFAULT_TOOL_FACES, TOOL_FACES)?;
    Ok(u32::try_from(faces).unwrap_or(u32::MAX))
}

fn rod_numbers(source: &Source, rod: &RodTyped) -> Result<(f64, f64, u32), SceneError> {
    Ok((
        source.required(key!(rod.radius_m), LENGTH_M)?,
        source.required(key!(rod.length_m), LENGTH_M)?,
        faces(source, key!(rod.faces))?,
    ))
}

/// Reads a tool at the finest level of detail within its number of faces, its base mesh where that
/// has more already, and scales it to its size.
fn tool_mesh(source: &Source, mesh: &MeshTyped) -> Result<ToolMeshPlan, SceneError> {
    let size = source.required(key!(mesh.size_m), LENGTH_M)?;
    let max_faces = faces(source, key!(mesh.faces))?;
    let path = source.path(&mesh.file);
    let shown = path.display().to_string();
    let refused = |sentence: String| source.value(&mesh.file, &sentence);
    let bytes = source.read(&path).map_err(|error| {
        refused(format!(
            "the tool {shown} cannot be read ({error}); name an SPM file relative to the scene"
        ))
    })?;
    let read = |bytes| -> Result<_, FileError> { prefix_mesh(&SpmFile::open(bytes)?, max_faces) };
    let (positions, triangles) = read(bytes).map_err(|error| {
        refused(format!(
            "the tool {shown} is no SPM file that can be used ({error}); make one with: ve-station build MESH -o TOOL.spm"
        ))
    })?;
    if triangles.len() > *TOOL_FACES.end() as usize {
        return Err(refused(format!(
            "the tool {shown} has {} faces at its coarsest, more than {}; build it with --base-faces {max_faces}",
            triangles.len(),
            TOOL_FACES.end()
        )));
    }
    let lower = positions.iter().fold(DVec3::INFINITY, |low, &p| low.min(p));
    let upper = positions
        .iter()
        .fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
    let scale = size / (upper - lower).max_element();
    if !(scale.is_normal() && scale > 0.0) {
        return Err(refused(format!("the tool {shown} has no extent")));
    }
    Ok(ToolMeshPlan {
        file: shown,
        positions: positions.iter().map(|&p| p * scale).collect(),
        triangles,
    })
}
