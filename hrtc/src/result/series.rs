//! A run over time in a bounded number of pieces. When they are used up, neighbours are merged.

use crate::tick_record::TickRecord;
use hrtc_core::record::max_or_nan;
use serde::{Deserialize, Serialize};

/// Limit of the pieces of a series; even.
pub const SERIES_BUCKETS: usize = 2000;

/// Figures of one piece of a run. One of which a value was not finite is left out of the JSON.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SeriesBucket {
    /// Start, seconds from tick 0.
    pub seconds: f64,
    /// Ticks run.
    pub ticks: u64,
    /// Periods skipped.
    pub missed: u64,
    /// Ticks in contact.
    pub contact_ticks: u64,
    /// Of these, at full resolution.
    pub contact_full_ticks: u64,
    /// Largest force, newtons.
    #[serde(skip_serializing_if = "is_not_finite", default = "not_a_number")]
    pub force_n: f64,
    /// Largest processor time of a tick's work, microseconds.
    pub work_us: f64,
    /// Largest delay of a wake-up, microseconds.
    pub wake_us: f64,
    /// Largest number of active faces.
    pub refined_faces: u64,
    /// Largest certified error at the contact, metres; negative where no contact had a bound.
    #[serde(skip_serializing_if = "is_not_finite", default = "not_a_number")]
    pub certified_error_m: f64,
    /// Largest measured error that arrived, metres; negative when none did.
    #[serde(skip_serializing_if = "is_not_finite", default = "not_a_number")]
    pub measured_error_m: f64,
    /// Largest number of bytes of the cache in use.
    pub cache_bytes: u64,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "the form that serde calls"
)]
fn is_not_finite(value: &f64) -> bool {
    !value.is_finite()
}

fn not_a_number() -> f64 {
    f64::NAN
}

impl SeriesBucket {
    /// One tick.
    #[must_use]
    pub fn of(record: &TickRecord) -> Self {
        let core = &record.core;
        Self {
            seconds: 0.0,
            ticks: 1,
            missed: u64::from(record.skipped),
            contact_ticks: u64::from(core.contact),
            contact_full_ticks: u64::from(core.contact && core.contact_full),
            force_n: record.largest_force(),
            work_us: f64::from(record.work_cpu_ns) / 1e3,
            wake_us: f64::from(record.wake_ns) / 1e3,
            refined_faces: u64::from(core.active_faces),
            certified_error_m: if core.contact && core.contact_bounded {
                core.certified_error_m
            } else {
                -1.0
            },
            measured_error_m: core.measured_error_m,
            cache_bytes: core.cache_bytes,
        }
    }

    /// An empty piece.
    fn empty() -> Self {
        Self {
            certified_error_m: -1.0,
            measured_error_m: -1.0,
            ..Self::default()
        }
    }

    /// Adds a later piece; the start stays.
    fn merge(&mut self, other: &Self) {
        self.ticks += other.ticks;
        self.missed += other.missed;
        self.contact_ticks += other.contact_ticks;
        self.contact_full_ticks += other.contact_full_ticks;
        self.force_n = max_or_nan(self.force_n, other.force_n);
        self.work_us = self.work_us.max(other.work_us);
        self.wake_us = self.wake_us.max(other.wake_us);
        self.refined_faces = self.refined_faces.max(other.refined_faces);
        self.certified_error_m = max_or_nan(self.certified_error_m, other.certified_error_m);
        self.measured_error_m = max_or_nan(self.measured_error_m, other.measured_error_m);
        self.cache_bytes = self.cache_bytes.max(other.cache_bytes);
    }
}

/// The pieces while they are filled.
pub(super) struct Series {
    /// Periods a piece: a power of two.
    stride: u64,
    buckets: Vec<SeriesBucket>,
}

impl Series {
    pub(super) fn new() -> Self {
        Self {
            stride: 1,
            buckets: vec![SeriesBucket::empty(); SERIES_BUCKETS],
        }
    }

    /// Adds one tick at its index.
    pub(super) fn push(&mut self, tick: u64, one: SeriesBucket) {
        // Each turn doubles the stride: at most 64 turns in the life of a series.
        while tick / self.stride >= SERIES_BUCKETS as u64 {
            for index in 0..SERIES_BUCKETS / 2 {
                let mut left = self.buckets[2 * index];
                left.merge(&self.buckets[2 * index + 1]);
                self.buckets[index] = left;
            }
            self.buckets[SERIES_BUCKETS / 2..].fill(SeriesBucket::empty());
            self.stride *= 2;
        }
        self.buckets[(tick / self.stride) as usize].merge(&one);
    }

    /// The pieces with ticks, ascending in time.
    pub(super) fn finish(self, period_s: f64) -> Vec<SeriesBucket> {
        let width = self.stride as f64 * period_s;
        self.buckets
            .into_iter()
            .enumerate()
            .filter(|(_, bucket)| bucket.ticks > 0)
            .map(|(index, bucket)| SeriesBucket {
                seconds: index as f64 * width,
                ..bucket
            })
            .collect()
    }
}
