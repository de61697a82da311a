//! A CDPM as text: base mesh, then splits in their one order. The groups of faces are written out,
//! so that any split can be followed, those of a mesh that is no manifold too.

use super::{Fields, keyword_lines, refused, sum};
use crate::error::BuildError;
use crate::mesh::SoupMesh;

pub(super) fn read(text: &[u8]) -> Result<SoupMesh, BuildError> {
    let mut mesh = SoupMesh::default();
    for (keyword, mut fields) in keyword_lines(text) {
        match keyword {
            "v" => {
                let position = fields.vector();
                let position = position.ok_or_else(|| fields.bad("no vertex"))?;
                mesh.positions.push(position);
            }
            "f" => {
                let mut corners = || Some([fields.index()?, fields.index()?, fields.index()?]);
                let corners = corners().ok_or_else(|| fields.bad("no face"))?;
                mesh.triangles.push(corners);
            }
            "v*" => {
                split(&mut fields, &mut mesh)
                    .ok_or_else(|| fields.bad("no split of the mesh so far"))?;
            }
            _ => return Err(fields.bad("no line of a CDPM")),
        }
    }
    if mesh.positions.is_empty() {
        return Err(refused("it has no line that starts with v"));
    }
    Ok(mesh)
}

/// `vs dxs dys dzs dxt dyt dzt v1 .. vm & p f1 .. fp f1' .. fq'`; `None` when it does not fit the
/// mesh.
fn split<'a>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
    mesh: &mut SoupMesh,
) -> Option<()> {
    let first = fields.index()?;
    let parent = *mesh.positions.get(first as usize)?;
    let (of_first, of_second) = (fields.vector()?, fields.vector()?);
    let second = u32::try_from(mesh.positions.len()).ok()?;
    let mut new_faces = Vec::new();
    loop {
        match fields.words.next()? {
            "&" => break,
            word => {
                let third: i64 = word.parse().ok()?;
                let vertex = u32::try_from(third.unsigned_abs().checked_sub(1)?).ok()?;
                let exists = vertex < second && vertex != first;
                let corners = if third > 0 {
                    [first, second, vertex]
                } else {
                    [second, first, vertex]
                };
                new_faces.push(exists.then_some(corners)?);
            }
        }
    }
    let in_first_group = fields.integer()?;
    let mut listed = 0;
    for word in fields.words.by_ref() {
        let face = word.parse::<usize>().ok()?.checked_sub(1)?;
        let corners = mesh.triangles.get_mut(face)?;
        let corner = corners.iter_mut().find(|corner| **corner == first)?;
        if listed >= in_first_group {
            *corner = second;
        }
        listed += 1;
    }
    mesh.positions[first as usize] = sum(parent, of_first);
    mesh.positions.push(sum(parent, of_second));
    mesh.triangles.extend(new_faces);
    (0..=listed).contains(&in_first_group).then_some(())
}
