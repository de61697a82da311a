//! Where a build says how far it is.

use indicatif::{ProgressBar, ProgressStyle};

/// Told what is being done; `&self`, so that one can be shared.
pub trait Progress {
    /// A new phase with this many steps; 0 when unknown.
    fn phase(&self, name: &'static str, steps: u64);
    /// Steps of the phase that are done.
    fn done(&self, steps: u64);
}

/// Says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn phase(&self, _: &'static str, _: u64) {}
    fn done(&self, _: u64) {}
}

/// A bar on standard error; silent when that is no terminal.
#[derive(Debug)]
pub struct TerminalProgress(ProgressBar);

impl TerminalProgress {
    /// A bar that waits for its first phase.
    #[must_use]
    pub fn new() -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) =
            ProgressStyle::with_template("{msg:24} [{bar:40}] {pos}/{len} {elapsed_precise}")
        {
            bar.set_style(style.progress_chars("=> "));
        }
        Self(bar)
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}

impl Default for TerminalProgress {
    fn default() -> Self {
        Self::new()
    }
}

impl Progress for TerminalProgress {
    fn phase(&self, name: &'static str, steps: u64) {
        self.0.set_message(name);
        self.0.set_length(steps);
        self.0.set_position(0);
        self.0.tick();
    }

    fn done(&self, steps: u64) {
        self.0.set_position(steps);
    }
}
