//! The command `rt-tests`; see the library for what it does.

use clap::Parser;
use std::process::ExitCode;

/// Counts allocations of the tick's thread, in this build only.
#[global_allocator]
static ALLOCATOR: realtime::counting_allocator::CountingAllocator =
    realtime::counting_allocator::CountingAllocator;

fn main() -> ExitCode {
    let arguments = rt_tests::arguments::Arguments::parse();
    transport::logging::start();
    rt_tests::execute(arguments)
}
