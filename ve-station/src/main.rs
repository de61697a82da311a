//! The command `ve-station`: see `ve-station --help`.

mod cli;
mod logging;

use std::process::ExitCode;

fn main() -> ExitCode {
    logging::start();
    cli::main()
}
