//! `bench --suite --pull`: downloads missing sequences before any is run.

use super::catalogue::Suite;
use super::find::look_in;
use crate::args::BenchArgs;
use crate::args::datasets::FOLDER;
use crate::datasets::catalogue::Sequence;
use crate::datasets::pull::missing as get;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use std::path::PathBuf;

pub(super) fn folders(args: &BenchArgs) -> Vec<PathBuf> {
    match args.paths.is_empty() {
        true => vec![PathBuf::from(FOLDER)],
        false => args.paths.clone(),
    }
}

/// Downloads the sequences that are in none of the folders into the first of them.
///
/// # Errors
/// The first failed download; running the command again resumes there.
pub(super) fn missing(
    suite: Suite,
    args: &BenchArgs,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let folders = folders(args);
    let here: Vec<PathBuf> = folders.iter().filter(|f| f.exists()).cloned().collect();
    let found = look_in(suite, &here)?;
    let is_missing = |s: Sequence| !found.iter().any(|f| f.known == s.known && f.path.is_some());
    let mirror = args.mirror.as_deref();
    get(suite, is_missing, (&folders[0], mirror), interrupt)
}
