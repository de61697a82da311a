//! PLY, text or binary of either byte order, through `ply-rs-bw`.

use super::{BuildError, SoupMesh};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

/// The position of a `vertex`; other properties are passed over.
struct Vertex([f64; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([0.0; 3])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Set,
        };
        self.0[axis] = match property {
            Property::Char(v) => v.into(),
            Property::UChar(v) => v.into(),
            Property::Short(v) => v.into(),
            Property::UShort(v) => v.into(),
            Property::Int(v) => v.into(),
            Property::UInt(v) => v.into(),
            Property::Float(v) => v.into(),
            Property::Double(v) => v,
            _ => f64::NAN,
        };
        PropertyAccessResult::Set
    }
}

/// The corners of a `face`; other properties are passed over.
struct Polygon(Vec<u32>);

impl PropertyAccess for Polygon {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if name == "vertex_indices" || name == "vertex_index" {
            self.0 = match property {
                Property::ListChar(v) => indices(v),
                Property::ListUChar(v) => indices(v),
                Property::ListShort(v) => indices(v),
                Property::ListUShort(v) => indices(v),
                Property::ListInt(v) => indices(v),
                Property::ListUInt(v) => v,
                // Indices as fractions, or no list: a face that names no vertex.
                _ => vec![u32::MAX; 3],
            };
        }
        PropertyAccessResult::Set
    }
}

fn indices<T: TryInto<u32>>(list: Vec<T>) -> Vec<u32> {
    list.into_iter()
        .map(|index| index.try_into().unwrap_or(u32::MAX))
        .collect()
}

/// Any other element: read to get past it.
struct Ignored;

impl PropertyAccess for Ignored {
    fn new() -> Self {
        Self
    }

    fn set_property(&mut self, _: &str, _: Property) -> PropertyAccessResult {
        PropertyAccessResult::Set
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<SoupMesh, BuildError> {
    let mut reader = Reader::new(bytes);
    let vertices = Parser::<Vertex>::new();
    let polygons = Parser::<Polygon>::new();
    let header = vertices.read_header(&mut reader).map_err(refused)?;
    let mut mesh = SoupMesh::default();
    for (_, element) in &header.elements {
        match element.name.as_str() {
            "vertex" => {
                if ["x", "y", "z"]
                    .iter()
                    .any(|&p| !element.properties.contains_key(p))
                {
                    return Err(not_ply("its vertices have no x, y and z"));
                }
                mesh.positions = vertices
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(refused)?
                    .into_iter()
                    .map(|v| v.0)
                    .collect();
            }
            "face" => {
                for polygon in polygons
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(refused)?
                {
                    mesh.push_polygon(&polygon.0);
                }
            }
            _ => {
                Parser::<Ignored>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(refused)?;
            }
        }
    }
    Ok(mesh)
}

fn not_ply(reason: &str) -> BuildError {
    BuildError::Format {
        format: "PLY",
        reason: reason.to_string(),
    }
}

/// The parser's words on one line.
fn refused(error: ply_rs_bw::parser::ParseError) -> BuildError {
    let text = error.to_string();
    let words: Vec<&str> = text.split_whitespace().collect();
    not_ply(words.join(" ").trim_end_matches('.'))
}
