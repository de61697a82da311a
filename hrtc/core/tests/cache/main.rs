//! What a cache allocates, by an allocator that counts bytes.

use hrtc_core::cache::Cache;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    // A constant start value and no destructor: reading it never allocates.
    static HELD: Cell<isize> = const { Cell::new(0) };
}

/// The system's allocator; the bytes that each thread holds are counted.
struct ByteCountingAllocator;

#[global_allocator]
static ALLOCATOR: ByteCountingAllocator = ByteCountingAllocator;

fn count(bytes: usize, sign: isize) {
    HELD.set(HELD.get() + sign * bytes as isize);
}

// SAFETY: every call goes unchanged to the system's allocator, which keeps the contract; counting
// neither allocates nor unwinds.
unsafe impl GlobalAlloc for ByteCountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 1);
        // SAFETY: the caller's layout, unchanged.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 1);
        // SAFETY: the caller's layout, unchanged.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(layout.size(), -1);
        count(size, 1);
        // SAFETY: the caller's pointer, layout and size, unchanged.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(layout.size(), -1);
        // SAFETY: the caller's pointer and layout, unchanged.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Bytes that a cache of a size holds beside the cache itself.
fn held_by(bytes: usize) -> isize {
    let before = HELD.get();
    let cache = Cache::new(bytes);
    let held = HELD.get() - before;
    assert_eq!(cache.bytes(), bytes);
    held
}

/// So whatever is in use of it, it is no more than its bytes: `Cache::bytes_used` counts the places
/// of tables that are larger than that together, and is capped.
#[test]
fn a_cache_allocates_as_much_as_it_is_given_and_no_more() {
    // The least tables, geomorphs and the bounds of quarters, whatever its size.
    let fixed = held_by(0);
    for bytes in [64 << 10, 240 << 10, 1_000_003, 2 << 20, 16 << 20, 100 << 20] {
        let held = held_by(bytes) - fixed;
        println!("{bytes} bytes: {held}, and {fixed} in any case");
        let given = bytes as isize;
        assert!(held <= given, "{held} of {given} bytes");
        assert!(held >= given / 2, "{held} of {given} bytes");
    }
}
