//! Scale: rooms, images and rates, and maps.

mod maps;
mod rooms;

use crate::Failure;
use std::process::ExitCode;

/// Measures accuracy over room size, resolution and frame rate, and time and memory of solvers over map size
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    of: Of,
}

#[derive(clap::Subcommand)]
enum Of {
    /// Accuracy over room size, resolution and frame rate
    Rooms(rooms::Arguments),
    /// Time and memory of bundle adjustment and pose graphs on synthetic maps
    Maps(maps::Arguments),
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    match &arguments.of {
        Of::Rooms(arguments) => rooms::run(arguments),
        Of::Maps(arguments) => maps::run(arguments),
    }
}
