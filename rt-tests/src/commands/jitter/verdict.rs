//! What a jitter run means: pass, fail, or that this machine cannot tell.

use serde::Serialize;

/// The bare loop itself misses more than this share: nothing can be said of the controller.
const BARE_MISSED: f64 = 0.01;
/// The bare loop itself wakes up later than this, microseconds.
const BARE_WAKE_US: f64 = 250.0;
/// Wake-up of the controller over the bare loop's: medians over pairs of equal loops spread up to
/// 1.5 at the median and 2.0 at 99 %, so above this it is the controller.
const WAKE_RATIO: f64 = 2.0;

/// The verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Nothing that is the controller's own went wrong.
    Pass,
    /// Something did.
    Fail,
    /// The bare loop does too badly here to tell; not a pass.
    Inconclusive,
}

impl Verdict {
    /// As in the JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::Inconclusive => "inconclusive",
        }
    }
}

/// What is judged.
#[derive(Debug, Clone, Copy, Default)]
pub struct Numbers {
    /// Periods missed because a tick's own processor time exceeded the period.
    pub own_cpu_misses: u64,
    /// Page faults within our ticks.
    pub page_faults: u64,
    /// Allocations and frees within our ticks.
    pub allocations: u64,
    /// Work units of our worst tick.
    pub operations_max: u64,
    /// Work units that a tick may spend; 0 when there is no budget.
    pub operations_budget: u64,
    /// Share of periods that we missed, any reason.
    pub ours_missed: f64,
    /// Share of periods that the bare loop missed.
    pub bare_missed: f64,
    /// Wake-up of the bare loop at 99 %, microseconds.
    pub bare_wake_p99_us: f64,
    /// Median over the pairs, ours over bare.
    pub wake_ratio_p50: f64,
    /// Median over the pairs, ours over bare.
    pub wake_ratio_p99: f64,
}

/// Judges; the reasons are a sentence each.
#[must_use]
pub fn judge(n: &Numbers) -> (Verdict, Vec<String>) {
    // What holds on any machine comes first: no noise excuses it.
    let mut hard = Vec::new();
    if n.own_cpu_misses > 0 {
        hard.push(format!(
            "{} period(s) missed by our own work",
            n.own_cpu_misses
        ));
    }
    if n.page_faults > 0 {
        hard.push(format!("{} page fault(s) within ticks", n.page_faults));
    }
    if n.allocations > 0 {
        hard.push(format!("{} allocation(s) within ticks", n.allocations));
    }
    if n.operations_budget > 0 && n.operations_max > n.operations_budget {
        hard.push(format!(
            "a tick of {} work units exceeds the budget of {}",
            n.operations_max, n.operations_budget
        ));
    }
    if !hard.is_empty() {
        return (Verdict::Fail, hard);
    }
    let mut unclear = Vec::new();
    if n.bare_missed > BARE_MISSED {
        unclear.push(format!(
            "the bare loop itself misses {:.2} % of its periods here",
            100.0 * n.bare_missed
        ));
    }
    if n.bare_wake_p99_us > BARE_WAKE_US {
        unclear.push(format!(
            "the bare loop itself wakes up {:.0} µs late at p99 here",
            n.bare_wake_p99_us
        ));
    }
    if !unclear.is_empty() {
        return (Verdict::Inconclusive, unclear);
    }
    let mut compared = Vec::new();
    for (name, ratio) in [("p50", n.wake_ratio_p50), ("p99", n.wake_ratio_p99)] {
        if ratio > WAKE_RATIO {
            compared.push(format!(
                "the controller's wake-up {name} is {ratio:.2} times the bare loop's, above {WAKE_RATIO}"
            ));
        }
    }
    // Stalls of the machine hit blocks at random, so a few more misses than the bare loop's mean
    // nothing.
    if n.ours_missed > 2.0 * n.bare_missed + BARE_MISSED {
        compared.push(format!(
            "the controller misses {:.2} % of its periods, the bare loop {:.2} %",
            100.0 * n.ours_missed,
            100.0 * n.bare_missed
        ));
    }
    if compared.is_empty() {
        let reason = "no period missed by our own work, no page fault, no allocation, wake-ups as the bare loop's";
        (Verdict::Pass, vec![reason.to_string()])
    } else {
        (Verdict::Fail, compared)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Numbers = Numbers {
        own_cpu_misses: 0,
        page_faults: 0,
        allocations: 0,
        operations_max: 30,
        operations_budget: 30,
        ours_missed: 0.001,
        bare_missed: 0.001,
        bare_wake_p99_us: 40.0,
        wake_ratio_p50: 1.1,
        wake_ratio_p99: 1.3,
    };

    #[test]
    fn each_rule_alone_decides() {
        assert_eq!(judge(&GOOD).0, Verdict::Pass);
        for bad in [
            Numbers {
                own_cpu_misses: 1,
                ..GOOD
            },
            Numbers {
                page_faults: 1,
                ..GOOD
            },
            Numbers {
                allocations: 1,
                ..GOOD
            },
            Numbers {
                operations_max: 31,
                ..GOOD
            },
            Numbers {
                wake_ratio_p50: 2.1,
                ..GOOD
            },
            Numbers {
                wake_ratio_p99: 2.1,
                ..GOOD
            },
            Numbers {
                ours_missed: 0.013,
                ..GOOD
            },
        ] {
            let (verdict, reasons) = judge(&bad);
            assert_eq!(verdict, Verdict::Fail, "{bad:?}");
            assert_eq!(reasons.len(), 1);
        }
        for unclear in [
            Numbers {
                bare_missed: 0.011,
                ..GOOD
            },
            Numbers {
                bare_wake_p99_us: 251.0,
                ..GOOD
            },
            Numbers {
                bare_wake_p99_us: 251.0,
                wake_ratio_p99: 9.0,
                ..GOOD
            },
        ] {
            assert_eq!(judge(&unclear).0, Verdict::Inconclusive, "{unclear:?}");
        }
    }

    #[test]
    fn a_bad_machine_does_not_excuse_our_own_faults() {
        let both = Numbers {
            bare_missed: 0.5,
            allocations: 1,
            ..GOOD
        };
        assert_eq!(judge(&both).0, Verdict::Fail);
    }
}
