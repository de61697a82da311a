//! `hrtc`: the controller alone, with the simulated device.

use hrtc::devices::DeviceRegistry;
use std::process::ExitCode;

/// Counts allocations of the tick's thread.
#[global_allocator]
static ALLOCATOR: realtime::counting_allocator::CountingAllocator =
    realtime::counting_allocator::CountingAllocator;

fn main() -> ExitCode {
    hrtc::cli::main(&DeviceRegistry::new())
}
