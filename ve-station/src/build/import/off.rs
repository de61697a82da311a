//! OFF, the format of Geomview: counts, vertices, polygons. `COFF`, `NOFF` and the like carry colours or
//! normals after each position, on the same line, which are passed over.

use super::text::{Lines, excerpt, position, words};
use super::{BuildError, SoupMesh};

pub(super) fn read(text: &[u8]) -> Result<SoupMesh, BuildError> {
    let not_off = |reason: &str| BuildError::Format {
        format: "OFF",
        reason: reason.to_string(),
    };
    let mut lines = Lines::of(text)
        .map(|(line, content)| (line, content, words(content).collect::<Vec<_>>()))
        .filter(|(_, _, words)| !words.is_empty());
    let (line, content, mut first) = lines.next().ok_or_else(|| not_off("the file is empty"))?;
    if !first[0].ends_with("OFF") || first[0].contains('4') || first[0].contains('n') {
        return Err(not_off("it does not start with OFF"));
    }
    if first.get(1) == Some(&"BINARY") {
        return Err(not_off("it is a binary one: convert it to text, or to PLY"));
    }
    first.remove(0);
    let (line, content, counts) = if first.is_empty() {
        lines
            .next()
            .ok_or_else(|| not_off("it ends before its counts"))?
    } else {
        (line, content, first)
    };
    let bad = |line: u64, content: &[u8], what: &str| BuildError::Line {
        line,
        reason: format!("\"{}\" is no {what}: correct it", excerpt(content)),
    };
    let count = |at: usize| counts.get(at)?.parse::<u64>().ok();
    let (Some(vertices), Some(faces)) = (count(0), count(1)) else {
        return Err(bad(line, content, "count of vertices and faces"));
    };
    let mut mesh = SoupMesh::default();
    for _ in 0..vertices {
        let (line, content, words) = lines
            .next()
            .ok_or_else(|| not_off("it ends before its last vertex"))?;
        let position =
            position(&mut words.into_iter()).ok_or_else(|| bad(line, content, "vertex"))?;
        mesh.positions.push(position);
    }
    for _ in 0..faces {
        let (line, content, words) = lines
            .next()
            .ok_or_else(|| not_off("it ends before its last face"))?;
        let wanted = words[0].parse::<usize>().ok();
        let corners: Option<Vec<u32>> = wanted
            .filter(|&wanted| wanted < words.len())
            .and_then(|wanted| words[1..=wanted].iter().map(|w| index(w)).collect());
        mesh.push_polygon(&corners.ok_or_else(|| bad(line, content, "face"))?);
    }
    Ok(mesh)
}

/// Indices count from 0; what names no vertex is `u32::MAX`.
fn index(word: &str) -> Option<u32> {
    let number: i64 = word.parse().ok()?;
    Some(u32::try_from(number).unwrap_or(u32::MAX))
}
