//! The program `stillpoint` for end-to-end tests.

use std::process::ExitCode;

fn main() -> ExitCode {
    stillpoint_cli::run(std::env::args_os().collect()).into()
}
