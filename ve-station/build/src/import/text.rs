//! Lines and words of text formats, whatever the line endings.

use crate::error::BuildError;

/// The bytes after a byte order mark.
///
/// # Errors
/// When the mark is that of UTF-16.
pub(super) fn decoded(bytes: &[u8]) -> Result<&[u8], BuildError> {
    match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Err(BuildError::Line {
            line: 1,
            reason: "the text is in UTF-16: save it as UTF-8".to_string(),
        }),
        _ => Ok(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)),
    }
}

/// Lines of a text with `\n`, `\r\n` or `\r` endings, a trailing backslash joining the next line,
/// but for that of a comment: a path may end there.
/// Gives each with the number (from 1) of its first line.
#[derive(Clone)]
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: u64,
}

impl<'a> Lines<'a> {
    pub(super) fn of(text: &'a [u8]) -> Self {
        Self {
            rest: text,
            number: 1,
        }
    }

    /// Whether a part of a line ends in a comment: after a `#`, or of a PLY header.
    fn is_comment(&self, from: usize, end: usize) -> bool {
        let begins = |of: &[u8]| from == 0 && self.rest.starts_with(of);
        self.rest[from..end].contains(&b'#') || begins(b"comment") || begins(b"obj_info")
    }

    /// What the lines so far did not take.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (u64, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let number = self.number;
        let mut at = 0;
        loop {
            let Some(found) = self.rest[at..]
                .iter()
                .position(|b| matches!(b, b'\n' | b'\r'))
            else {
                let line = self.rest;
                self.rest = &[];
                return Some((number, line));
            };
            let end = at + found;
            let after = if self.rest[end..].starts_with(b"\r\n") {
                end + 2
            } else {
                end + 1
            };
            self.number += 1;
            if end > 0 && self.rest[end - 1] == b'\\' && !self.is_comment(at, end) {
                at = after;
                continue;
            }
            let line = &self.rest[..end];
            self.rest = &self.rest[after..];
            return Some((number, line));
        }
    }
}

/// Words of a line up to a `#`; a joining backslash counts as a space.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &str> + Clone {
    let end = line.iter().position(|&b| b == b'#').unwrap_or(line.len());
    line[..end]
        .split(|b| b.is_ascii_whitespace() || *b == b'\\')
        .filter(|word| !word.is_empty())
        .map(|word| std::str::from_utf8(word).unwrap_or("\u{fffd}"))
}

/// A line for a message: short and printable.
pub(super) fn excerpt(line: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(&line[..line.len().min(200)])
        .chars()
        .take(40)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    text.trim().to_string()
}

/// A number in a text. What printers write for "not a number" is one too: `nan`, `-nan(ind)`,
/// `1.#QNAN`.
pub(super) fn number(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| {
        let unsigned = word.trim_start_matches(['-', '+']);
        let starts = |with: &str| {
            let start = unsigned.get(..with.len());
            start.is_some_and(|start| start.eq_ignore_ascii_case(with))
        };
        (starts("nan") || starts("1.#")).then_some(f64::NAN)
    })
}

/// Three coordinates from words.
pub(super) fn position<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<[f64; 3]> {
    let mut next = || number(words.next()?);
    Some([next()?, next()?, next()?])
}

/// An index that counts from 0; what names no vertex is `u32::MAX`.
pub(super) fn index(word: &str) -> Option<u32> {
    let number: i64 = word.parse().ok()?;
    Some(u32::try_from(number).unwrap_or(u32::MAX))
}
