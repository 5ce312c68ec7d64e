//! The program `stillpoint`: the command line of the library beside it.

use std::process::ExitCode;

fn main() -> ExitCode {
    stillpoint_cli::run(std::env::args_os().collect()).into()
}
