//! The program `stillpoint`, for the end-to-end tests: the command line of the crate beside the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    stillpoint_cli::run(std::env::args_os().collect()).into()
}
