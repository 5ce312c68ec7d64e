//! `lab EXPERIMENT`: what Stillpoint's methods are worth, measured.

mod experiments;
mod table;

use clap::{Parser, Subcommand};
use experiments::readout;
use std::process::ExitCode;

/// Whatever ends a command before its result is there.
pub(crate) type Failure = Box<dyn std::error::Error>;

#[derive(Parser)]
#[command(name = "lab", about, version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Readout(readout::Arguments),
}

fn run(command: &Command) -> Result<ExitCode, Failure> {
    match command {
        Command::Readout(arguments) => readout::run(arguments),
    }
}

fn main() -> ExitCode {
    match run(&Arguments::parse().command) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("lab: {error}");
            ExitCode::from(2)
        }
    }
}
