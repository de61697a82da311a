//! What the measurements were made on, read from `/proc` and `/sys`.

use hrtc::result::Right;
use std::fs::read_to_string;

/// The machine, in words.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Machine {
    /// Processor and count of cores.
    pub processor: String,
    /// Kernel release.
    pub kernel: String,
    /// Preemption model as the kernel states it.
    pub preemption: String,
}

impl Machine {
    /// Reads what the kernel tells; what it does not is said as "unknown".
    #[must_use]
    pub fn read() -> Self {
        let file = |path: &str| read_to_string(path).unwrap_or_default();
        let info = file("/proc/cpuinfo");
        let model = info
            .lines()
            .find_map(|line| line.strip_prefix("model name")?.split_once(':'))
            .map_or("unknown processor", |(_, name)| name.trim());
        let release = file("/proc/sys/kernel/osrelease");
        let version = file("/proc/version");
        let realtime = file("/sys/kernel/realtime").trim() == "1";
        // Only with debugfs mounted and readable: "none voluntary (full) lazy".
        let dynamic = file("/sys/kernel/debug/sched/preempt");
        let chosen = dynamic
            .split_whitespace()
            .find_map(|word| word.strip_prefix('(')?.strip_suffix(')'));
        let built = ["PREEMPT_RT", "PREEMPT_DYNAMIC", "PREEMPT"]
            .into_iter()
            .find(|word| version.contains(word))
            .unwrap_or("no preemption named");
        let preemption = match (realtime, chosen) {
            (true, _) => "PREEMPT_RT".to_string(),
            (false, Some(chosen)) => format!("{built} running as {chosen}"),
            (false, None) => built.to_string(),
        };
        Self {
            processor: format!("{model}, {} core(s)", cores()),
            kernel: match release.trim() {
                "" => "unknown".to_string(),
                release => release.to_string(),
            },
            preemption,
        }
    }
}

/// A right of the controller's process in words: obtained or not, and why.
#[must_use]
pub fn right_words(right: &Right) -> String {
    let state = if right.obtained {
        "obtained"
    } else {
        "NOT obtained"
    };
    if right.detail.is_empty() {
        format!("{}: {state}", right.name)
    } else {
        format!("{}: {state} ({})", right.name, right.detail)
    }
}

/// Cores that this process may use.
#[must_use]
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Processor time that the hypervisor took from a core so far (from all cores for `None`), in the
/// kernel's ticks of 10 ms. It misses some: no steal does not prove our fault.
#[must_use]
pub fn steal_ticks(core: Option<usize>) -> u64 {
    steal_of(&read_to_string("/proc/stat").unwrap_or_default(), core)
}

fn steal_of(stat: &str, core: Option<usize>) -> u64 {
    let name = core.map_or("cpu".to_string(), |core| format!("cpu{core}"));
    stat.lines()
        .map(str::split_whitespace)
        .find_map(|mut fields| (fields.next()? == name).then(|| fields.nth(7))?)
        .and_then(|steal| steal.parse().ok())
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steal_is_the_eighth_number_of_the_cores_line() {
        let stat =
            "cpu  1 2 3 4 5 6 7 80 9 10\ncpu0 1 2 3 4 5 6 7 8 9 10\ncpu1 1 2 3 4 5 6 7 72 9 0\n";
        assert_eq!(steal_of(stat, Some(1)), 72);
        assert_eq!(steal_of(stat, None), 80);
        assert_eq!(steal_of(stat, Some(12)), 0);
        assert_eq!(steal_of("", Some(0)), 0);
    }
}
