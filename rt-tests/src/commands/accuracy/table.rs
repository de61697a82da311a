//! The result as text: for the terminal, and as CSV.

use super::result::{Accuracy, Bytes, Knob, Point};
use crate::report::table::Table;
use crate::report::units::{bytes, digits, grouped, length};
use std::fmt::Write as _;

/// What was asked for, in words.
#[must_use]
pub fn asked(point: &Point, first_of_knob: bool) -> String {
    if !point.label.is_empty() {
        return format!("{}, {} m/s", point.label, point.speed_m_per_s);
    }
    match (point.knob, point.value) {
        (Knob::Prefix, count) => format!("{} splits", grouped(count as u64)),
        (_, 0.0) => "0 (full mesh)".to_string(),
        (Knob::Local, _) if first_of_knob => "base mesh".to_string(),
        (_, value) => length(value),
    }
}

/// A row of the bytes of a model over the link.
pub fn bytes_row(row: &Bytes) -> [String; 8] {
    [
        row.model.clone(),
        grouped(row.vertices),
        grouped(row.faces),
        bytes(row.first_touch_bytes),
        u64::try_from(row.local_full_bytes).map_or("never".to_string(), bytes),
        bytes(row.trajectory_bytes),
        bytes(row.records_bytes),
        bytes(row.plain_bytes),
    ]
}

/// A row for each setting of a model; points of one model follow each other.
fn settings(points: &[Point]) -> Table {
    let heads = "knob | asked | true error\nmax | \np50 | certified\nmax | force off\nmax | normal off\n\
        max | tick\np50 | \np99 | \np99.9 | faces | received | memory";
    let mut table = Table::new(1, heads);
    let mut last = None;
    for point in points {
        let first = last != Some(point.knob);
        last = Some(point.knob);
        table.row([
            point.knob.name().to_string(),
            asked(point, first),
            length(point.true_m),
            length(point.true_p50_m),
            length(point.certified_m),
            format!("{} N", digits(point.force_n)),
            format!("{}°", digits(point.normal_deg)),
            format!("{:.1} µs", point.tick_us.p50),
            format!("{:.1} µs", point.tick_us.p99),
            format!("{:.1} µs", point.tick_us.p999),
            grouped(point.faces_p50 as u64),
            bytes(point.bytes),
            bytes(point.rss_bytes),
        ]);
    }
    table
}

/// The tables of the terminal.
#[must_use]
pub fn words(found: &Accuracy) -> String {
    let mut text = String::new();
    let models = found.points.chunk_by(|a, b| a.model_place == b.model_place);
    for points in models {
        let _ = writeln!(text, "\n{}\n{}", points[0].model, settings(points));
    }
    let heads = "bytes over the link | vertices | faces | first touch | local at full | \
        whole tour | all records | plain mesh";
    let mut table = Table::new(1, heads);
    for row in &found.bytes {
        table.row(bytes_row(row));
    }
    let _ = write!(text, "\n{table}");
    let failed: Vec<_> = found.checks.iter().filter(|check| !check.pass).collect();
    let _ = writeln!(text, "\nchecks  {}", found.held());
    for check in failed {
        let _ = writeln!(
            text,
            "        FAILED {}: {}: {:.3e}, at most {:.1e}",
            check.model, check.name, check.worst, check.limit
        );
    }
    for failed in &found.failed {
        let _ = writeln!(text, "FAILED  {failed}");
    }
    text
}

/// One line a setting.
#[must_use]
pub fn csv(found: &Accuracy) -> String {
    let mut text = String::from(
        "model,knob,value,label,setting,speed_m_per_s,tick_p50_us,tick_p99_us,tick_p999_us,inbox_mean_us,refine_mean_us,refit_mean_us,query_mean_us,force_mean_us,broad_phase_mean_us,certified_m,certified_p50_m,true_m,true_p50_m,measured_m,normal_deg,normal_p50_deg,force_n,force_p50_n,energy_j,certified_over_true_p50,bytes,bytes_until_ready,rss_bytes,cache_bytes,faces_p50,ready_ms,settled_ms,contact_ticks,contact_full_ticks,tool_faces,tool_us\n",
    );
    for p in &found.points {
        let stages = p.stage_us.named().map(|(_, stage)| stage.mean);
        let numbers = [p.tick_us.p50, p.tick_us.p99, p.tick_us.p999]
            .into_iter()
            .chain(stages)
            .chain([
                p.certified_m,
                p.certified_p50_m,
                p.true_m,
                p.true_p50_m,
                p.measured_m,
                p.normal_deg,
                p.normal_p50_deg,
                p.force_n,
                p.force_p50_n,
                p.energy_j,
                p.certified_over_true_p50,
                p.bytes as f64,
                p.bytes_until_ready as f64,
                p.rss_bytes as f64,
                p.cache_bytes as f64,
                p.faces_p50,
                p.ready_ms,
                p.settled_ms,
                p.contact_ticks as f64,
                p.contact_full_ticks as f64,
                p.tool_faces,
                p.tool_us,
            ]);
        let quoted = |of: &str| of.replace('"', "\"\"");
        let _ = write!(
            text,
            "\"{}\",{},{},\"{}\",\"{}\",{}",
            quoted(&p.model),
            p.knob.name(),
            p.value,
            quoted(&p.label),
            quoted(&p.setting),
            p.speed_m_per_s
        );
        for number in numbers {
            let _ = write!(text, ",{number}");
        }
        text.push('\n');
    }
    text
}
