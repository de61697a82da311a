//! The result for a person.

use super::{JitterResult, Tail};
use crate::machine::right_words;
use crate::report::table::Table;
use hrtc::result::Right;
use std::fmt::Write as _;
use std::path::Path;

/// The result in words.
pub(super) fn words(result: &JitterResult, rights: &[Right], picture: &Path) -> String {
    let machine = &result.machine;
    let mut text = format!(
        "machine     {}; kernel {} ({}); load {}\nloop        {} Hz; {}\n",
        machine.processor,
        machine.kernel,
        machine.preemption,
        result.load,
        result.rate_hz,
        spun(result)
    );
    for right in rights {
        let _ = writeln!(text, "right       {}", right_words(right));
    }
    let _ = writeln!(text, "\n{}", table(result));
    for (name, side) in result.loops() {
        let m = &side.misses;
        let _ = writeln!(
            text,
            "{name:<11} {} ticks, {} missed: {} own work, {} own wait, {} run queue, {} late timer, {} stopped, {} stolen, {} unexplained; {} page faults, {} allocations, {} switches beside the timer, {} ns drift, {} periods unaccounted, {} ticks of steal",
            side.ticks,
            side.missed,
            m.own_cpu,
            m.own_wait,
            m.run_queue,
            m.late_timer,
            m.stopped,
            m.stolen,
            m.unexplained,
            side.page_faults,
            side.allocations,
            side.extra_switches,
            side.drift_ns_max,
            side.unaccounted_periods,
            side.steal_ticks
        );
    }
    let _ = write!(
        text,
        "\nover {} pairs of blocks, medians: wake-up p50 {:.2} and p99 {:.2} of the bare loop's; p99.9 of the work {:.2} of the reference loop's\nworst tick  {} work units of a budget of {}; {} nodes and faces of queries of {}\ntouch       {} ticks in contact, {:.0} % of the block with the least\npicture     {}\nverdict     {}: {}\n",
        result.pairs,
        result.wake_ratio.p50,
        result.wake_ratio.p99,
        result.work_tail_ratio,
        result.operations_max,
        result.operations_budget,
        result.query_work_max,
        result.query_work_budget,
        result.contact_ticks,
        100.0 * result.contact_share,
        picture.display(),
        result.verdict.name(),
        result.reasons.join("; ")
    );
    text
}

/// How the loops wait, and what spinning costs.
fn spun(result: &JitterResult) -> String {
    if result.spin_us == 0 {
        return "the whole wait is slept".to_string();
    }
    let share = 1e-4 * result.ours.spun_us_mean * result.rate_hz;
    format!(
        "the last {} µs of a wait are spun: {:.1} µs a tick on average, {share:.1} % of the core",
        result.spin_us, result.ours.spun_us_mean
    )
}

/// Each time of all loops side by side.
fn table(result: &JitterResult) -> Table {
    let mut table = Table::new(2, "µs | loop | p50 | p99 | p99.9 | p99.99 | max");
    for what in ["wake-up", "work, thread CPU", "work, wall", "period"] {
        for (name, side) in result.loops() {
            let Tail {
                p50,
                p99,
                p999,
                p9999,
                max,
            } = match what {
                "wake-up" => side.wake_us,
                "work, thread CPU" => side.work_cpu_us,
                "work, wall" => side.work_wall_us,
                _ => side.period_us,
            };
            let numbers = [p50, p99, p999, p9999, max].map(|us| format!("{us:.1}"));
            table.row([what, name].map(String::from).into_iter().chain(numbers));
        }
    }
    table
}
