//! The recording of a run: how much of it is kept, and where.

use crate::bytes::parse_bytes;
use crate::limits::{DEFAULT_KEEP_BYTES, MIN_KEEP_BYTES};
use crate::plan::RecordPlan;
use crate::source::{SceneError, Source};
use crate::typed::RecordTyped;

/// Checks the table `[record]`.
pub(super) fn record_plan(source: &Source, typed: &RecordTyped) -> Result<RecordPlan, SceneError> {
    let keep_bytes = match &typed.keep {
        None => Some(DEFAULT_KEEP_BYTES),
        Some(keep) if keep.get_ref() == "off" => None,
        Some(keep) => {
            let bytes = parse_bytes(keep.get_ref())
                .map_err(|sentence| source.value(keep, &format!("keep: {sentence}, or \"off\"")))?;
            let bytes = bytes as u64;
            if bytes < MIN_KEEP_BYTES {
                let least = MIN_KEEP_BYTES >> 20;
                let sentence = format!(
                    "keep is {bytes} bytes; write at least {least}MiB, or \"off\" to record nothing"
                );
                return Err(source.value(keep, &sentence));
            }
            Some(bytes)
        }
    };
    let path = typed.path.as_ref().map(|path| source.path(path));
    Ok(RecordPlan { keep_bytes, path })
}
