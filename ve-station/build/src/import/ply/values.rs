//! The values after the header, one after the other.

use super::super::text::{Lines, excerpt, number};
use super::header::{Element, Scalar};
use super::not_ply;
use crate::error::BuildError;

/// Values as text or binary.
pub(super) trait Values {
    /// Comes to an item of an element.
    fn begin(&mut self, element: &Element, item: u64) -> Result<(), BuildError>;

    /// The next number.
    fn scalar(&mut self, scalar: Scalar) -> Result<f64, BuildError>;

    /// The number of items of a list, which are there if the format can tell.
    fn length(&mut self, count: Scalar, item: Scalar) -> Result<u64, BuildError>;

    /// The most items of an element that there can be, by its count and the length of the file.
    fn at_most(&self, element: &Element) -> u64;
}

/// Where in the file: for messages.
#[derive(Clone, Default)]
struct Place {
    element: String,
    item: u64,
    count: u64,
}

impl Place {
    fn enter(&mut self, element: &Element, item: u64) {
        self.item = item;
        if item == 0 {
            self.element.clone_from(&element.name);
            self.count = element.count;
        }
    }

    fn ends(&self) -> BuildError {
        not_ply(&format!(
            "the file ends within {} {} of {}: copy or export it again",
            self.element,
            self.item + 1,
            self.count
        ))
    }
}

/// Binary values of one byte order.
pub(super) struct Binary<'a, const BIG: bool> {
    rest: &'a [u8],
    place: Place,
}

impl<'a, const BIG: bool> Binary<'a, BIG> {
    pub(super) fn new(body: &'a [u8]) -> Self {
        Self {
            rest: body,
            place: Place::default(),
        }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], BuildError> {
        let Some((&bytes, rest)) = self.rest.split_first_chunk::<N>() else {
            return Err(self.place.ends());
        };
        self.rest = rest;
        let mut bytes = bytes;
        if BIG {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl<const BIG: bool> Values for Binary<'_, BIG> {
    fn begin(&mut self, element: &Element, item: u64) -> Result<(), BuildError> {
        self.place.enter(element, item);
        Ok(())
    }

    fn scalar(&mut self, scalar: Scalar) -> Result<f64, BuildError> {
        Ok(match scalar {
            Scalar::I8 => i8::from_le_bytes(self.take()?).into(),
            Scalar::U8 => u8::from_le_bytes(self.take()?).into(),
            Scalar::I16 => i16::from_le_bytes(self.take()?).into(),
            Scalar::U16 => u16::from_le_bytes(self.take()?).into(),
            Scalar::I32 => i32::from_le_bytes(self.take()?).into(),
            Scalar::U32 => u32::from_le_bytes(self.take()?).into(),
            Scalar::F32 => f32::from_le_bytes(self.take()?).into(),
            Scalar::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    fn length(&mut self, count: Scalar, item: Scalar) -> Result<u64, BuildError> {
        let length = self.scalar(count)?;
        if length < 0.0 || length * item.bytes() as f64 > self.rest.len() as f64 {
            return Err(self.place.ends());
        }
        Ok(length as u64)
    }

    fn at_most(&self, element: &Element) -> u64 {
        let there = self.rest.len() / element.least_bytes().max(1);
        element.count.min(there as u64)
    }
}

/// Values as text: an item a line.
pub(super) struct Text<'a> {
    lines: Lines<'a>,
    line: u64,
    content: &'a [u8],
    rest: &'a [u8],
    place: Place,
}

impl<'a> Text<'a> {
    pub(super) fn new(body: Lines<'a>) -> Self {
        Self {
            lines: body,
            line: 0,
            content: &[],
            rest: &[],
            place: Place::default(),
        }
    }

    fn bad(&self) -> BuildError {
        BuildError::Line {
            line: self.line,
            reason: format!(
                "\"{}\" is no {} as the header declares it: correct it",
                excerpt(self.content),
                self.place.element
            ),
        }
    }
}

impl Values for Text<'_> {
    fn begin(&mut self, element: &Element, item: u64) -> Result<(), BuildError> {
        self.place.enter(element, item);
        loop {
            let (line, content) = self.lines.next().ok_or_else(|| self.place.ends())?;
            let content = content.trim_ascii();
            if !content.is_empty() {
                (self.line, self.content, self.rest) = (line, content, content);
                return Ok(());
            }
        }
    }

    fn scalar(&mut self, _: Scalar) -> Result<f64, BuildError> {
        let rest = self.rest.trim_ascii_start();
        let end = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.rest = rest;
        let word = std::str::from_utf8(word).unwrap_or_default();
        number(word).ok_or_else(|| self.bad())
    }

    fn length(&mut self, count: Scalar, _: Scalar) -> Result<u64, BuildError> {
        let length = self.scalar(count)?;
        // Each item is a character and a space at least.
        if length < 0.0 || length.fract() != 0.0 || length * 2.0 > self.rest.len() as f64 {
            return Err(self.bad());
        }
        Ok(length as u64)
    }

    fn at_most(&self, element: &Element) -> u64 {
        let there = self.lines.rest().len() / (2 * element.properties.len()).max(1);
        element.count.min(there as u64 + 1)
    }
}
