//! Notes on standard error: warnings, or what the variable HRTC_LOG asks for.

use std::io::IsTerminal;
use tracing_subscriber::EnvFilter;

/// Starts them; once, from `main`.
pub fn start() {
    let filter = EnvFilter::try_from_env("HRTC_LOG").unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .init();
}
