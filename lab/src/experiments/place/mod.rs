//! Ways of recognising places, compared, and the training of the vocabulary that is embedded.

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

/// Ways of recognising places, compared, and the training of the vocabulary that is embedded.
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
