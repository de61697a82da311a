//! The command `ve-station`: see `ve-station --help`.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    transport::logging::start();
    cli::main()
}
