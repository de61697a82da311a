//! What a jitter run means: pass, fail, or that this machine cannot tell.

use super::side::Side;
use serde::Serialize;

/// A loop without a controller misses more than this share: nothing can be said of the controller.
const LOOP_MISSED: f64 = 0.01;
/// The bare loop itself wakes up later than this, microseconds.
const BARE_WAKE_US: f64 = 250.0;
/// Wake-up of the controller over the bare loop's: medians over pairs of equal loops spread up to
/// 1.5 at the median and 2.0 at 99 %, so above this it is the controller.
const WAKE_RATIO: f64 = 2.0;
/// A share of missed periods of the controller is not more than the reference loop's up to this
/// factor: stalls of the machine hit blocks at random.
const MISSED_RATIO: f64 = 2.0;

/// The verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Nothing that is the controller's own went wrong.
    Pass,
    /// Something did.
    Fail,
    /// The loops without a controller do too badly here to tell; not a pass.
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

/// Work of a kind beside its budget.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Worst {
    /// Of the worst tick.
    pub max: u64,
    /// What a tick may take.
    pub budget: u64,
}

/// What is judged.
#[derive(Debug, Clone, Copy)]
pub struct Numbers<'a> {
    /// The controller.
    pub ours: &'a Side,
    /// The empty loop.
    pub bare: &'a Side,
    /// The loop of equal fixed arithmetic.
    pub reference: &'a Side,
    /// Work units.
    pub operations: Worst,
    /// Nodes and faces of the queries.
    pub queries: Worst,
    /// Least share of ticks in contact of a block.
    pub contact_share: f64,
    /// Figures of which a value was not finite.
    pub non_finite: &'a [String],
    /// Median over the pairs, wake-up p50 and p99 of ours over bare.
    pub wake_ratio: [f64; 2],
}

/// Judges; the reasons are a sentence each.
#[must_use]
pub fn judge(n: &Numbers<'_>) -> (Verdict, Vec<String>) {
    // What holds on any machine comes first: no noise excuses it.
    let hard = hard(n);
    if !hard.is_empty() {
        return (Verdict::Fail, hard);
    }
    let unclear = unclear(n);
    if !unclear.is_empty() {
        return (Verdict::Inconclusive, unclear);
    }
    let compared = compared(n);
    if !compared.is_empty() {
        return (Verdict::Fail, compared);
    }
    let good = "every tick on time or its miss the machine's, its work within the budgets, its force finite; no \
                page fault, allocation, drift or switch of the tick's own; wake-ups as the bare loop's";
    (Verdict::Pass, vec![good.to_string(), machines(n)])
}

/// What is the controller's own fault, whatever the machine.
fn hard(n: &Numbers<'_>) -> Vec<String> {
    let ours = n.ours;
    let mut hard = Vec::new();
    if !n.non_finite.is_empty() {
        hard.push(format!("not finite: {}", n.non_finite.join(", ")));
    }
    if n.contact_share <= 0.0 {
        hard.push("nothing was touched in a block, so its ticks had little to do".to_string());
    }
    if ours.missed_own_cpu > 0 && !is_the_machines_clock(n) {
        hard.push(format!(
            "{} period(s) missed by our own work or waiting",
            ours.missed_own_cpu
        ));
    }
    for (count, what) in [
        (ours.page_faults, "page fault(s) within ticks"),
        (ours.allocations, "allocation(s) within ticks"),
        (
            ours.extra_switches,
            "voluntary context switch(es) of the tick's thread beside its waits for the timer",
        ),
        (ours.drift_ns_max, "ns of drift from t0 + k T"),
        (
            ours.unaccounted_periods,
            "period(s) that were neither run nor counted as skipped",
        ),
    ] {
        if count > 0 {
            hard.push(format!("{count} {what}"));
        }
    }
    for (worst, what) in [
        (n.operations, "work units"),
        (n.queries, "nodes and faces of its queries"),
    ] {
        if worst.max > worst.budget {
            hard.push(format!(
                "a tick of {} {what} exceeds the budget of {}",
                worst.max, worst.budget
            ));
        }
    }
    hard
}

/// Whether the reference loop, whose work is fixed, has misses by its own processor time as well
/// and as often: the processor time of this machine has time of others in it.
fn is_the_machines_clock(n: &Numbers<'_>) -> bool {
    let own_waits = n.ours.misses.own_wait;
    own_waits == 0 && n.ours.own_share() <= MISSED_RATIO * n.reference.own_share()
}

/// Why this machine cannot tell.
fn unclear(n: &Numbers<'_>) -> Vec<String> {
    let mut unclear = Vec::new();
    for (side, name) in [(n.bare, "bare"), (n.reference, "reference")] {
        let share = side.missed_share();
        // A loop without a tick has no share.
        if share.is_nan() || share > LOOP_MISSED {
            unclear.push(format!(
                "the {name} loop itself misses {:.2} % of its periods here",
                100.0 * share
            ));
        }
    }
    if n.bare.wake_us.p99 > BARE_WAKE_US {
        unclear.push(format!(
            "the bare loop itself wakes up {:.0} µs late at p99 here",
            n.bare.wake_us.p99
        ));
    }
    if n.ours.missed_own_cpu > 0 {
        unclear.push(format!(
            "{} period(s) missed by our own processor time, but {} by the reference loop's too, whose work is fixed: \
             the processor time of this machine has time of others in it",
            n.ours.missed_own_cpu, n.reference.missed_own_cpu
        ));
    }
    unclear
}

/// What is worse than with the loops beside it.
fn compared(n: &Numbers<'_>) -> Vec<String> {
    let mut compared = Vec::new();
    for (name, ratio) in ["p50", "p99"].into_iter().zip(n.wake_ratio) {
        if ratio > WAKE_RATIO {
            compared.push(format!(
                "the controller's wake-up {name} is {ratio:.2} times the bare loop's, above {WAKE_RATIO}"
            ));
        }
    }
    let (ours, reference) = (n.ours.missed_share(), n.reference.missed_share());
    // A few more misses than the reference loop's mean nothing.
    if ours.is_nan() || ours > MISSED_RATIO * reference + LOOP_MISSED {
        compared.push(format!(
            "the controller misses {:.2} % of its periods, the reference loop of equal work {:.2} %",
            100.0 * ours,
            100.0 * reference
        ));
    }
    compared
}

/// What is the machine's, in a sentence.
#[must_use]
pub fn machines(n: &Numbers<'_>) -> String {
    let others = n.ours.missed - n.ours.missed_own_cpu;
    format!(
        "the machine's: {others} of our {} missed periods ({:.3} % of all), beside {:.3} % of the reference loop's; \
         the longest work of the reference loop, {:.0} µs of processor time, beside ours of {:.0} µs",
        n.ours.missed,
        100.0 * n.ours.missed_share(),
        100.0 * n.reference.missed_share(),
        n.reference.work_cpu_us.max,
        n.ours.work_cpu_us.max
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrtc::result::Misses;

    fn side(missed: u64, wake_p99: f64) -> Side {
        let mut side = Side {
            ticks: 100_000 - missed,
            missed,
            ..Side::default()
        };
        side.wake_us.p99 = wake_p99;
        side
    }

    /// The verdict of a good run that `change` makes worse, and its reasons.
    fn with(change: impl FnOnce(&mut [Side; 3], &mut Numbers<'_>)) -> (Verdict, Vec<String>) {
        let mut sides = [side(100, 50.0), side(100, 40.0), side(100, 45.0)];
        let none = Side::default();
        let mut numbers = Numbers {
            ours: &none,
            bare: &none,
            reference: &none,
            operations: Worst {
                max: 30,
                budget: 30,
            },
            queries: Worst { max: 9, budget: 9 },
            contact_share: 0.5,
            non_finite: &[],
            wake_ratio: [1.1, 1.3],
        };
        change(&mut sides, &mut numbers);
        let [ours, bare, reference] = &sides;
        judge(&Numbers {
            ours,
            bare,
            reference,
            ..numbers
        })
    }

    #[test]
    fn each_rule_alone_decides() {
        let (verdict, reasons) = with(|_, _| {});
        assert_eq!(verdict, Verdict::Pass);
        assert!(
            reasons[1].contains("the machine's: 100 of our 100"),
            "{reasons:?}"
        );
        type Change = fn(&mut [Side; 3], &mut Numbers<'_>);
        let changes: [(Change, &str); 14] = [
            (|s, _| s[0].missed_own_cpu = 1, "our own work"),
            (|s, _| s[0].page_faults = 1, "page fault"),
            (|s, _| s[0].allocations = 1, "allocation"),
            (|s, _| s[0].extra_switches = 1, "voluntary context switch"),
            (|s, _| s[0].drift_ns_max = 1, "drift"),
            (
                |s, _| s[0].unaccounted_periods = 1,
                "neither run nor counted",
            ),
            (|_, n| n.operations.max = 31, "31 work units"),
            (|_, n| n.queries.max = 10, "10 nodes and faces"),
            (|_, n| n.contact_share = 0.0, "nothing was touched"),
            (|_, n| n.wake_ratio[0] = 2.1, "wake-up p50"),
            (|_, n| n.wake_ratio[1] = 2.1, "wake-up p99"),
            (|s, _| s[0].missed = 1300, "the controller misses"),
            (
                |s, _| {
                    s[0] = Side {
                        missed: 0,
                        ticks: 0,
                        ..s[0].clone()
                    }
                },
                "misses NaN %",
            ),
            (
                |_, n| n.non_finite = std::slice::from_ref(Box::leak(Box::new("force_n".into()))),
                "not finite: force_n",
            ),
        ];
        for (change, word) in changes {
            let (verdict, reasons) = with(change);
            assert_eq!(verdict, Verdict::Fail, "{word}");
            assert!(
                reasons.len() == 1 && reasons[0].contains(word),
                "{word}: {reasons:?}"
            );
        }
    }

    #[test]
    fn loops_without_a_controller_that_do_badly_leave_it_open() {
        type Change = fn(&mut [Side; 3], &mut Numbers<'_>);
        let changes: [(Change, &str); 5] = [
            (
                |s, _| s[1] = side(1100, 40.0),
                "the bare loop itself misses",
            ),
            (
                |s, _| s[2] = side(1100, 45.0),
                "the reference loop itself misses",
            ),
            (|s, _| s[1] = side(0, 251.0), "wakes up 251 µs late"),
            (|s, _| s[1].ticks = 0, "the bare loop itself misses 100"),
            (
                |s, n| {
                    s[1].wake_us.p99 = 251.0;
                    n.wake_ratio[1] = 9.0;
                },
                "wakes up",
            ),
        ];
        for (change, word) in changes {
            let (verdict, reasons) = with(change);
            assert_eq!(verdict, Verdict::Inconclusive, "{word}");
            assert!(reasons[0].contains(word), "{word}: {reasons:?}");
        }
        // A bad machine does not excuse our own faults.
        let (verdict, _) = with(|s, _| {
            s[1] = side(50_000, 40.0);
            s[0].allocations = 1;
        });
        assert_eq!(verdict, Verdict::Fail);
    }

    #[test]
    fn own_misses_are_open_where_fixed_work_has_them_as_often_and_ours_otherwise() {
        let own = |ours: u64, waits: u64, reference: u64| {
            with(|s, _| {
                s[0].missed_own_cpu = ours;
                s[0].misses = Misses {
                    own_cpu: ours - waits,
                    own_wait: waits,
                    ..Misses::default()
                };
                s[2].missed_own_cpu = reference;
            })
            .0
        };
        assert_eq!(own(2, 0, 1), Verdict::Inconclusive);
        assert_eq!(own(3, 0, 1), Verdict::Fail);
        assert_eq!(
            own(2, 1, 1),
            Verdict::Fail,
            "nobody else waits for our locks"
        );
        assert_eq!(own(0, 0, 5), Verdict::Pass);
    }
}
