//! Closure lists of the held regions: chained blocks in one pool, a cache line each.

use spm::NONE;

const ITEMS: usize = 15;

#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Block {
    items: [u32; ITEMS],
    next: u32,
}

impl Block {
    const UNUSED: Self = Self {
        items: [NONE; ITEMS],
        next: NONE,
    };
}

/// A list in the pool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct List {
    head: u32,
    tail: u32,
    length: u32,
}

impl List {
    /// The empty list.
    pub const EMPTY: Self = Self {
        head: NONE,
        tail: NONE,
        length: 0,
    };

    /// Number of items.
    #[must_use]
    pub fn length(&self) -> u32 {
        self.length
    }
}

/// A place in a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Cursor {
    block: u32,
    index: u32,
}

impl Cursor {
    /// Before the first item of a list.
    #[must_use]
    pub fn start(list: &List) -> Self {
        Self {
            block: list.head,
            index: 0,
        }
    }
}

/// A pool of blocks of fixed size.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct ListPool {
    /// Those that were ever used, so that the room for the others is not written.
    #[serde(with = "spm::reserved")]
    blocks: Vec<Block>,
    /// Blocks that there may be.
    most: u32,
    /// First free block, chained through `next`; blocks from `fresh` on are not in use.
    free: u32,
    fresh: u32,
    used: u32,
    high_water: u32,
}

impl ListPool {
    /// Bytes of a block.
    pub const BYTES_PER_BLOCK: usize = size_of::<Block>();
    /// Items of a block.
    pub const ITEMS_PER_BLOCK: usize = ITEMS;

    /// A pool of `blocks` blocks, which take memory as they are used, unless the process has locked
    /// its memory.
    #[must_use]
    pub fn new(blocks: usize) -> Self {
        Self {
            blocks: Vec::with_capacity(blocks),
            most: blocks as u32,
            free: NONE,
            fresh: 0,
            used: 0,
            high_water: 0,
        }
    }

    /// Frees every list.
    pub fn clear(&mut self) {
        self.free = NONE;
        self.fresh = 0;
        self.used = 0;
    }

    /// Blocks that there are.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.most as usize
    }

    /// Blocks in use.
    #[must_use]
    pub fn used(&self) -> u32 {
        self.used
    }

    /// The most blocks ever in use.
    #[must_use]
    pub fn high_water(&self) -> u32 {
        self.high_water
    }

    /// Whether less than a sixteenth of the blocks is free.
    #[must_use]
    pub fn is_nearly_full(&self) -> bool {
        self.most - self.used < self.most / 16
    }

    /// Appends an item; false when the pool is full.
    #[must_use]
    pub fn push(&mut self, list: &mut List, item: u32) -> bool {
        let index = list.length as usize % ITEMS;
        if index == 0 {
            let id = match self.free {
                NONE if self.fresh == self.most => return false,
                NONE => {
                    if self.fresh as usize == self.blocks.len() {
                        self.blocks.push(Block::UNUSED);
                    }
                    self.fresh += 1;
                    self.fresh - 1
                }
                id => {
                    self.free = self.blocks[id as usize].next;
                    id
                }
            };
            self.blocks[id as usize].next = NONE;
            self.used += 1;
            self.high_water = self.high_water.max(self.used);
            if list.tail == NONE {
                list.head = id;
            } else {
                self.blocks[list.tail as usize].next = id;
            }
            list.tail = id;
        }
        self.blocks[list.tail as usize].items[index] = item;
        list.length += 1;
        true
    }

    /// The place of the last item of a list that is not empty.
    #[must_use]
    pub fn last(list: &List) -> Cursor {
        Cursor {
            block: list.tail,
            index: (list.length - 1) % ITEMS as u32,
        }
    }

    /// The item at a cursor, `None` behind the last. The list must not have grown since the cursor
    /// was made.
    #[must_use]
    pub fn get(&self, list: &List, cursor: Cursor) -> Option<u32> {
        if cursor.block == NONE {
            return None;
        }
        let in_tail = list.length - (list.length - 1) / ITEMS as u32 * ITEMS as u32;
        let items = if cursor.block == list.tail {
            in_tail
        } else {
            ITEMS as u32
        };
        (cursor.index < items)
            .then(|| self.blocks[cursor.block as usize].items[cursor.index as usize])
    }

    /// Replaces the item at a cursor.
    pub fn set(&mut self, cursor: Cursor, item: u32) {
        self.blocks[cursor.block as usize].items[cursor.index as usize] = item;
    }

    /// The next place; behind the last item of the list there is none to get.
    #[must_use]
    pub fn next(&self, cursor: Cursor) -> Cursor {
        let index = cursor.index + 1;
        if (index as usize) < ITEMS {
            return Cursor { index, ..cursor };
        }
        match self.blocks[cursor.block as usize].next {
            NONE => Cursor { index, ..cursor },
            block => Cursor { block, index: 0 },
        }
    }

    /// Frees a list: its blocks go back in one step.
    pub fn free(&mut self, list: &mut List) {
        if list.head != NONE {
            self.used -= (list.length as usize).div_ceil(ITEMS) as u32;
            self.blocks[list.tail as usize].next = self.free;
            self.free = list.head;
        }
        *list = List::EMPTY;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lists_hold_what_was_pushed_and_blocks_come_back(
            lengths in prop::collection::vec(0usize..70, 1..6),
        ) {
            let mut pool = ListPool::new(64);
            for round in 0..3 {
                let mut lists = vec![List::EMPTY; lengths.len()];
                for item in 0..70u32 {
                    for (k, list) in lists.iter_mut().enumerate() {
                        if (item as usize) < lengths[k] {
                            prop_assert!(pool.push(list, item * 10 + round));
                        }
                    }
                }
                for (list, &length) in lists.iter().zip(&lengths) {
                    let mut cursor = Cursor::start(list);
                    for item in 0..length as u32 {
                        prop_assert_eq!(pool.get(list, cursor), Some(item * 10 + round));
                        cursor = pool.next(cursor);
                    }
                    prop_assert_eq!(pool.get(list, cursor), None);
                }
                for list in &mut lists {
                    pool.free(list);
                }
                prop_assert_eq!(pool.used(), 0);
            }
        }
    }

    /// So that a recording's twin, and its keyframes, are as large as what a run has used.
    #[test]
    fn blocks_that_were_never_used_are_not_written() {
        let mut pool = ListPool::new(1 << 16);
        let mut list = List::EMPTY;
        for item in 0..2 * ITEMS as u32 {
            assert!(pool.push(&mut list, item));
        }
        assert_eq!((pool.blocks.len(), pool.capacity()), (2, 1 << 16));
        // Once more the same: nothing is added.
        pool.clear();
        list = List::EMPTY;
        assert!(pool.push(&mut list, 7));
        assert_eq!((pool.blocks.len(), pool.used()), (2, 1));
    }

    #[test]
    fn a_full_pool_says_so() {
        let mut pool = ListPool::new(1);
        let mut list = List::EMPTY;
        for k in 0..ITEMS as u32 {
            assert!(pool.push(&mut list, k));
        }
        assert!(!pool.push(&mut list, 99));
        assert_eq!(list.length(), ITEMS as u32);
    }
}
