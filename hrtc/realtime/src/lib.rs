//! Real time on Linux for one loop: its period, the rights and counters of its thread, and an
//! allocator that counts.
//!
//! | module | contents |
//! |---|---|
//! | [`pacer`] | [`Pacer`](pacer::Pacer): absolute deadlines, skipped periods and their reasons |
//! | [`rights`] | priority, locked memory, core and wake-up latency; clocks and counters |
//! | [`interrupts`] | devices that interrupt the core of a loop |
//! | [`loop_cores`] | the cores that a process may use for its loop |
//! | [`slow_thread`] | a thread as on a slower machine, for tests |
//! | [`core_claim`] | a core that two loops must not share |
//! | [`counting_allocator`] | allocations and frees of a thread, counted |
//!
//! # Example
//! Three periods of 1 ms without any right. A right changes the delay of a wake-up, not its
//! meaning.
//! ```
//! use realtime::pacer::Pacer;
//!
//! let mut pacer = Pacer::new(1000.0, 0);
//! let mut next_tick = 0;
//! for _ in 0..3 {
//!     let wake = pacer.wait();
//!     assert_eq!(wake.tick, next_tick + u64::from(wake.skipped));
//!     next_tick = wake.tick + 1;
//!     // The work of the tick stands here.
//!     let worked = pacer.done();
//!     assert!(worked.page_faults < 1000);
//! }
//! assert!(next_tick >= 3);
//! ```

pub mod core_claim;
pub mod counting_allocator;
pub mod interrupts;
pub mod loop_cores;
pub mod pacer;
pub mod rights;
pub mod slow_thread;
