//! `--up`: which way is up in the map.

use crate::args::map::direction;
use crate::sink::Output;
use clap::Args;
use stillpoint::slam::Up;

/// What is asked for.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct UpOutput {
    /// Direction away from the floor in the map, roughly [default: as the inertial sensor knows it for --dense, else as the map knows it
    /// that the run begins with, else that of a camera that was held upright at first]. --save-map keeps it.
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
}

impl UpOutput {
    /// As users say.
    pub(crate) fn named(self) -> Option<Up> {
        self.up.and_then(|up| Up::along(&up.into()))
    }
}

impl Output for UpOutput {}
