//! The closing report of a run: for the terminal in plain words, and as a page with plots beside
//! it.

mod page;

use crate::machine::{Machine, right_words};
use crate::report::units::{bytes, digits, grouped, length, percent, percent_of};
use hrtc::result::{Finished, RunResult, ShortSpread, Spread};
use hrtc_core::Capacity;
use scene::{Effect, RefinementPlan, ScenePlan, TrajectoryPlan};
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// Objects of which it is said where they came to; of more only how many.
const MAX_MOVED: usize = 8;

/// Everything that a report tells of.
#[derive(Debug)]
pub struct Report<'a> {
    /// The scene as it ran.
    pub plan: &'a ScenePlan,
    /// What the controller counted.
    pub finished: &'a Finished,
    /// The machine.
    pub machine: &'a Machine,
    /// What the supervisor saw, a sentence each: restarts, an early end.
    pub notes: &'a [String],
    /// The picture of the touch, a PNG file.
    pub picture: Option<&'a [u8]>,
}

impl Report<'_> {
    /// The report in plain words, one fact a line.
    #[must_use]
    pub fn words(&self) -> String {
        let mut text = String::new();
        for (name, sentences) in self.sections() {
            for (index, sentence) in sentences.iter().enumerate() {
                let head = if index == 0 { name } else { "" };
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{head:<11} {sentence}");
            }
        }
        text
    }

    fn sections(&self) -> Vec<(&'static str, Vec<String>)> {
        let mut sections = vec![
            ("run", self.run()),
            ("touch", self.touch()),
            ("objects", self.objects()),
            ("motion", self.motion()),
            ("accuracy", self.accuracy()),
            ("resolution", self.resolution()),
            ("transfer", self.transfer()),
            ("timing", self.timing()),
            ("rights", self.rights()),
            ("capacity", self.capacity()),
        ];
        sections.retain(|(_, sentences)| !sentences.is_empty());
        if !self.notes.is_empty() {
            sections.push(("notes", self.notes.to_vec()));
        }
        sections
    }

    fn run(&self) -> Vec<String> {
        let r = &self.finished.result;
        let seed = match r.seed {
            0 => String::new(),
            seed => format!(", seed {seed}"),
        };
        let model = if r.objects > 1 {
            "first model"
        } else {
            "model"
        };
        vec![
            format!(
                "scene {}, {model} {} ({} faces), {:.1} s{seed}",
                r.scene,
                r.model,
                grouped(r.faces),
                r.seconds
            ),
            if r.first_force_ready_ms > 0.0 {
                format!(
                    "a touch could be answered {:.0} ms after the start of both processes",
                    r.first_force_ready_ms
                )
            } else {
                "no model arrived: a touch could not be answered".to_string()
            },
        ]
    }

    fn touch(&self) -> Vec<String> {
        let r = &self.finished.result;
        if r.contact_ticks == 0 {
            return vec!["nothing was touched".to_string()];
        }
        let mut lines = vec![
            format!(
                "{:.1} s in contact ({} ticks); force p50 {:.2} N, p99 {:.2} N, max {:.2} N, at most {:.2} N of change a tick",
                r.contact_ticks as f64 / self.plan.loop_.rate_hz,
                grouped(r.contact_ticks),
                r.force_n.p50,
                r.force_n.p99,
                r.force_n.max,
                r.force_step_n_max
            ),
            format!(
                "{} tick(s) clamped, at {} N or the limit of its device, {} sample(s) rejected; deepest {} behind the surface",
                r.clamped_ticks,
                r.force_limit_n,
                r.rejected_samples,
                length(r.depth_m_max)
            ),
        ];
        lines.push(format!(
            "of the wanted force was withheld p50 {}, p99 {}, max {}: by the energy account, by limits, or where a contact was found late",
            percent_of(r.force_withheld.p50),
            percent_of(r.force_withheld.p99),
            percent_of(r.force_withheld.max)
        ));
        // What is no number is said, too.
        if r.torque_nm_max != 0.0 {
            lines.push(format!("torque max {} mN m", digits(1e3 * r.torque_nm_max)));
        }
        if r.contact_offset_m > 0.0 {
            lines.push(format!(
                "a tool's contacts act {} off the surface: it feels thicker by that",
                length(r.contact_offset_m)
            ));
        }
        if r.stuck_ticks > 0 {
            lines.push(format!(
                "in {} tick(s) a tool was stuck in a surface that had moved into it",
                grouped(r.stuck_ticks)
            ));
        }
        if r.unfinished_ticks + r.early_ticks > 0 {
            lines.push(format!(
                "in {} tick(s) a probe's budget was spent, in {} more a tool's tick ended early: the remaining displacement followed in the next ones; {} contact(s) were found late",
                grouped(r.unfinished_ticks),
                grouped(r.early_ticks),
                grouped(r.late_contacts)
            ));
        }
        let effects = self.effects();
        if !effects.is_empty() {
            lines.push(format!("with the effects {}", effects.join(", ")));
        }
        let has_effects = !effects.is_empty();
        lines.push(energy_words(r.energy_j, r.energy_j_max, has_effects));
        lines
    }

    /// The effects that the scene lists, each once.
    fn effects(&self) -> Vec<&'static str> {
        let of_objects = self.plan.objects.iter().flat_map(|of| of.effects.iter());
        let listed = of_objects.chain(&self.plan.effects);
        let kinds: BTreeSet<usize> = listed.map(|effect| effect.effect.index()).collect();
        kinds.into_iter().map(|kind| Effect::NAMES[kind]).collect()
    }

    /// Of several objects and probes; nothing of one.
    fn objects(&self) -> Vec<String> {
        let r = &self.finished.result;
        let mut lines = Vec::new();
        if r.probes.len() > 1 {
            for (number, probe) in r.probes.iter().enumerate() {
                lines.push(format!(
                    "probe {number}: {} tick(s) in contact, {} at full resolution; force p50 {:.2} N, max {:.2} N; energy {:.3} mJ",
                    grouped(probe.contact_ticks),
                    percent(probe.contact_full_ticks, probe.contact_ticks),
                    probe.force_n.p50,
                    probe.force_n.max,
                    probe.energy_j * 1e3
                ));
            }
        }
        if r.objects > 1 {
            lines.push(format!(
                "{} objects, of which {} can be awake at once and p50 {}, max {} were; the others cost p50 {:.1}, p99 {:.1}, max {:.1} µs a tick",
                grouped(r.objects),
                r.active_objects_max,
                r.awake.p50,
                r.awake.max,
                r.idle_us.p50,
                r.idle_us.p99,
                r.idle_us.max
            ));
            lines.push(if r.inactive_object_ticks == 0 {
                "each was awake before a probe could touch it".to_string()
            } else {
                format!(
                    "in {} tick(s) a probe could have touched an object that was not awake: more were near than could be",
                    grouped(r.inactive_object_ticks)
                )
            });
        }
        lines
    }

    /// Of objects that moved; nothing where all stood.
    fn motion(&self) -> Vec<String> {
        let r = &self.finished.result;
        let mut lines: Vec<String> = r
            .moved
            .iter()
            .take(MAX_MOVED)
            .map(|moved| {
                // As it is written, and 0 without a sign.
                let [x, y, z] = moved.position_m.map(|m| (1e4 * m).round() / 1e4 + 0.0);
                format!(
                    "object {}: awake for {} tick(s), at most {} from its place; in the end at ({x:.4}, {y:.4}, {z:.4}) m, turned by {:.1}°",
                    moved.object,
                    grouped(moved.awake_ticks),
                    length(moved.farthest_m),
                    moved.turned_rad.to_degrees()
                )
            })
            .collect();
        if r.moved.len() > MAX_MOVED {
            lines.push(format!(
                "{} other object(s) moved, see --json",
                grouped((r.moved.len() - MAX_MOVED) as u64)
            ));
        }
        lines
    }

    fn accuracy(&self) -> Vec<String> {
        let r = &self.finished.result;
        let asked = match (self.plan.accuracy.refinement, r.tolerance_m) {
            (RefinementPlan::Global { lod: Some(lod) }, _) => {
                format!(
                    "asked for: the first {} splits, everywhere",
                    grouped(u64::from(lod))
                )
            }
            (RefinementPlan::Global { lod: None }, tolerance) => {
                format!("asked for: an error of {} everywhere", length(tolerance))
            }
            (RefinementPlan::Local, 0.0) => "asked for: the full mesh at the contact".to_string(),
            (RefinementPlan::Local, tolerance) => {
                format!(
                    "asked for: an error of {} at the contact",
                    length(tolerance)
                )
            }
        };
        let rings = r.rings_m.iter().skip(1).map(|&error| length(error));
        let rings = rings.collect::<Vec<_>>().join(", ");
        let mut lines = vec![if rings.is_empty() {
            asked
        } else {
            format!("{asked}; rings around it{} for {rings}", self.of_first())
        }];
        if r.contact_ticks == 0 {
            return lines;
        }
        let is_unknown =
            r.contact_unbounded_ticks == r.contact_ticks && r.expected_error_m.max == 0.0;
        let expected = if is_unknown {
            "no expected error at the contact is known".to_string()
        } else {
            format!(
                "expected error at the contact p50 {}, p99 {}, max {}",
                length(r.expected_error_m.p50),
                length(r.expected_error_m.p99),
                length(r.expected_error_m.max)
            )
        };
        lines.push(format!(
            "{} contact tick(s) were coarser than that ({}); {expected}",
            grouped(r.coarser_ticks),
            percent(r.coarser_ticks, r.contact_ticks),
        ));
        if r.finest_tolerance_m.max > r.tolerance_m {
            lines.push(format!(
                "for want of time or of room the finest error asked for went up to {} (p50 {})",
                length(r.finest_tolerance_m.max),
                length(r.finest_tolerance_m.p50)
            ));
        }
        lines
    }

    /// Of what a figure is that is of one object, in a scene of several: of the one in the first
    /// place.
    fn of_first(&self) -> &'static str {
        match self.finished.result.objects {
            0 | 1 => "",
            _ => " (of one of the objects that were awake at the end)",
        }
    }

    fn capacity(&self) -> Vec<String> {
        let line = |c: &Capacity| {
            format!(
                "{}: at most {} of {} in use",
                c.name,
                grouped(c.high_water),
                grouped(c.capacity)
            )
        };
        let all = self.finished.result.capacities.iter();
        all.map(line).collect()
    }

    fn resolution(&self) -> Vec<String> {
        let r = &self.finished.result;
        let of = match r.objects {
            0 | 1 => format!("of {}", grouped(r.faces)),
            _ => "of all objects that were awake".to_string(),
        };
        let mut lines = vec![format!(
            "{} of the contact at full resolution; refined faces p50 {}, max {} {of}",
            percent(r.contact_full_ticks, r.contact_ticks),
            grouped(r.refined_faces.p50 as u64),
            grouped(r.refined_faces.max as u64)
        )];
        let bounded = r.contact_ticks.saturating_sub(r.contact_unbounded_ticks);
        lines.push(format!(
            "error at the contact: certified {}; measured {} over {} measurement(s)",
            errors(&r.certified_error_m, bounded),
            errors(&r.measured_error_m, r.measured_errors),
            grouped(r.measured_errors)
        ));
        if r.greatest_speed_m_per_s > 0.0 {
            lines.push(self.greatest_speed());
        }
        if r.contact_unbounded_ticks > 0 {
            lines.push(format!(
                "{} contact tick(s) had no certified bound",
                grouped(r.contact_unbounded_ticks)
            ));
        }
        lines
    }

    fn greatest_speed(&self) -> String {
        let greatest = self.finished.result.greatest_speed_m_per_s;
        let mut line = format!(
            "greatest speed at full resolution{}: {greatest:.3} m/s for this model at its size ({} operations a tick)",
            self.of_first(),
            self.plan.loop_.operations
        );
        let probes = self.plan.probes.iter();
        let tours = probes.filter_map(|probe| match probe.trajectory {
            TrajectoryPlan::Tour { speed_m_per_s, .. } => Some(speed_m_per_s),
            TrajectoryPlan::Points(_) => None,
        });
        if let Some(speed_m_per_s) = tours.reduce(f64::max) {
            let _ = write!(line, "; the tour goes at {speed_m_per_s} m/s");
            if speed_m_per_s > greatest {
                line.push_str(", so resolution follows speed");
            }
        }
        line
    }

    fn transfer(&self) -> Vec<String> {
        let r = &self.finished.result;
        let mut lines = vec![
            format!(
                "{} region(s) subscribed ({} asked for again, {} new start(s) of the link), {} splits and {} collapses performed",
                grouped(r.regions_subscribed),
                grouped(r.resent),
                grouped(r.resubscribed.saturating_sub(1)),
                grouped(r.vsplits),
                grouped(r.ecols)
            ),
            format!(
                "at most {} vertices geomorphing, in {} tick(s); {} time(s) a split waited for room to geomorph, {} for a face that it would turn over",
                grouped(r.geomorphs_max),
                grouped(r.geomorph_ticks),
                grouped(r.deferred),
                grouped(r.rejected_folds)
            ),
            format!(
                "{} received, {} of them before the first touch; all meshes whole would be {}",
                bytes(r.bytes_received),
                bytes(r.bytes_to_first_touch),
                bytes(r.bytes_full_mesh)
            ),
            format!(
                "cache at most {} of {} ({} records at once, {} evicted); the controller's process held at most {}",
                bytes(r.cache.high_water_bytes),
                bytes(r.cache.bytes),
                grouped(r.cache.vsps),
                grouped(r.cache.evicted),
                bytes(r.hrtc_rss_bytes)
            ),
        ];
        let cache = &r.cache;
        if cache.least_limit_bytes < cache.bytes {
            lines.push(format!(
                "the cache's limit was as low as {}; {} tick(s) began with more in use",
                bytes(cache.least_limit_bytes),
                grouped(cache.over_limit_ticks)
            ));
        }
        lines
    }

    fn timing(&self) -> Vec<String> {
        let r = &self.finished.result;
        let spread = |s: &Spread| {
            format!(
                "p50 {:.1}, p99 {:.1}, p99.9 {:.1}, max {:.1} µs",
                s.p50, s.p99, s.p999, s.max
            )
        };
        let mut lines = vec![
            format!("work of a tick (thread CPU): {}", spread(&r.work_us)),
            format!(
                "recording of a tick, on its thread: {}",
                spread(&r.record_us)
            ),
            format!("wake-up after the deadline: {}", spread(&r.wake_us)),
            format!("period: {}", spread(&r.period_us)),
        ];
        lines.extend(missed(r));
        if r.operations_budget > 0 {
            lines.push(format!(
                "worst tick {} work units of a budget of {}",
                grouped(r.operations_max),
                grouped(r.operations_budget)
            ));
        }
        lines.push(format!(
            "{} page fault(s) and {} allocation(s) within ticks; {} of the page faults in ticks that missed by own work",
            r.page_faults, r.allocations, r.page_faults_missed
        ));
        lines.push(format!("replay hash {:014x}", r.replay_hash));
        lines
    }

    fn rights(&self) -> Vec<String> {
        let machine = self.machine;
        let mut lines = vec![format!(
            "{}; kernel {} ({})",
            machine.processor, machine.kernel, machine.preemption
        )];
        lines.extend(self.finished.rights.iter().map(right_words));
        lines
    }
}

/// What is said of periods without a tick, and of ticks without a record.
fn missed(r: &RunResult) -> Vec<String> {
    let mut lines = Vec::new();
    if r.missed > 0 {
        let m = &r.misses;
        lines.push(format!(
            "{} period(s) missed beside {} ticks: {} by our own work, {} by waiting of our own, {} while the kernel ran something else, {} by a late timer, {} while the process was stopped, {} with the processor taken away, {} unexplained",
            grouped(r.missed),
            grouped(r.ticks),
            m.own_cpu,
            m.own_wait,
            m.run_queue,
            m.late_timer,
            m.stopped,
            m.stolen,
            m.unexplained
        ));
    } else if r.unaccounted_periods == 0 {
        lines.push(format!("no period missed in {} ticks", grouped(r.ticks)));
    }
    if r.unaccounted_periods != 0 {
        lines.push(format!(
            "{} period(s) are not in these figures: their records found the log full",
            r.unaccounted_periods
        ));
    }
    lines
}

/// What is said of the energy of the rendering, joules: at the end and at its most.
fn energy_words(end_j: f64, most_j: f64, has_effects: bool) -> String {
    let (end, most) = (end_j * 1e3, most_j * 1e3);
    if !(end_j.is_finite() && most_j.is_finite()) {
        "the energy of the rendering is not known: it was no finite number".to_string()
    } else if end_j > 0.0 {
        let others = if has_effects {
            ", but a magnet, a vibration, a spring, a weight or a mass may"
        } else {
            ""
        };
        format!(
            "the rendering pushed {end:.3} mJ into the hand: an ideal surface gives none{others}"
        )
    } else if most_j > 0.0 {
        format!(
            "the rendering took {:.3} mJ out in all, after it had pushed up to {most:.3} mJ in",
            end.abs()
        )
    } else {
        format!(
            "the rendering took {:.3} mJ out and pushed none in",
            end.abs()
        )
    }
}

/// Median and maximum of some errors; of none there is nothing to say.
fn errors(of: &ShortSpread, count: u64) -> String {
    if count == 0 {
        return "none".to_string();
    }
    format!("p50 {}, max {}", length(of.p50), length(of.max))
}

#[cfg(test)]
mod tests;
