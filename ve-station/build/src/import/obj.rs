//! Wavefront OBJ: `v` and `f` lines; everything else is about looks.

use super::Soup;
use super::text::{Lines, excerpt, position, words};
use crate::error::BuildError;
use crate::mesh::SoupMesh;

pub(super) fn read(text: &[u8]) -> Result<SoupMesh, BuildError> {
    let mut soup = Soup::default();
    let mut corners = Vec::new();
    for (line, content) in Lines::of(text) {
        let mut words = words(content);
        let bad = |what: &str| BuildError::Line {
            line,
            reason: format!(
                "\"{}\" is no {what}: correct or delete it",
                excerpt(content)
            ),
        };
        match words.next() {
            Some("v") => {
                let position = position(&mut words).ok_or_else(|| bad("vertex"))?;
                soup.mesh.positions.push(position);
            }
            Some("f") => {
                corners.clear();
                for word in words {
                    let number = word.split('/').next().unwrap_or_default();
                    let number: i64 = number.parse().map_err(|_| bad("face"))?;
                    corners.push(resolve(number, soup.mesh.positions.len()));
                }
                soup.push_polygon(&corners);
            }
            _ => {}
        }
    }
    if soup.mesh.positions.is_empty() {
        return Err(BuildError::Format {
            format: "Wavefront OBJ",
            reason: "it has no line that starts with v".to_string(),
        });
    }
    soup.finish()
}

/// Numbers count from 1; negative ones from the last vertex so far. What names no vertex is
/// `u32::MAX`, which is beyond every mesh.
fn resolve(number: i64, vertices: usize) -> u32 {
    let index = if number > 0 {
        number - 1
    } else if number < 0 {
        number.saturating_add(vertices as i64)
    } else {
        -1
    };
    u32::try_from(index).unwrap_or(u32::MAX)
}
