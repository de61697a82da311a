//! Notes on standard error: warnings, or up to the level that the variable HRTC_LOG names (off,
//! error, warn, info, debug, trace).

use std::io::IsTerminal;
use tracing_subscriber::filter::LevelFilter;

/// Starts the notes; called once, from `main`.
pub fn start() {
    let asked = std::env::var("HRTC_LOG").ok();
    let level = asked.and_then(|level| level.parse().ok());
    tracing_subscriber::fmt()
        .with_max_level(level.unwrap_or(LevelFilter::WARN))
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .init();
}
