//! An allocator that counts the calls of a thread: the proof that a tick allocates nothing.
//!
//! ```
//! use realtime::counting_allocator::{self, CountingAllocator};
//!
//! #[global_allocator]
//! static ALLOCATOR: CountingAllocator = CountingAllocator;
//!
//! let calls = counting_allocator::count(|| drop(Box::new(1)));
//! assert_eq!(calls, 2); // one allocation, one free
//! ```

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    // Constant start values and no destructor: reading them never allocates.
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, with the calls of armed threads counted. Use as `#[global_allocator]`.
#[derive(Debug, Clone, Copy, Default)]
pub struct CountingAllocator;

/// Starts or stops counting on this thread.
pub fn arm(on: bool) {
    ARMED.with(|armed| armed.set(on));
}

/// Allocations, reallocations and frees of this thread while armed, since its start; 0 when another
/// allocator is in use.
#[must_use]
pub fn calls() -> u64 {
    CALLS.with(Cell::get)
}

/// Calls that `work` makes on this thread.
pub fn count<T>(work: impl FnOnce() -> T) -> u64 {
    let before = calls();
    arm(true);
    work();
    arm(false);
    calls() - before
}

fn note() {
    ARMED.with(|armed| {
        if armed.get() {
            CALLS.with(|calls| calls.set(calls.get() + 1));
        }
    });
}

// SAFETY: every call goes unchanged to the system's allocator, which keeps the contract; counting
// neither allocates nor unwinds.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: the caller's layout, unchanged.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: the caller's layout, unchanged.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note();
        // SAFETY: the caller's pointer, layout and size, unchanged.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        note();
        // SAFETY: the caller's pointer and layout, unchanged.
        unsafe { System.dealloc(pointer, layout) }
    }
}
