//! The protobuf messages of a recording for people, each described in the file itself.
//!
//! Those of the package `foxglove` have names and fields of
//! [Foxglove's schemas](https://docs.foxglove.dev/docs/sdk/schemas): Foxglove and rerun show them
//! without being told how.

use super::RecordingError;
use crate::tick_record::STAGES;
use prost_reflect::prost::Message as _;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type};
use prost_reflect::prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};
use prost_reflect::{DescriptorPool, DynamicMessage, Value};

/// Type of a field.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Number,
    Count,
    Flag,
    Text,
    /// A line of a source file.
    Line,
    Seconds,
    Nanoseconds,
    /// A level of `foxglove.Log`.
    Level,
    /// Another message, by its full name.
    Part(&'static str),
}

/// Name and fields of a message; a field's number is its place, from 1.
type Table = (&'static str, &'static [(&'static str, Kind)]);

const TIMESTAMP: (&str, Kind) = ("timestamp", Kind::Part("google.protobuf.Timestamp"));

/// As prost-reflect describes it, too, but only with all others of its package: a quarter of a
/// megabyte of program, which would be locked in memory.
const GOOGLE: [Table; 1] = [(
    "Timestamp",
    &[("seconds", Kind::Seconds), ("nanos", Kind::Nanoseconds)],
)];

const FOXGLOVE: [Table; 5] = [
    (
        "Vector3",
        &[
            ("x", Kind::Number),
            ("y", Kind::Number),
            ("z", Kind::Number),
        ],
    ),
    (
        "Quaternion",
        &[
            ("x", Kind::Number),
            ("y", Kind::Number),
            ("z", Kind::Number),
            ("w", Kind::Number),
        ],
    ),
    (
        "Pose",
        &[
            ("position", Kind::Part("foxglove.Vector3")),
            ("orientation", Kind::Part("foxglove.Quaternion")),
        ],
    ),
    (
        "PoseInFrame",
        &[
            TIMESTAMP,
            ("frame_id", Kind::Text),
            ("pose", Kind::Part("foxglove.Pose")),
        ],
    ),
    (
        "Log",
        &[
            TIMESTAMP,
            ("level", Kind::Level),
            ("message", Kind::Text),
            ("name", Kind::Text),
            ("file", Kind::Text),
            ("line", Kind::Line),
        ],
    ),
];

const HRTC: [Table; 7] = [
    (
        "Wrench",
        &[
            TIMESTAMP,
            ("force", Kind::Part("foxglove.Vector3")),
            ("torque", Kind::Part("foxglove.Vector3")),
        ],
    ),
    (
        "Contact",
        &[
            TIMESTAMP,
            ("object", Kind::Count),
            ("face", Kind::Count),
            ("point", Kind::Part("foxglove.Vector3")),
            ("depth_m", Kind::Number),
            ("full", Kind::Flag),
        ],
    ),
    ("Energy", &[("energy_j", Kind::Number)]),
    (
        "Resolution",
        &[
            ("contact_tolerance_m", Kind::Number),
            ("finest_tolerance_m", Kind::Number),
            ("certified_error_m", Kind::Number),
            ("measured_error_m", Kind::Number),
            ("active_faces", Kind::Count),
            ("vsps_loaded", Kind::Count),
        ],
    ),
    (
        "Budget",
        &[
            ("work_units", Kind::Count),
            ("query_work", Kind::Count),
            ("vsplits", Kind::Count),
            ("ecols", Kind::Count),
            ("cache_bytes", Kind::Count),
            ("bytes_received", Kind::Count),
        ],
    ),
    (
        "StageTimes",
        &[
            (STAGES[0], Kind::Count),
            (STAGES[1], Kind::Count),
            (STAGES[2], Kind::Count),
            (STAGES[3], Kind::Count),
            (STAGES[4], Kind::Count),
            (STAGES[5], Kind::Count),
            ("cpu", Kind::Count),
            ("wall", Kind::Count),
            ("wake", Kind::Count),
        ],
    ),
    (
        "Miss",
        &[
            ("tick", Kind::Count),
            ("skipped", Kind::Count),
            ("class", Kind::Text),
            ("wake_ns", Kind::Count),
        ],
    ),
];

/// Levels of `foxglove.Log`, from 0.
const LEVELS: [&str; 6] = ["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"];

/// The messages, with their description for the file.
#[derive(Debug)]
pub(super) struct Schemas {
    pool: DescriptorPool,
    /// A `FileDescriptorSet` of all of them.
    pub description: Vec<u8>,
}

impl Schemas {
    /// Describes the messages.
    ///
    /// # Errors
    /// When a table above names a message that is in none.
    pub(super) fn new() -> Result<Self, RecordingError> {
        const TIME: &str = "google/protobuf/timestamp.proto";
        const COMMON: &str = "foxglove.proto";
        let set = FileDescriptorSet {
            file: vec![
                file(TIME, "google.protobuf", &[], &GOOGLE),
                file(COMMON, "foxglove", &[TIME], &FOXGLOVE),
                file("hrtc.proto", "hrtc", &[TIME, COMMON], &HRTC),
            ],
        };
        let description = set.encode_to_vec();
        let pool = DescriptorPool::from_file_descriptor_set(set);
        Ok(Self {
            pool: pool.map_err(|e| RecordingError::Schema(e.to_string()))?,
            description,
        })
    }

    /// A message with the values of its fields, in their order.
    ///
    /// # Errors
    /// When there is no such message, or a value is not of its field's type.
    pub(super) fn message<const N: usize>(
        &self,
        name: &str,
        values: [Value; N],
    ) -> Result<DynamicMessage, RecordingError> {
        let unknown = || RecordingError::Schema(format!("there is no message {name}"));
        let described = self.pool.get_message_by_name(name).ok_or_else(unknown)?;
        let mut message = DynamicMessage::new(described);
        for (number, value) in (1..).zip(values) {
            message
                .try_set_field_by_number(number, value)
                .map_err(|e| RecordingError::Schema(format!("{name}: {e}")))?;
        }
        Ok(message)
    }
}

/// A file with the messages of a package.
fn file(name: &str, package: &str, imports: &[&str], tables: &[Table]) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        dependency: imports.iter().map(|&of| of.to_owned()).collect(),
        message_type: tables.iter().map(description).collect(),
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    }
}

fn description(&(name, fields): &Table) -> DescriptorProto {
    let has_level = fields.iter().any(|of| matches!(of.1, Kind::Level));
    DescriptorProto {
        name: Some(name.to_owned()),
        field: (1..)
            .zip(fields)
            .map(|(number, of)| field(number, of))
            .collect(),
        enum_type: has_level.then(levels).into_iter().collect(),
        ..DescriptorProto::default()
    }
}

fn field(number: i32, &(name, kind): &(&str, Kind)) -> FieldDescriptorProto {
    let (kind, type_name) = match kind {
        Kind::Number => (Type::Double, None),
        Kind::Count => (Type::Uint64, None),
        Kind::Flag => (Type::Bool, None),
        Kind::Text => (Type::String, None),
        Kind::Line => (Type::Fixed32, None),
        Kind::Seconds => (Type::Int64, None),
        Kind::Nanoseconds => (Type::Int32, None),
        Kind::Level => (Type::Enum, Some(".foxglove.Log.Level".to_owned())),
        Kind::Part(of) => (Type::Message, Some(format!(".{of}"))),
    };
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional.into()),
        r#type: Some(kind.into()),
        type_name,
        ..FieldDescriptorProto::default()
    }
}

fn levels() -> EnumDescriptorProto {
    let value = |(number, name): (i32, &&str)| EnumValueDescriptorProto {
        name: Some((*name).to_owned()),
        number: Some(number),
        options: None,
    };
    EnumDescriptorProto {
        name: Some("Level".to_owned()),
        value: (0..).zip(&LEVELS).map(value).collect(),
        ..EnumDescriptorProto::default()
    }
}
