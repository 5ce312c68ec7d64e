//! `lab`: experiments on Stillpoint, comparisons of two versions and with other systems, and the tables of the documents (lab/README.md).

mod compare;
mod document;
mod experiments;
mod inputs;
mod markdown;
mod origin;
mod peers;
mod record;
mod results;
mod score;
mod sweep;
mod table;
mod views;

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
    Inputs(inputs::Arguments),
    Sweep(sweep::Arguments),
    Compare(compare::Arguments),
    Peers(peers::Arguments),
    Record(record::Arguments),
    Document(document::Arguments),
    Readout(readout::Arguments),
}

fn run(command: &Command) -> Result<ExitCode, Failure> {
    match command {
        Command::Inputs(arguments) => inputs::list(arguments),
        Command::Sweep(arguments) => sweep::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Peers(arguments) => peers::run(arguments),
        Command::Record(arguments) => record::run(arguments),
        Command::Document(arguments) => document::run(arguments),
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
