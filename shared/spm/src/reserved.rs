//! A list with its reserved room, for `serde(with = "spm::reserved")`: where the room of a list
//! decides what happens, a state that is read again must have the same.

use serde::de::{Deserialize, Deserializer};
use serde::ser::{Serialize, Serializer};

/// Writes the room and the list.
///
/// # Errors
/// Those of the serializer.
pub fn serialize<T: Serialize, S: Serializer>(
    list: &Vec<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    (list.capacity() as u64, list).serialize(serializer)
}

/// Reads a list and reserves the same room.
///
/// # Errors
/// Those of the deserializer.
pub fn deserialize<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    /// Room beyond this is no state of ours: the bytes are damaged.
    const MAX_ROOM: u64 = 1 << 28;
    let (room, read) = <(u64, Vec<T>)>::deserialize(deserializer)?;
    let room = room.min(MAX_ROOM) as usize;
    let mut list = Vec::with_capacity(room.max(read.len()));
    list.extend(read);
    Ok(list)
}
