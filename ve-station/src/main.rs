//! The command `ve-station`: see `ve-station --help`.

mod cli;
mod link;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
