//! The header: what elements there are, and of what properties.

use super::super::text::{Lines, excerpt};
use super::not_ply;
use crate::error::BuildError;

/// How the values are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    Little,
    Big,
}

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// Old and new names.
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// One number, or as many as a number before them says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
}

#[derive(Debug)]
pub(super) struct Element {
    pub name: String,
    /// As the header says: not to be believed.
    pub count: u64,
    pub properties: Vec<Property>,
    /// Where it is declared.
    line: u64,
}

impl Element {
    /// The least that one takes in a binary file.
    pub(super) fn least_bytes(&self) -> usize {
        let least = |property: &Property| match property.kind {
            Kind::Scalar(scalar) => scalar.bytes(),
            Kind::List { count, .. } => count.bytes(),
        };
        self.properties.iter().map(least).sum()
    }

    pub(super) fn refused(&self, reason: &str) -> BuildError {
        BuildError::Line {
            line: self.line,
            reason: reason.to_string(),
        }
    }
}

pub(super) struct Header<'a> {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// What follows the header, as text.
    pub lines: Lines<'a>,
    /// What follows the header, as binary.
    pub body: &'a [u8],
}

pub(super) fn read_header(bytes: &[u8]) -> Result<Header<'_>, BuildError> {
    let mut lines = Lines::of(bytes);
    if lines
        .next()
        .is_none_or(|(_, first)| first.trim_ascii() != b"ply")
    {
        return Err(not_ply("it does not start with a line \"ply\""));
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    while let Some((line, content)) = lines.next() {
        let bad = |what: &str| BuildError::Line {
            line,
            reason: format!("\"{}\" is no {what} of a PLY header", excerpt(content)),
        };
        // Latin-1 comments are common: only what is understood must be text.
        let text = String::from_utf8_lossy(content);
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words[..] {
            [] | ["comment" | "obj_info", ..] => {}
            ["format", name, ..] => {
                encoding = Some(match name {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => return Err(bad("format")),
                });
            }
            ["element", name, count] => elements.push(Element {
                // Messages quote it.
                name: excerpt(name.as_bytes()),
                count: count.parse().map_err(|_| bad("element"))?,
                properties: Vec::new(),
                line,
            }),
            ["property", ref rest @ ..] => {
                let (kind, name) = property(rest).ok_or_else(|| bad("property"))?;
                let element = elements.last_mut().ok_or_else(|| bad("property"))?;
                element.properties.push(Property {
                    name: name.to_string(),
                    kind,
                });
            }
            ["end_header"] => {
                return Ok(Header {
                    encoding: encoding.ok_or_else(|| not_ply("its header names no format"))?,
                    elements,
                    body: body(bytes, &lines),
                    lines,
                });
            }
            _ => return Err(bad("line")),
        }
    }
    Err(not_ply("its header does not end"))
}

fn property<'a>(words: &[&'a str]) -> Option<(Kind, &'a str)> {
    match *words {
        ["list", count, item, name] => {
            let count = Scalar::of(count).filter(|c| !matches!(c, Scalar::F32 | Scalar::F64))?;
            let item = Scalar::of(item)?;
            Some((Kind::List { count, item }, name))
        }
        [scalar, name] => Some((Kind::Scalar(Scalar::of(scalar)?), name)),
        _ => None,
    }
}

/// Where lines end in a bare `\r`, a `\n` after the header is the first byte of the values.
fn body<'a>(bytes: &'a [u8], lines: &Lines<'a>) -> &'a [u8] {
    let rest = lines.rest();
    let start = bytes.len() - rest.len();
    let bare = bytes.starts_with(b"ply\r") && !bytes.starts_with(b"ply\r\n");
    if bare && bytes[..start].ends_with(b"\r\n") {
        &bytes[start - 1..]
    } else {
        rest
    }
}
