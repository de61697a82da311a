//! What the process of a tunnel tells its owner: a word a line on its standard output.

use std::fmt;

/// A word.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Word {
    /// It carries topics from now on.
    Ready,
    /// A sentence for the user.
    Note(String),
    /// Why it ends.
    Failed(String),
}

impl Word {
    /// Reads a line; `None` of what is no word.
    #[must_use]
    pub fn read(line: &str) -> Option<Self> {
        match line.split_once(' ') {
            None if line == "ready" => Some(Self::Ready),
            Some(("note", sentence)) => Some(Self::Note(sentence.to_owned())),
            Some(("failed", sentence)) => Some(Self::Failed(sentence.to_owned())),
            _ => None,
        }
    }
}

/// One line, whatever the sentence holds.
impl fmt::Display for Word {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (word, sentence) = match self {
            Self::Ready => return f.write_str("ready"),
            Self::Note(sentence) => ("note", sentence),
            Self::Failed(sentence) => ("failed", sentence),
        };
        write!(f, "{word} {}", sentence.replace(['\n', '\r'], " "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_as_they_were_written() {
        for word in [
            Word::Ready,
            Word::Note("a b".to_owned()),
            Word::Failed(String::new()),
        ] {
            assert_eq!(Word::read(&word.to_string()), Some(word));
        }
        let two = Word::Note("two\nlines".to_owned()).to_string();
        assert_eq!(Word::read(&two), Some(Word::Note("two lines".to_owned())));
        assert_eq!(Word::read("hello"), None);
    }
}
