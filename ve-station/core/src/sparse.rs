//! Values by id, most of which are zero: only pages with another value are kept, so that what a
//! client holds costs memory by what it holds and not by the model.

use crate::tuning::service::PAGE;

#[derive(Debug, Clone)]
struct Page<T> {
    values: [T; PAGE],
    /// Values that are not zero.
    used: u32,
}

/// Values by id; zero where none was set.
#[derive(Debug, Clone, Default)]
pub struct Sparse<T> {
    pages: Vec<Option<Box<Page<T>>>>,
}

impl<T: Copy + Default + PartialEq> Sparse<T> {
    /// The value at a place.
    pub fn get(&self, at: u32) -> T {
        let page = self.pages.get(at as usize / PAGE);
        page.and_then(Option::as_ref)
            .map_or_else(T::default, |page| page.values[at as usize % PAGE])
    }

    /// Sets the value at a place. A page of zeros is given back.
    pub fn set(&mut self, at: u32, value: T) {
        let number = at as usize / PAGE;
        let is_used = value != T::default();
        if self.pages.len() <= number {
            if !is_used {
                return;
            }
            self.pages.resize_with(number + 1, || None);
        }
        let place = &mut self.pages[number];
        if place.is_none() && !is_used {
            return;
        }
        let page = place.get_or_insert_with(|| {
            Box::new(Page {
                values: [T::default(); PAGE],
                used: 0,
            })
        });
        let before = std::mem::replace(&mut page.values[at as usize % PAGE], value);
        page.used += u32::from(is_used);
        page.used -= u32::from(before != T::default());
        if page.used == 0 {
            *place = None;
        }
    }

    /// The first place from `at` on whose value is not zero, and the value.
    pub fn next_used(&self, at: u32) -> Option<(u32, T)> {
        let mut at = at as usize;
        while let Some(place) = self.pages.get(at / PAGE) {
            let Some(page) = place else {
                at = (at / PAGE + 1) * PAGE;
                continue;
            };
            let values = page.values[at % PAGE..].iter();
            match values.clone().position(|&value| value != T::default()) {
                Some(found) => {
                    at += found;
                    return Some((at as u32, page.values[at % PAGE]));
                }
                None => at = (at / PAGE + 1) * PAGE,
            }
        }
        None
    }

    /// Bytes kept for values.
    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        self.pages.iter().flatten().count() * size_of::<Page<T>>()
    }
}

/// A set of ids.
#[derive(Debug, Clone, Default)]
pub struct IdSet(Sparse<u64>);

impl IdSet {
    /// Puts an id in; whether it was not there yet.
    pub fn insert(&mut self, id: u32) -> bool {
        let word = self.0.get(id / 64);
        let with = word | 1 << (id % 64);
        self.0.set(id / 64, with);
        with != word
    }

    /// The least id from `from` on.
    pub fn next(&self, from: u32) -> Option<u32> {
        let rest = self.0.get(from / 64) >> (from % 64);
        if rest != 0 {
            return Some(from + rest.trailing_zeros());
        }
        let (at, word) = self.0.next_used(from / 64 + 1)?;
        Some(64 * at + word.trailing_zeros())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

    proptest! {
        #[test]
        fn it_is_a_map_without_zeros(steps in prop::collection::vec((0u32..3000, 0u32..3), 0..200)) {
            let (mut sparse, mut map) = (Sparse::<u32>::default(), BTreeMap::new());
            for (at, value) in steps {
                sparse.set(at, value);
                map.insert(at, value);
                map.retain(|_, &mut value| value != 0);
                prop_assert_eq!(sparse.get(at), value);
                let next = |at| map.range(at..).next().map(|(&k, &v)| (k, v));
                prop_assert_eq!(sparse.next_used(at / 2), next(at / 2));
                let pages: BTreeSet<u32> = map.keys().map(|&k| k / PAGE as u32).collect();
                prop_assert_eq!(sparse.bytes(), pages.len() * size_of::<Page<u32>>());
            }
        }

        #[test]
        fn it_is_a_set_in_its_order(ids in prop::collection::vec(0u32..200_000, 0..100)) {
            let (mut set, mut truth) = (IdSet::default(), BTreeSet::new());
            for id in ids {
                prop_assert_eq!(set.insert(id), truth.insert(id));
            }
            let mut from = 0;
            for id in truth {
                prop_assert_eq!(set.next(from), Some(id));
                from = id + 1;
            }
            prop_assert_eq!(set.next(from), None);
        }
    }
}
