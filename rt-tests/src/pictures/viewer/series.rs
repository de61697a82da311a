//! The numbers of a run over time.

use super::TIMELINE;
use hrtc::tick_record::{STAGES, TickRecord};
use rerun::{RecordingStream, RecordingStreamResult, Scalars, SeriesLines};

/// A number of a tick; `None` where there is none.
type Number = fn(&TickRecord) -> Option<f64>;

/// Curves that are drawn together.
pub struct Plot {
    /// Over it.
    pub title: &'static str,
    /// Its entity below `plots`.
    pub entity: &'static str,
    curves: &'static [(&'static str, Number)],
}

impl Plot {
    /// Whether it has one curve, which its title says.
    pub fn has_one(&self) -> bool {
        self.curves.len() == 1
    }
}

/// All plots from above.
pub const PLOTS: [Plot; 7] = [
    Plot {
        title: "Force on the hand, N",
        entity: "force",
        curves: &[("force", |r| Some(r.largest_force()))],
    },
    Plot {
        title: "Error at the contact, µm",
        entity: "error",
        curves: &[
            ("certified", |r| in_contact(r, r.core.certified_error_m)),
            ("expected", |r| in_contact(r, r.core.contact_tolerance_m)),
            ("asked for", |r| in_contact(r, r.core.finest_tolerance_m)),
        ],
    },
    Plot {
        title: "Faces of the front",
        entity: "resolution",
        curves: &[("faces", |r| Some(f64::from(r.core.active_faces)))],
    },
    Plot {
        title: "Work of a tick by stage, µs",
        entity: "work",
        curves: &[
            ("all", |r| us(r.work_cpu_ns)),
            (STAGES[0], |r| us(r.stage_ns[0])),
            (STAGES[1], |r| us(r.stage_ns[1])),
            (STAGES[2], |r| us(r.stage_ns[2])),
            (STAGES[3], |r| us(r.stage_ns[3])),
            (STAGES[4], |r| us(r.stage_ns[4])),
            (STAGES[5], |r| us(r.stage_ns[5])),
        ],
    },
    Plot {
        title: "Period, µs",
        entity: "period",
        // The first tick has none before it.
        curves: &[("period", |r| us(r.period_ns).filter(|_| r.tick > 0))],
    },
    Plot {
        title: "Energy put out, mJ",
        entity: "energy",
        curves: &[("energy", |r| Some(1e3 * r.core.energy_j))],
    },
    Plot {
        title: "Cache, MiB",
        entity: "cache",
        curves: &[
            ("in use", |r| mib(r.core.cache_bytes)),
            ("limit", |r| mib(r.core.cache_limit_bytes)),
        ],
    },
];

fn us(ns: u32) -> Option<f64> {
    Some(1e-3 * f64::from(ns))
}

fn mib(bytes: u64) -> Option<f64> {
    Some(bytes as f64 / f64::from(1 << 20))
}

/// A length in contact, as micrometres; a negative one is none.
fn in_contact(record: &TickRecord, metres: f64) -> Option<f64> {
    (record.core.contact && metres >= 0.0).then_some(1e6 * metres)
}

/// A curve with the worst number of the present stretch of ticks.
struct Curve {
    path: String,
    number: Number,
    worst: Option<f64>,
    /// Whether its last point was a number: then the next without one is a gap.
    is_drawn: bool,
}

/// The worst number of each stretch of ticks.
pub struct Series {
    curves: Vec<Curve>,
}

impl Series {
    /// Names all curves.
    ///
    /// # Errors
    /// When the stream refuses.
    pub fn new(stream: &RecordingStream) -> RecordingStreamResult<Self> {
        let mut curves = Vec::new();
        for plot in &PLOTS {
            for (k, &(name, number)) in plot.curves.iter().enumerate() {
                let path = format!("plots/{}/{k}", plot.entity);
                let line = SeriesLines::new().with_names([name.replace('_', " ")]);
                stream.log_static(path.as_str(), &line)?;
                curves.push(Curve {
                    path,
                    number,
                    worst: None,
                    is_drawn: false,
                });
            }
        }
        Ok(Self { curves })
    }

    /// Takes a tick.
    pub fn take(&mut self, record: &TickRecord) {
        for curve in &mut self.curves {
            let finite = (curve.number)(record).filter(|x| x.is_finite());
            curve.worst = match (curve.worst, finite) {
                (Some(a), Some(b)) => Some(f64::max(a, b)),
                (a, b) => a.or(b),
            };
        }
    }

    /// Sends the stretch that ends at a time, seconds.
    ///
    /// # Errors
    /// When the stream refuses.
    pub fn send(&mut self, stream: &RecordingStream, seconds: f64) -> RecordingStreamResult<()> {
        stream.set_duration_secs(TIMELINE, seconds);
        for curve in &mut self.curves {
            let worst = curve.worst.take();
            if worst.is_some() || curve.is_drawn {
                let number = worst.unwrap_or(f64::NAN);
                stream.log(curve.path.as_str(), &Scalars::single(number))?;
            }
            curve.is_drawn = worst.is_some();
        }
        Ok(())
    }
}
