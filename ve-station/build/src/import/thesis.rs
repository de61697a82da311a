//! The thesis's own text formats, refined in full: a CDPM (appendix A) and an SPM (appendix B).
//!
//! | line | CDPM | SPM |
//! |---|---|---|
//! | `#` | the counts, in words; checked where they are there | the same, not read |
//! | `b`, `$` | - | faces and vertices of the base mesh; faces, vertices, splits; the cells follow on lines of numbers |
//! | `v` | x y z | number x y z |
//! | `f` | three vertices | number, three vertices, leaf code |
//! | `v*` | vertex, two differences, signed third vertices of the new faces, `&`, count and faces of the first group, faces of the second | see [`spm_text`] |
//!
//! Everything counts from 1. A split keeps its vertex as the first child (CDPM) or makes two (SPM);
//! a new face with a plus is (first, second, third vertex), with a minus (second, first, third).

mod cdpm;
mod spm_text;

use super::text::{Lines, excerpt, number, words};
use crate::error::BuildError;
use crate::mesh::SoupMesh;

pub(super) fn read(text: &[u8]) -> Result<SoupMesh, BuildError> {
    let first = |(_, content)| words(content).next().map(|word| matches!(word, "b" | "$"));
    // Comments apart, an SPM starts with its counts.
    if Lines::of(text).find_map(first) == Some(true) {
        spm_text::read(text)
    } else {
        cdpm::read(text)
    }
}

/// The words of a line, one after the other; `None` where a number does not stand.
struct Fields<'a, I> {
    words: I,
    line: u64,
    content: &'a [u8],
}

/// The lines of a text that hold something, as the keyword and the fields behind it. A star may
/// stand apart from its `v`.
fn keyword_lines<'a>(
    text: &'a [u8],
) -> impl Iterator<Item = (&'a str, Fields<'a, impl Iterator<Item = &'a str> + Clone>)> {
    Lines::of(text).filter_map(|(line, content)| {
        let mut words = words(content).peekable();
        let mut keyword = words.next()?;
        if keyword == "v" && words.peek() == Some(&"*") {
            words.next();
            keyword = "v*";
        }
        Some((
            keyword,
            Fields {
                words,
                line,
                content,
            },
        ))
    })
}

impl<'a, I: Iterator<Item = &'a str>> Fields<'a, I> {
    fn integer(&mut self) -> Option<i64> {
        self.words.next()?.parse().ok()
    }

    /// A vertex or a face, counted from 1 in the file and from 0 here.
    fn index(&mut self) -> Option<u32> {
        u32::try_from(self.integer()?.checked_sub(1)?).ok()
    }

    fn vector(&mut self) -> Option<[f64; 3]> {
        let mut next = || number(self.words.next()?);
        Some([next()?, next()?, next()?])
    }

    fn bad(&self, what: &str) -> BuildError {
        BuildError::Line {
            line: self.line,
            reason: format!("\"{}\" is {what}: correct it", excerpt(self.content)),
        }
    }
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Refuses a text that does not hold as many as it says.
fn check_count(what: &str, announced: u64, there: usize) -> Result<(), BuildError> {
    if announced == there as u64 {
        return Ok(());
    }
    Err(refused(&format!(
        "it announces {announced} {what} and holds {there}: copy or export it again"
    )))
}

/// What has neither faces nor vertices is no such file.
fn refused(reason: &str) -> BuildError {
    BuildError::Format {
        format: "CDPM or SPM text",
        reason: reason.to_string(),
    }
}
