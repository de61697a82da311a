//! What a recording shows to people: JSON messages with their schemas, the names those that
//! Foxglove and rerun know wherever they have one.

use crate::tick_record::{STAGES, TickRecord};
use geometry::Pose;
use glam::{DQuat, DVec3};
use hrtc_core::Controller;
use serde_json::{Value, json};

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

    /// Name of the message's schema.
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

    /// The schema, as JSON Schema.
    pub(super) fn schema(self) -> Value {
        let properties = match self {
            Self::Device | Self::Proxy => json!({
                "timestamp": time_schema(),
                "frame_id": {"type": "string"},
                "pose": {"title": "foxglove.Pose", "type": "object", "properties": {
                    "position": vector_schema(),
                    "orientation": {"title": "foxglove.Quaternion", "type": "object",
                        "properties": numbers(&["x", "y", "z", "w"])},
                }},
            }),
            Self::Wrench => json!({
                "timestamp": time_schema(), "force": vector_schema(), "torque": vector_schema(),
            }),
            Self::Contact => json!({
                "timestamp": time_schema(),
                "object": {"type": "integer"},
                "face": {"type": "integer"},
                "point": vector_schema(),
                "depth_m": {"type": "number"},
                "full": {"type": "boolean"},
            }),
            Self::Energy => numbers(&["energy_j"]),
            Self::Resolution => numbers(&RESOLUTION),
            Self::Budget => numbers(&BUDGET),
            Self::StageTimes => numbers(&STAGE_TIMES),
            Self::Miss => json!({
                "tick": {"type": "integer"}, "skipped": {"type": "integer"},
                "class": {"type": "string"}, "wake_ns": {"type": "integer"},
            }),
            Self::Event => json!({
                "timestamp": time_schema(), "level": {"type": "integer"},
                "message": {"type": "string"}, "name": {"type": "string"},
                "file": {"type": "string"}, "line": {"type": "integer"},
            }),
        };
        json!({"title": self.schema_name(), "type": "object", "properties": properties})
    }
}

const RESOLUTION: [&str; 6] = [
    "contact_tolerance_m",
    "finest_tolerance_m",
    "certified_error_m",
    "measured_error_m",
    "active_faces",
    "vsps_loaded",
];
const BUDGET: [&str; 6] = [
    "work_units",
    "query_work",
    "vsplits",
    "ecols",
    "cache_bytes",
    "bytes_received",
];
const STAGE_TIMES: [&str; 9] = [
    STAGES[0], STAGES[1], STAGES[2], STAGES[3], STAGES[4], STAGES[5], "cpu", "wall", "wake",
];

fn numbers(names: &[&str]) -> Value {
    let properties = names
        .iter()
        .map(|name| ((*name).to_owned(), json!({"type": "number"})));
    Value::Object(properties.collect())
}

fn vector_schema() -> Value {
    json!({"title": "foxglove.Vector3", "type": "object", "properties": numbers(&["x", "y", "z"])})
}

fn time_schema() -> Value {
    json!({"title": "time", "type": "object", "properties": {
        "sec": {"type": "integer", "minimum": 0},
        "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
    }})
}

fn time(ns: u64) -> Value {
    json!({"sec": ns / 1_000_000_000, "nsec": ns % 1_000_000_000})
}

fn vector(v: DVec3) -> Value {
    json!({"x": v.x, "y": v.y, "z": v.z})
}

fn pose(ns: u64, pose: &Pose) -> Value {
    let DQuat { x, y, z, w } = pose.orientation;
    json!({
        "timestamp": time(ns), "frame_id": "world",
        "pose": {"position": vector(pose.position), "orientation": {"x": x, "y": y, "z": z, "w": w}},
    })
}

/// A message of a probe's channel; `None` when there is nothing to show. The twin's controller
/// gives what the tick does not put out.
pub(super) fn of_probe(
    shown: Shown,
    k: usize,
    ns: u64,
    record: &TickRecord,
    twin: Option<&Controller>,
) -> Option<Value> {
    let contact = record.contacts[k];
    let core = &record.core.probes[k];
    match shown {
        Shown::Device => record.samples[k].map(|sample| pose(ns, &sample.pose)),
        Shown::Proxy => {
            let position = twin?.proxy_of(k, contact?.object as usize)?;
            let orientation = record.samples[k]?.pose.orientation;
            let at = Pose {
                position,
                orientation,
            };
            Some(pose(ns, &at))
        }
        Shown::Wrench => Some(json!({
            "timestamp": time(ns),
            "force": vector(record.wrenches[k].force), "torque": vector(record.wrenches[k].torque),
        })),
        Shown::Contact => contact.map(|of| {
            json!({
                "timestamp": time(ns), "object": of.object, "face": of.contact.face,
                "point": vector(of.contact.point), "depth_m": core.depth_m,
                "full": core.contact_full,
            })
        }),
        Shown::Energy => Some(json!({"energy_j": core.energy_j})),
        _ => None,
    }
}

/// A message of a channel of the run; `None` when there is nothing to show.
pub(super) fn of_run(shown: Shown, record: &TickRecord) -> Option<Value> {
    let core = &record.core;
    match shown {
        Shown::Resolution => Some(json!({
            "contact_tolerance_m": core.contact_tolerance_m,
            "finest_tolerance_m": core.finest_tolerance_m,
            "certified_error_m": core.certified_error_m,
            "measured_error_m": core.measured_error_m,
            "active_faces": core.active_faces, "vsps_loaded": core.vsps_loaded,
        })),
        Shown::Budget => Some(json!({
            "work_units": core.work_units, "query_work": core.query_work,
            "vsplits": core.vsplits, "ecols": core.ecols,
            "cache_bytes": core.cache_bytes, "bytes_received": core.bytes_received,
        })),
        Shown::StageTimes => {
            let of_all = [record.work_cpu_ns, record.work_wall_ns, record.wake_ns];
            let times = record.stage_ns.iter().chain(&of_all);
            let named = STAGE_TIMES.iter().zip(times);
            let fields = named.map(|(name, &ns)| ((*name).to_owned(), json!(ns)));
            Some(Value::Object(fields.collect()))
        }
        Shown::Miss => (record.skipped > 0).then(|| {
            json!({
                "tick": record.tick, "skipped": record.skipped,
                "class": format!("{:?}", record.misses[0].class), "wake_ns": record.wake_ns,
            })
        }),
        _ => None,
    }
}

/// Levels of `foxglove.Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Level {
    Info = 2,
    Warning = 3,
    Fatal = 5,
}

/// An event.
pub(super) fn event(ns: u64, level: Level, sentence: &str) -> Value {
    json!({
        "timestamp": time(ns), "level": level as u8, "message": sentence, "name": "hrtc",
        "file": "", "line": 0,
    })
}
