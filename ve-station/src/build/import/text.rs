//! Lines and words of text formats, whatever the line endings.

/// Lines of a text with `\n`, `\r\n` or `\r` endings, a trailing backslash joining the next line.
/// Gives each with the number (from 1) of its first line.
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
            if end > 0 && self.rest[end - 1] == b'\\' {
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
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &str> {
    let end = line.iter().position(|&b| b == b'#').unwrap_or(line.len());
    line[..end]
        .split(|b| b.is_ascii_whitespace() || *b == b'\\')
        .filter(|word| !word.is_empty())
        .map(|word| std::str::from_utf8(word).unwrap_or("\u{fffd}"))
}

/// A line for a message: short and printable.
pub(super) fn excerpt(line: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(line)
        .chars()
        .take(40)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    text.trim().to_string()
}

/// Three coordinates from words.
pub(super) fn position<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<[f64; 3]> {
    let mut next = || words.next()?.parse::<f64>().ok();
    Some([next()?, next()?, next()?])
}
