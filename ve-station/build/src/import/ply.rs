//! PLY: a header that declares elements, then their values as text or binary of either byte order.
//!
//! `vertex` gives positions (x, y, z of any scalar type), `face` polygons and `tristrips` strips of
//! triangles (-1 starts another). Everything else is passed over.

mod header;
mod values;

use super::Soup;
use crate::error::BuildError;
use crate::mesh::SoupMesh;
use header::{Element, Encoding, Kind, read_header};
use values::{Binary, Text, Values};

pub(super) fn read(bytes: &[u8]) -> Result<SoupMesh, BuildError> {
    let header = read_header(bytes)?;
    let mut soup = Soup::default();
    match header.encoding {
        Encoding::Text => read_elements(&header.elements, Text::new(header.lines), &mut soup)?,
        Encoding::Little => {
            read_elements(
                &header.elements,
                Binary::<false>::new(header.body),
                &mut soup,
            )?;
        }
        Encoding::Big => {
            read_elements(
                &header.elements,
                Binary::<true>::new(header.body),
                &mut soup,
            )?;
        }
    }
    soup.finish()
}

fn read_elements(
    elements: &[Element],
    mut values: impl Values,
    soup: &mut Soup,
) -> Result<(), BuildError> {
    for element in elements {
        match element.name.as_str() {
            "vertex" => read_vertices(element, &mut values, soup)?,
            "face" => read_faces(element, &mut values, soup, false)?,
            "tristrips" => read_faces(element, &mut values, soup, true)?,
            // Without properties there is nothing to pass over, however many there are.
            _ if element.properties.is_empty() => {}
            _ => {
                for item in 0..element.count {
                    values.begin(element, item)?;
                    for property in &element.properties {
                        skip(&property.kind, &mut values)?;
                    }
                }
            }
        }
    }
    Ok(())
}

fn read_vertices(
    element: &Element,
    values: &mut impl Values,
    soup: &mut Soup,
) -> Result<(), BuildError> {
    let axes: Vec<usize> = element
        .properties
        .iter()
        .map(|property| match (property.name.as_str(), &property.kind) {
            ("x", Kind::Scalar(_)) => 0,
            ("y", Kind::Scalar(_)) => 1,
            ("z", Kind::Scalar(_)) => 2,
            _ => 3,
        })
        .collect();
    if (0..3).any(|axis| !axes.contains(&axis)) {
        return Err(element.refused("its vertices have no numbers x, y and z"));
    }
    let positions = &mut soup.mesh.positions;
    positions.reserve_exact(values.at_most(element) as usize);
    for item in 0..element.count {
        values.begin(element, item)?;
        let mut position = [0.0; 3];
        for (&axis, property) in axes.iter().zip(&element.properties) {
            match property.kind {
                Kind::Scalar(scalar) if axis < 3 => position[axis] = values.scalar(scalar)?,
                ref kind => skip(kind, values)?,
            }
        }
        positions.push(position);
    }
    Ok(())
}

fn read_faces(
    element: &Element,
    values: &mut impl Values,
    soup: &mut Soup,
    strips: bool,
) -> Result<(), BuildError> {
    let names = ["vertex_indices", "vertex_index"];
    let place = element.properties.iter().position(|property| {
        names.contains(&property.name.as_str()) && matches!(property.kind, Kind::List { .. })
    });
    let Some(place) = place else {
        return Err(element.refused("its faces have no list vertex_indices"));
    };
    if !strips {
        let most = values.at_most(element) as usize;
        soup.mesh.triangles.reserve_exact(most);
    }
    let mut corners = Vec::new();
    for item in 0..element.count {
        values.begin(element, item)?;
        for (k, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::List { count, item } if k == place => {
                    corners.clear();
                    for _ in 0..values.length(count, item)? {
                        corners.push(vertex(values.scalar(item)?));
                    }
                }
                ref kind => skip(kind, values)?,
            }
        }
        if strips {
            corners
                .split(|&corner| corner == u32::MAX)
                .for_each(|strip| push_strip(strip, soup));
        } else {
            soup.push_polygon(&corners);
        }
    }
    Ok(())
}

/// Every other triangle of a strip turns the other way; one without area turns the strip over.
fn push_strip(strip: &[u32], soup: &mut Soup) {
    for (k, corners) in strip.windows(3).enumerate() {
        let [a, b, c] = [corners[0], corners[1], corners[2]];
        if a != b && b != c && c != a {
            let triangle = if k % 2 == 0 { [a, b, c] } else { [b, a, c] };
            soup.mesh.triangles.push(triangle);
        }
    }
}

/// The vertex that a number names; `u32::MAX`, which is beyond every mesh, when none.
fn vertex(number: f64) -> u32 {
    let index = number as u32;
    if f64::from(index) == number {
        index
    } else {
        u32::MAX
    }
}

fn skip(kind: &Kind, values: &mut impl Values) -> Result<(), BuildError> {
    match *kind {
        Kind::Scalar(scalar) => values.scalar(scalar).map(drop),
        Kind::List { count, item } => {
            for _ in 0..values.length(count, item)? {
                values.scalar(item)?;
            }
            Ok(())
        }
    }
}

fn not_ply(reason: &str) -> BuildError {
    BuildError::Format {
        format: "PLY",
        reason: reason.to_string(),
    }
}
