//! What was seen of each touch, in words and tables.

use super::result::{Found, Row, Wire};
use crate::links::way::Carried;
use crate::report::table::Table;
use crate::report::units::{bytes, digits, grouped, length, percent, percent_of};
use hrtc::result::ShortSpread;
use std::fmt::Write as _;

impl Found {
    /// The result in words.
    #[must_use]
    pub fn words(&self) -> String {
        let (scene, of) = (&self.scene, self.conditions);
        let mut text = format!(
            "scene {}, model {} ({} faces, {} of records; cache {}), {} s each, seed {}; jitter up to {} ms",
            scene.scene,
            scene.model,
            grouped(scene.faces),
            bytes(scene.bytes_full_mesh),
            bytes(scene.cache_bytes),
            of.seconds,
            of.seed,
            of.jitter_ms
        );
        if of.cut_s > 0.0 {
            let _ = write!(text, ", cable cut for {} s", of.cut_s);
        }
        for (share_of, what) in [(of.damaged, "changed"), (of.replayed, "sent once more")] {
            if share_of > 0.0 {
                let _ = write!(text, ", {} of the packets {what}", percent_of(share_of));
            }
        }
        let _ = write!(text, "\n\n{}", self.table());
        for row in &self.rows {
            for fault in &row.faults {
                let _ = writeln!(text, "{}: {fault}", row.name());
            }
        }
        text.push_str(&self.words_of_messages());
        text.push_str(&self.words_of_forces());
        for row in self.rows.iter().filter(|row| !row.asked.is_empty()) {
            let _ = writeln!(text, "\n{}", row.name());
            for limit in &row.asked {
                let _ = writeln!(text, "  {limit}");
            }
        }
        text
    }

    /// Messages by kind: one line for each touch over a link.
    fn words_of_messages(&self) -> String {
        let mut rows = self.rows.iter().filter(|row| row.wire.is_some()).peekable();
        if rows.peek().is_none() {
            return String::new();
        }
        let heads = "round trip, bandwidth | closures and\nrecords, kB/s | bytes\na VSP | base mesh\nkB/s | tour\nkB/s | errors,\nothers | heartbeats\nheard | requests\nkB/s | contacts\nkB/s | heartbeats\nkB/s";
        let mut table = Table::new(1, heads);
        for row in rows {
            let rate = |bytes: u64| digits(bytes as f64 * 1e-3 / self.conditions.seconds);
            let each = row.answer_bytes_per_vsp;
            let of = &row.link_bytes;
            table.row([
                row.name(),
                rate(of.answers),
                each.map_or("none".to_string(), digits),
                rate(of.models),
                rate(of.tours),
                rate(of.others),
                rate(of.heartbeats_heard),
                rate(of.requests),
                rate(of.contacts),
                rate(of.heartbeats),
            ]);
        }
        format!(
            "\nmessages by kind, without what carries them: to the controller, then to the station\n{table}"
        )
    }

    /// Forces beside the local run's: one line for each touch over a link.
    fn words_of_forces(&self) -> String {
        let compared = |row: &&Row| row.forces.is_some_and(|forces| forces.ticks > 0);
        if !self.rows.iter().any(|row| compared(&row)) {
            return String::new();
        }
        let heads = "round trip, bandwidth | full\nin both | within\n1 % | same place,\ncompared | force\nwithin 1 % | else after\na skip | after\ncoarse | \nother | difference\np50 mN | \np99 mN | \nmax mN | periods\nskipped | \nin local";
        let mut table = Table::new(1, heads);
        for row in self.rows.iter().filter(compared) {
            let Some(of) = row.forces else { continue };
            let known = of.same_ticks + of.after_skip_ticks + of.after_coarse_ticks;
            let millinewtons = |n: f64| digits(1e3 * n);
            table.row([
                row.name(),
                grouped(of.full_ticks),
                percent(of.same_anywhere_ticks, of.full_ticks),
                grouped(of.ticks),
                percent(of.same_ticks, of.ticks),
                grouped(of.after_skip_ticks),
                grouped(of.after_coarse_ticks),
                grouped(of.ticks - known),
                millinewtons(of.difference_n.p50),
                millinewtons(of.difference_n.p99),
                millinewtons(of.difference_n.max),
                grouped(of.skipped),
                grouped(of.local_skipped),
            ]);
        }
        format!(
            "\nforces beside the local run's, where both are full, and where the hand is at the same place too\n{table}"
        )
    }

    /// One line for each touch.
    #[must_use]
    pub fn table(&self) -> Table {
        let heads = "round trip, bandwidth | contact at full\nresolution | certified error\np50 | \nmax | heard\nms | ready\nms | first touch\nms | first full\nms | force step\nN a period | to controller\nkB/s | to station\nkB/s | \nVSPs | bytes\na VSP | begun\nanew | links\nmade | packets\nlost | own\nmisses | relay late\np99 ms";
        let mut table = Table::new(1, heads);
        let or_none = |number: Option<f64>| number.map_or("none".to_string(), digits);
        for row in &self.rows {
            let rate = |of: fn(&Wire) -> Carried| {
                let rate = |wire: &Wire| of(wire).bytes as f64 * 1e-3 / self.conditions.seconds;
                row.wire
                    .as_ref()
                    .map_or(String::new(), |wire| digits(rate(wire)))
            };
            let error = |of: fn(ShortSpread) -> f64| {
                let certified = row.certified_error_m.map(of);
                certified.map_or("none".to_string(), length)
            };
            let lost = row.wire.map_or(String::new(), |wire| {
                let of = |way: Carried| way.lost + way.dropped + way.cut;
                grouped(of(wire.to_controller) + of(wire.to_station))
            });
            let late = row
                .wire
                .map_or(String::new(), |wire| digits(wire.late_ms.p99));
            table.row([
                row.name(),
                percent(row.contact_full_ticks, row.contact_ticks),
                error(|certified| certified.p50),
                error(|certified| certified.max),
                or_none(row.heard_ms),
                or_none(row.first_force_ready_ms),
                or_none(row.first_touch_ms),
                or_none(row.local_full_ms),
                format!("{:.2}", row.force_step_per_period_n_max),
                rate(|wire| wire.to_controller),
                rate(|wire| wire.to_station),
                grouped(row.vsps_received),
                or_none(row.bytes_per_vsp),
                grouped(row.resubscribed),
                row.links_made.to_string(),
                lost,
                row.missed_own_cpu.to_string(),
                late,
            ]);
        }
        table
    }
}
