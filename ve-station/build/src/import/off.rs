//! OFF, the format of Geomview: counts, vertices, polygons. `COFF`, `NOFF` and the like carry
//! colours or normals after each position, on the same line, which are passed over.

use super::Soup;
use super::text::{Lines, excerpt, index, position, words};
use crate::error::BuildError;
use crate::mesh::SoupMesh;

pub(super) fn read(text: &[u8]) -> Result<SoupMesh, BuildError> {
    let mut lines = Lines::of(text).filter(|(_, content)| words(content).next().is_some());
    let (mut line, mut content) = lines.next().ok_or_else(|| not_off("the file is empty"))?;
    let mut counts: Vec<&str> = words(content).collect();
    if counts[0].parse::<u64>().is_err() {
        // The keyword may be left out, but a first count may also cling to it.
        let keyword = counts[0].trim_end_matches(|c: char| c.is_ascii_digit());
        let clinging = &counts[0][keyword.len()..];
        let known = ["OFF", "COFF", "NOFF", "CNOFF", "STOFF", "STCOFF", "STNOFF"];
        if !known.contains(&keyword) && keyword != "STCNOFF" {
            return Err(not_off("it does not start with OFF"));
        }
        if counts.get(1) == Some(&"BINARY") {
            return Err(not_off("it is a binary one: convert it to text, or to PLY"));
        }
        if clinging.is_empty() {
            counts.remove(0);
        } else {
            counts[0] = clinging;
        }
        if counts.is_empty() {
            (line, content) = lines
                .next()
                .ok_or_else(|| not_off("it ends before its counts"))?;
            counts = words(content).collect();
        }
    }
    let bad = |line: u64, content: &[u8], what: &str| BuildError::Line {
        line,
        reason: format!("\"{}\" is no {what}: correct it", excerpt(content)),
    };
    let count = |at: usize| counts.get(at)?.parse::<u64>().ok();
    let (Some(vertices), Some(faces)) = (count(0), count(1)) else {
        return Err(bad(line, content, "count of vertices and faces"));
    };
    let mut soup = Soup::default();
    for _ in 0..vertices {
        let (line, content) = lines
            .next()
            .ok_or_else(|| not_off("it ends before its last vertex"))?;
        let position = position(&mut words(content)).ok_or_else(|| bad(line, content, "vertex"))?;
        soup.mesh.positions.push(position);
    }
    let mut corners = Vec::new();
    for _ in 0..faces {
        let (line, content) = lines
            .next()
            .ok_or_else(|| not_off("it ends before its last face"))?;
        corners.clear();
        polygon(words(content), &mut corners).ok_or_else(|| bad(line, content, "face"))?;
        soup.push_polygon(&corners);
    }
    soup.finish()
}

/// A count and as many indices; what follows is a colour.
fn polygon<'a>(mut words: impl Iterator<Item = &'a str>, corners: &mut Vec<u32>) -> Option<()> {
    let count: u64 = words.next()?.parse().ok()?;
    for _ in 0..count {
        corners.push(index(words.next()?)?);
    }
    Some(())
}

fn not_off(reason: &str) -> BuildError {
    BuildError::Format {
        format: "OFF",
        reason: reason.to_string(),
    }
}
