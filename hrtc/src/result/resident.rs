//! The resident memory of the controller's process.

use serde::{Deserialize, Serialize};

/// Resident memory of a process, bytes; 0 where the kernel does not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ResidentBytes {
    /// The most since its start.
    pub peak: u64,
    /// What is resident now.
    pub parts: ResidentParts,
}

/// Resident memory of a process by what it holds, bytes; 0 where the kernel does not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ResidentParts {
    /// Tables and stacks: the cache, the recording's twin, rings.
    pub anonymous: u64,
    /// The program and its libraries.
    pub file: u64,
    /// Shared with other processes: the link on this machine.
    pub shared: u64,
}

impl ResidentBytes {
    /// After `/proc/PID/status` (proc(5)).
    #[must_use]
    pub fn of(status: &str) -> Self {
        let bytes = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            let words = line.and_then(|line| line.strip_prefix(':'));
            let kib = words.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
            kib.unwrap_or(0) * 1024
        };
        Self {
            peak: bytes("VmHWM"),
            parts: ResidentParts {
                anonymous: bytes("RssAnon"),
                file: bytes("RssFile"),
                shared: bytes("RssShmem"),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_and_its_parts_are_read_and_what_is_not_said_is_zero() {
        let status = "Name:\thrtc\nVmHWM:\t   69432 kB\nVmRSS:\t   60000 kB\nRssAnon:\t   40000 kB\nRssFile:\t   19000 kB\nRssShmem:\t    1000 kB\n";
        let read = ResidentBytes::of(status);
        assert_eq!(read.peak, 69_432 * 1024);
        let ResidentParts {
            anonymous,
            file,
            shared,
        } = read.parts;
        let parts = [40_000, 19_000, 1_000].map(|kib| kib * 1024);
        assert_eq!([anonymous, file, shared], parts);
        assert_eq!(ResidentBytes::of("VmHWM: much\n"), ResidentBytes::default());
    }
}
