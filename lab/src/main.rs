//! `lab`: experiments on Stillpoint, comparisons, and the tables of the documents (lab/README.md).

mod compare;
mod constants;
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
use experiments::{
    allocations, closing, covariance, crowds, dense, detectors, difficulty, epipolar, frame_time,
    kernels, loops, objects, place, readout, scale, sensors, soak, things,
};
use std::process::ExitCode;

/// Any error of a command.
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
    /// Writes the table of constants, docs/reference/constants.md, from the sources
    Constants(document::Arguments),
    Document(document::Arguments),
    Allocations(allocations::Arguments),
    Closing(closing::Arguments),
    Covariance(covariance::Arguments),
    Crowds(crowds::Arguments),
    Dense(dense::Arguments),
    Detectors(detectors::Arguments),
    Difficulty(difficulty::Arguments),
    Epipolar(epipolar::Arguments),
    #[command(alias = "frame_time")]
    FrameTime(frame_time::Arguments),
    /// Measures the benefit of a gyroscope
    Inertial(sensors::Arguments),
    Kernels(kernels::Arguments),
    Loops(loops::Arguments),
    Objects(objects::Arguments),
    /// Measures the benefit of wheel odometry, correct and faulty
    Odometry(sensors::Arguments),
    Place(place::Arguments),
    Readout(readout::Arguments),
    Scale(scale::Arguments),
    Soak(soak::Arguments),
    Things(things::Arguments),
}

fn run(command: &Command) -> Result<ExitCode, Failure> {
    match command {
        Command::Inputs(arguments) => inputs::list(arguments),
        Command::Sweep(arguments) => sweep::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Peers(arguments) => peers::run(arguments),
        Command::Record(arguments) => record::run(arguments),
        Command::Constants(arguments) => constants::run(arguments),
        Command::Document(arguments) => document::run(arguments),
        Command::Allocations(arguments) => allocations::run(arguments),
        Command::Closing(arguments) => closing::run(arguments),
        Command::Covariance(arguments) => covariance::run(arguments),
        Command::Crowds(arguments) => crowds::run(arguments),
        Command::Dense(arguments) => dense::run(arguments),
        Command::Detectors(arguments) => detectors::run(arguments),
        Command::Difficulty(arguments) => difficulty::run(arguments),
        Command::Epipolar(arguments) => epipolar::run(arguments),
        Command::FrameTime(arguments) => frame_time::run(arguments),
        Command::Inertial(arguments) => sensors::run::<sensors::Inertial>(arguments),
        Command::Kernels(arguments) => kernels::run(arguments),
        Command::Loops(arguments) => loops::run(arguments),
        Command::Objects(arguments) => objects::run(arguments),
        Command::Odometry(arguments) => sensors::run::<sensors::Odometry>(arguments),
        Command::Place(arguments) => place::run(arguments),
        Command::Readout(arguments) => readout::run(arguments),
        Command::Scale(arguments) => scale::run(arguments),
        Command::Soak(arguments) => soak::run(arguments),
        Command::Things(arguments) => things::run(arguments),
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
