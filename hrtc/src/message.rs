//! Sentences for the user on standard error.

/// Says a sentence. Nobody may be left to read it, which is no reason to end, nor to wait:
/// `eprintln` would panic or hang.
macro_rules! note {
    ($($text:tt)*) => {
        transport::logging::line(format_args!("hrtc: {}", format_args!($($text)*)))
    };
}
pub(crate) use note;
