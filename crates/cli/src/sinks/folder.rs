//! `--out`: where the result folder lies.

use crate::sink::Output;
use clap::Args;
use std::path::PathBuf;

/// What is asked for.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct FolderOutput {
    /// Result folder [default: out/ and the name of PATH; with _live after a run at camera rate, _replay after replay].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

impl Output for FolderOutput {}
