//! The inputs of a controller's first ticks, as bytes.

use bytemuck::{Zeroable, bytes_of, bytes_of_mut};
use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot};
use serde::{Deserialize, Serialize};

/// Inputs of ticks from 0 on, of a period without a gap.
#[derive(Debug, Clone, Default)]
pub struct PatchInputs {
    /// Each tick.
    pub ticks: Vec<PatchTick>,
}

/// Inputs of a tick.
#[derive(Debug, Clone)]
pub struct PatchTick {
    /// One a probe.
    pub samples: Vec<Option<Sample>>,
    /// Incarnation of the station; 0 for none.
    pub station: u64,
    /// Chunks that arrived since the tick before.
    pub chunks: Vec<InboxChunk>,
}

/// Bytes that are no inputs of this build.
#[derive(Debug, thiserror::Error)]
#[error("the bundled recording of inputs does not fit this build")]
pub struct InputsError;

/// A tick as it is stored: each chunk without the zeros at its end.
#[derive(Serialize, Deserialize)]
struct StoredTick {
    samples: Vec<Option<Sample>>,
    station: u64,
    chunks: Vec<Vec<u8>>,
}

impl PatchInputs {
    /// The inputs as bytes.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn to_bytes(&self) -> Result<Vec<u8>, postcard::Error> {
        let stored: Vec<StoredTick> = self.ticks.iter().map(StoredTick::of).collect();
        postcard::to_stdvec(&stored)
    }

    /// The inputs in bytes that [`PatchInputs::to_bytes`] gave.
    ///
    /// # Errors
    /// When they are of another build, or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, InputsError> {
        let stored: Vec<StoredTick> = postcard::from_bytes(bytes).map_err(|_| InputsError)?;
        let ticks = stored.iter().map(StoredTick::tick);
        let ticks = ticks.collect::<Option<_>>().ok_or(InputsError)?;
        Ok(Self { ticks })
    }
}

impl StoredTick {
    fn of(tick: &PatchTick) -> Self {
        let chunk = |chunk: &InboxChunk| {
            let mut bytes = [bytes_of(&chunk.header), bytes_of(&chunk.slots)].concat();
            let used = bytes.iter().rposition(|&byte| byte != 0);
            bytes.truncate(used.map_or(0, |last| last + 1));
            bytes
        };
        Self {
            samples: tick.samples.clone(),
            station: tick.station,
            chunks: tick.chunks.iter().map(chunk).collect(),
        }
    }

    fn tick(&self) -> Option<PatchTick> {
        let chunks = self.chunks.iter().map(|bytes| {
            let mut header = ChunkHeader::zeroed();
            let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
            let (of_header, of_slots) = bytes.split_at(bytes.len().min(size_of::<ChunkHeader>()));
            bytes_of_mut(&mut header)
                .get_mut(..of_header.len())?
                .copy_from_slice(of_header);
            bytes_of_mut(&mut slots)
                .get_mut(..of_slots.len())?
                .copy_from_slice(of_slots);
            Some(InboxChunk { header, slots })
        });
        Some(PatchTick {
            samples: self.samples.clone(),
            station: self.station,
            chunks: chunks.collect::<Option<_>>()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;
    use glam::DVec3;

    #[test]
    fn inputs_come_back_as_they_were_and_other_bytes_are_refused() {
        let mut chunk = InboxChunk {
            header: ChunkHeader::zeroed(),
            slots: [ChunkSlot::zeroed(); CHUNK_SLOTS],
        };
        chunk.header.client = 7;
        bytes_of_mut(&mut chunk.slots)[100] = 3;
        let tick = PatchTick {
            samples: vec![None, Some(Sample::at(Pose::at(DVec3::new(0.1, -2.0, 3.5))))],
            station: 100,
            chunks: vec![chunk; 2],
        };
        let inputs = PatchInputs {
            ticks: vec![tick; 3],
        };
        let bytes = inputs.to_bytes().unwrap();
        let back = PatchInputs::from_bytes(&bytes).unwrap();
        assert_eq!(back.ticks.len(), 3);
        for (a, b) in inputs.ticks.iter().zip(&back.ticks) {
            assert_eq!((&a.samples, a.station), (&b.samples, b.station));
            for (a, b) in a.chunks.iter().zip(&b.chunks) {
                assert_eq!(bytes_of(&a.header), bytes_of(&b.header));
                assert_eq!(bytes_of(&a.slots), bytes_of(&b.slots));
            }
        }
        assert!(PatchInputs::from_bytes(&bytes[..bytes.len() - 1]).is_err());
        assert!(PatchInputs::from_bytes(b"no inputs").is_err());
    }
}
