//! A map from ids to slots of fixed capacity: open addressing, no tombstones, no growth.
//!
//! The maps of the standard library rehash now and then, which is a late tick; this one never moves
//! more than the run behind a removed entry.

use spm::NONE;

/// Key of a map.
pub trait Id: Copy + Eq {
    /// Marks a free place; no id.
    const NONE: Self;

    /// All its bits.
    fn bits(self) -> u64;
}

impl Id for u32 {
    const NONE: Self = NONE;

    fn bits(self) -> u64 {
        u64::from(self)
    }
}

/// Ids to values.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct IdMap<I> {
    /// Pairs of id and value; the id is [`Id::NONE`] where free. The length is a power of two.
    entries: Vec<(I, u32)>,
    count: usize,
}

impl<I: Id> IdMap<I> {
    /// Bytes for each entry it may hold.
    pub const BYTES_PER_ENTRY: usize = 2 * 2 * size_of::<(I, u32)>();

    /// Room for `capacity` entries, at most half full.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        let length = (2 * capacity.max(1)).next_power_of_two();
        Self {
            entries: vec![(I::NONE, 0); length],
            count: 0,
        }
    }

    fn home(&self, id: I) -> usize {
        // Fibonacci hashing: ids are dense, neighbours must not cluster.
        let hash = id.bits().wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (hash >> 32) as usize & (self.entries.len() - 1)
    }

    fn find(&self, id: I) -> Result<usize, usize> {
        let mask = self.entries.len() - 1;
        let mut k = self.home(id);
        // Ends: at least half of the entries are free.
        loop {
            match self.entries[k].0 {
                // First: the mark of a free place is no id, whoever asks for it.
                found if found == I::NONE => return Err(k),
                found if found == id => return Ok(k),
                _ => k = (k + 1) & mask,
            }
        }
    }

    /// The value of an id.
    #[must_use]
    pub fn get(&self, id: I) -> Option<u32> {
        self.find(id).ok().map(|k| self.entries[k].1)
    }

    /// Adds an id that is not there.
    pub fn insert(&mut self, id: I, value: u32) {
        assert!(
            2 * (self.count + 1) <= self.entries.len(),
            "the id map is sized for every slot"
        );
        match self.find(id) {
            Ok(_) => unreachable!("an id is loaded once"),
            Err(k) => self.entries[k] = (id, value),
        }
        self.count += 1;
    }

    /// Removes an id; closes the gap by moving later entries of the run back.
    pub fn remove(&mut self, id: I) {
        let Ok(mut gap) = self.find(id) else {
            return;
        };
        let mask = self.entries.len() - 1;
        self.count -= 1;
        let mut k = gap;
        loop {
            k = (k + 1) & mask;
            let (other, _) = self.entries[k];
            if other == I::NONE {
                break;
            }
            // The entry may move back only if its home does not lie behind the gap.
            let from_home = k.wrapping_sub(self.home(other)) & mask;
            let from_gap = k.wrapping_sub(gap) & mask;
            if from_home >= from_gap {
                self.entries[gap] = self.entries[k];
                gap = k;
            }
        }
        self.entries[gap].0 = I::NONE;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        #[test]
        fn equals_a_library_map(operations in prop::collection::vec((0u32..64, any::<bool>()), 0..400)) {
            let mut ours = IdMap::new(64);
            let mut theirs = BTreeMap::new();
            for (k, (id, add)) in operations.into_iter().enumerate() {
                if add && !theirs.contains_key(&id) {
                    ours.insert(id, k as u32);
                    theirs.insert(id, k as u32);
                } else if !add {
                    ours.remove(id);
                    theirs.remove(&id);
                }
                for id in 0..64 {
                    prop_assert_eq!(ours.get(id), theirs.get(&id).copied());
                }
            }
        }
    }
}
