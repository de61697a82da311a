//! A CDPM as text: base mesh, then splits in their one order. The groups of faces are written out,
//! so that any split can be followed, those of a mesh that is no manifold too. Base mesh and splits
//! stand in this order, so that every face round a vertex is known when it is split.

use super::{Fields, Lines, check_count, keyword_lines, refused, sum};
use crate::error::BuildError;
use crate::mesh::SoupMesh;

pub(super) fn read(text: &[u8]) -> Result<SoupMesh, BuildError> {
    let mut mesh = SoupMesh::default();
    // By vertex, once there are splits: faces round it.
    let mut round = Vec::new();
    let mut splits = 0;
    for (keyword, mut fields) in keyword_lines(text) {
        match keyword {
            "v" if splits == 0 => {
                let position = fields.vector();
                let position = position.ok_or_else(|| fields.bad("no vertex"))?;
                mesh.positions.push(position);
            }
            "f" if splits == 0 => {
                let mut corners = || Some([fields.index()?, fields.index()?, fields.index()?]);
                let corners = corners().ok_or_else(|| fields.bad("no face"))?;
                mesh.triangles.push(corners);
            }
            "v*" => {
                if splits == 0 {
                    round = faces_round(&mesh);
                }
                splits += 1;
                split(&mut fields, &mut mesh, &mut round)
                    .ok_or_else(|| fields.bad("no split of the mesh so far"))?;
            }
            _ => return Err(fields.bad("no line of a CDPM")),
        }
    }
    if mesh.positions.is_empty() {
        return Err(refused("it has no line that starts with v"));
    }
    // Cut off behind a line it would be a coarser mesh.
    if let Some([faces, vertices, vsps]) = announced(text) {
        check_count("splits", vsps, splits)?;
        check_count("vertices", vertices, mesh.positions.len())?;
        check_count("faces", faces, mesh.triangles.len())?;
    }
    Ok(mesh)
}

/// Faces, vertices and splits of the full mesh, where a comment says them:
/// `# 3D model: F faces V vertices N VSPs`.
fn announced(text: &[u8]) -> Option<[u64; 3]> {
    Lines::of(text).find_map(|(_, line)| {
        let comment = std::str::from_utf8(line).ok()?.trim_start();
        let mut words = comment.strip_prefix('#')?.split_ascii_whitespace();
        let mut is_next = |expected: &str| words.next() == Some(expected);
        if !(is_next("3D") && is_next("model:")) {
            return None;
        }
        let mut counts = [0; 3];
        for (count, of) in counts.iter_mut().zip(["faces", "vertices", "VSPs"]) {
            *count = words.next()?.parse().ok()?;
            if words.next() != Some(of) {
                return None;
            }
        }
        Some(counts)
    })
}

/// By vertex: how many faces name it.
fn faces_round(mesh: &SoupMesh) -> Vec<u32> {
    let mut round = vec![0; mesh.positions.len()];
    for corners in &mesh.triangles {
        for (k, vertex) in corners.iter().enumerate() {
            let is_first = !corners[..k].contains(vertex);
            // One that is not there is counted when the mesh is cleaned.
            if let Some(faces) = round.get_mut(*vertex as usize).filter(|_| is_first) {
                *faces += 1;
            }
        }
    }
    round
}

/// `vs dxs dys dzs dxt dyt dzt v1 .. vm & p f1 .. fp f1' .. fq'`; `None` when it does not fit the
/// mesh, or lists fewer faces than there are round vs: it is cut off.
fn split<'a>(
    fields: &mut Fields<'a, impl Iterator<Item = &'a str>>,
    mesh: &mut SoupMesh,
    round: &mut Vec<u32>,
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
    let in_first_group = usize::try_from(fields.integer()?).ok()?;
    let mut listed = Vec::new();
    for word in fields.words.by_ref() {
        let face = word.parse::<usize>().ok()?.checked_sub(1)?;
        let corners = mesh.triangles.get_mut(face)?;
        let corner = corners.iter_mut().find(|corner| **corner == first)?;
        if listed.len() >= in_first_group {
            *corner = second;
        }
        listed.push(face);
    }
    let count = listed.len();
    listed.sort_unstable();
    listed.dedup();
    let all = *round.get(first as usize)? as usize;
    if listed.len() != count || count != all || in_first_group > count {
        return None;
    }
    let named = |vertex: u32| {
        let faces = listed.iter().map(|&face| &mesh.triangles[face]);
        faces.filter(|corners| corners.contains(&vertex)).count() as u32
    };
    round[first as usize] = named(first);
    round.push(named(second));
    for vertex in new_faces.as_flattened() {
        round[*vertex as usize] += 1;
    }
    mesh.positions[first as usize] = sum(parent, of_first);
    mesh.positions.push(sum(parent, of_second));
    mesh.triangles.extend(new_faces);
    Some(())
}
