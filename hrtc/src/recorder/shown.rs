//! What a recording shows to people of a tick.

use super::RecordingError;
use super::schema::Schemas;
use crate::tick_record::TickRecord;
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::Controller;
use prost_reflect::prost::Message as _;
use prost_reflect::{DynamicMessage, Value};

/// A channel for people, one for each probe or one for the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shown {
    /// Pose of the device.
    Device,
    /// Pose of the proxy at the touched object.
    Proxy,
    /// Wrench on the hand.
    Wrench,
    /// Contact.
    Contact,
    /// Energy account.
    Energy,
    /// Resolution of the mesh at the contacts.
    Resolution,
    /// Work and memory.
    Budget,
    /// Times of the tick's stages.
    StageTimes,
    /// A missed period.
    Miss,
    /// A sentence.
    Event,
}

impl Shown {
    /// Channels of each probe.
    pub(super) const OF_PROBE: [Self; 5] = [
        Self::Device,
        Self::Proxy,
        Self::Wrench,
        Self::Contact,
        Self::Energy,
    ];
    /// Channels of the run.
    pub(super) const OF_RUN: [Self; 5] = [
        Self::Resolution,
        Self::Budget,
        Self::StageTimes,
        Self::Miss,
        Self::Event,
    ];

    /// Last part of the topic.
    pub(super) const fn topic(self) -> &'static str {
        match self {
            Self::Device => "device",
            Self::Proxy => "proxy",
            Self::Wrench => "wrench",
            Self::Contact => "contact",
            Self::Energy => "energy",
            Self::Resolution => "resolution",
            Self::Budget => "budget",
            Self::StageTimes => "stage_times",
            Self::Miss => "miss",
            Self::Event => "event",
        }
    }

    /// Full name of the message's schema.
    pub(super) const fn schema_name(self) -> &'static str {
        match self {
            Self::Device | Self::Proxy => "foxglove.PoseInFrame",
            Self::Event => "foxglove.Log",
            Self::Wrench => "hrtc.Wrench",
            Self::Contact => "hrtc.Contact",
            Self::Energy => "hrtc.Energy",
            Self::Resolution => "hrtc.Resolution",
            Self::Budget => "hrtc.Budget",
            Self::StageTimes => "hrtc.StageTimes",
            Self::Miss => "hrtc.Miss",
        }
    }
}

/// Levels of `foxglove.Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Level {
    Info = 2,
    Warning = 3,
    Fatal = 5,
}

/// Encodes what is shown of one tick.
pub(super) struct Display<'a> {
    pub schemas: &'a Schemas,
    /// CLOCK_REALTIME, ns.
    pub now_ns: u64,
}

/// The bytes of a message; `None` when there is nothing to show.
type Encoded = Result<Option<Vec<u8>>, RecordingError>;

impl Display<'_> {
    /// A message of a probe's channel. The twin's controller gives what the tick does not put out.
    pub(super) fn of_probe(
        &self,
        shown: Shown,
        k: usize,
        record: &TickRecord,
        twin: Option<&Controller>,
    ) -> Encoded {
        let message = match shown {
            Shown::Device => record.samples[k].map(|sample| self.pose(&sample.pose)),
            Shown::Proxy => proxy(k, record, twin).map(|at| self.pose(&at)),
            Shown::Wrench => Some(self.wrench(k, record)),
            Shown::Contact => self.contact(k, record),
            Shown::Energy => {
                let energy_j = record.core.probes[k].energy_j;
                Some(self.message(shown, [Value::F64(energy_j)]))
            }
            _ => None,
        };
        encoded(message)
    }

    /// A message of a channel of the run.
    pub(super) fn of_run(&self, shown: Shown, record: &TickRecord) -> Encoded {
        let core = &record.core;
        let message = match shown {
            Shown::Resolution => Some(self.message(
                shown,
                [
                    Value::F64(core.contact_tolerance_m),
                    Value::F64(core.finest_tolerance_m),
                    Value::F64(core.certified_error_m),
                    Value::F64(core.measured_error_m),
                    Value::U64(core.active_faces.into()),
                    Value::U64(core.vsps_loaded.into()),
                ],
            )),
            Shown::Budget => Some(self.message(
                shown,
                [
                    Value::U64(core.work_units.into()),
                    Value::U64(core.query_work.into()),
                    Value::U64(core.vsplits.into()),
                    Value::U64(core.ecols.into()),
                    Value::U64(core.cache_bytes),
                    Value::U64(core.bytes_received),
                ],
            )),
            Shown::StageTimes => {
                let [a, b, c, d, e, f] = record.stage_ns;
                let (cpu, wall) = (record.work_cpu_ns, record.work_wall_ns);
                let times = [a, b, c, d, e, f, cpu, wall, record.wake_ns];
                Some(self.message(shown, times.map(|ns| Value::U64(ns.into()))))
            }
            Shown::Miss => (record.skipped > 0).then(|| {
                let fields = [
                    Value::U64(record.tick),
                    Value::U64(record.skipped.into()),
                    Value::String(format!("{:?}", record.misses[0].class)),
                    Value::U64(record.wake_ns.into()),
                ];
                self.message(shown, fields)
            }),
            _ => None,
        };
        encoded(message)
    }

    /// An event.
    pub(super) fn event(&self, level: Level, sentence: &str) -> Encoded {
        let fields = [
            self.time()?,
            Value::EnumNumber(level as i32),
            Value::String(sentence.to_owned()),
            Value::String("hrtc".to_owned()),
            Value::String(String::new()),
            Value::U32(0),
        ];
        encoded(Some(self.message(Shown::Event, fields)))
    }

    fn message<const N: usize>(
        &self,
        shown: Shown,
        fields: [Value; N],
    ) -> Result<DynamicMessage, RecordingError> {
        self.schemas.message(shown.schema_name(), fields)
    }

    fn part<const N: usize>(
        &self,
        name: &str,
        fields: [Value; N],
    ) -> Result<Value, RecordingError> {
        Ok(Value::Message(self.schemas.message(name, fields)?))
    }

    fn time(&self) -> Result<Value, RecordingError> {
        const SECOND_NS: u64 = 1_000_000_000;
        let (seconds, nanos) = (self.now_ns / SECOND_NS, self.now_ns % SECOND_NS);
        // Both fit: 64 bits of nanoseconds are 585 years.
        let fields = [Value::I64(seconds as i64), Value::I32(nanos as i32)];
        self.part("google.protobuf.Timestamp", fields)
    }

    fn vector(&self, v: DVec3) -> Result<Value, RecordingError> {
        self.part("foxglove.Vector3", v.to_array().map(Value::F64))
    }

    fn pose(&self, pose: &Pose) -> Result<DynamicMessage, RecordingError> {
        let DQuat { x, y, z, w } = pose.orientation;
        let orientation = self.part("foxglove.Quaternion", [x, y, z, w].map(Value::F64))?;
        let pose = self.part("foxglove.Pose", [self.vector(pose.position)?, orientation])?;
        self.message(
            Shown::Device,
            [self.time()?, Value::String("world".to_owned()), pose],
        )
    }

    fn wrench(&self, k: usize, record: &TickRecord) -> Result<DynamicMessage, RecordingError> {
        let wrench = &record.wrenches[k];
        let (force, torque) = (self.vector(wrench.force)?, self.vector(wrench.torque)?);
        self.message(Shown::Wrench, [self.time()?, force, torque])
    }

    fn contact(
        &self,
        k: usize,
        record: &TickRecord,
    ) -> Option<Result<DynamicMessage, RecordingError>> {
        let of = record.contacts[k]?;
        let core = &record.core.probes[k];
        let fields = || {
            Ok([
                self.time()?,
                Value::U64(of.object.into()),
                Value::U64(of.contact.face.into()),
                self.vector(of.contact.point)?,
                Value::F64(core.depth_m),
                Value::Bool(core.contact_full),
            ])
        };
        Some(fields().and_then(|fields| self.message(Shown::Contact, fields)))
    }
}

/// Pose of a probe's proxy at the object that it touches.
fn proxy(k: usize, record: &TickRecord, twin: Option<&Controller>) -> Option<Pose> {
    Some(Pose {
        position: twin?.proxy_of(k, record.contacts[k]?.object as usize)?,
        orientation: record.samples[k]?.pose.orientation,
    })
}

fn encoded(message: Option<Result<DynamicMessage, RecordingError>>) -> Encoded {
    Ok(message.transpose()?.map(|of| of.encode_to_vec()))
}

#[cfg(test)]
mod tests;
