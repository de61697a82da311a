//! Sentences for the user on standard error.

/// Prints a sentence. Nobody may be left to read it, which is no reason to end: `eprintln` would
/// panic.
macro_rules! note {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), "hrtc: {}", format_args!($($text)*));
    }};
}
pub(crate) use note;
