//! What is large: rooms, images and rates, and maps.

mod maps;
mod rooms;

use crate::Failure;
use std::process::ExitCode;

/// Accuracy in rooms, at resolutions and rates of all sizes; time and memory of solvers on maps of all sizes.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    of: Of,
}

#[derive(clap::Subcommand)]
enum Of {
    /// Accuracy over the size of the room, the resolution and the frame rate
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
