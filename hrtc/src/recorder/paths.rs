//! Paths as text: what a recording holds is UTF-8, a path need not be.

use std::ffi::OsString;
use std::fmt::Write;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

/// Before the two hexadecimal digits of a byte: no path of a file has a zero byte.
const MARK: char = '\0';

/// Text that gives the path again by [`from_text`]: the path itself where it is UTF-8, and each
/// other byte (or zero byte) by its digits.
pub(super) fn to_text(path: &Path) -> String {
    let mut text = String::new();
    for part in path.as_os_str().as_bytes().utf8_chunks() {
        text.push_str(&part.valid().replace(MARK, "\u{0}00"));
        for byte in part.invalid() {
            // A string takes all that is written.
            let _ = write!(text, "{MARK}{byte:02x}");
        }
    }
    text
}

/// The path of a text; what [`to_text`] does not give is some path.
pub(super) fn from_text(text: &str) -> PathBuf {
    let mut parts = text.split(MARK);
    let mut bytes = parts.next().unwrap_or_default().as_bytes().to_vec();
    for part in parts {
        let (digits, rest) = part.split_at_checked(2).unwrap_or((part, ""));
        bytes.extend(u8::from_str_radix(digits, 16).ok());
        bytes.extend_from_slice(rest.as_bytes());
    }
    OsString::from_vec(bytes).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;

    #[test]
    fn every_path_is_read_again_and_one_that_is_utf_8_is_its_own_text() {
        for text in ["", "/home/jörg/touch.toml", "a\u{fffd}\\xff%ff 0ff"] {
            assert_eq!(to_text(Path::new(text)), text);
            assert_eq!(from_text(text), Path::new(text));
        }
        let latin = Path::new(OsStr::from_bytes(b"/home/j\xf6rg/t.toml"));
        assert_eq!(to_text(latin), "/home/j\0f6rg/t.toml");
        for first in 0..=u8::MAX {
            for second in 0..=u8::MAX {
                let bytes = [b'a', first, second, b'7', first];
                let path = Path::new(OsStr::from_bytes(&bytes));
                assert_eq!(from_text(&to_text(path)), path, "{bytes:?}");
            }
        }
    }

    #[test]
    fn a_text_that_was_changed_is_some_path() {
        for text in ["\0", "a\0f", "a\0zz/b", "\0ä\0", "\0\0ff"] {
            let _ = from_text(text);
        }
    }
}
