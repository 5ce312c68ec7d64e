//! Comparison of place recognition methods, and training of the embedded vocabulary.

mod compare;
mod hamming_tree;
mod judge;
#[path = "../../../../crates/place/tests/recordings/keyframes.rs"]
mod keyframes;
mod method;
mod random_words;
mod train;

use crate::Failure;
use std::process::ExitCode;
use stillpoint::{datasets, features, geometry, imaging, simulator};

/// Compares place recognition methods, and trains the embedded vocabulary
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Compare(compare::Arguments),
    Train(train::Arguments),
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    match &arguments.what {
        What::Compare(arguments) => compare::run(arguments),
        What::Train(arguments) => train::run(arguments),
    }
}
