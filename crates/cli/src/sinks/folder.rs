//! `--out`: the result folder.

use crate::sink::Output;
use clap::Args;
use std::path::PathBuf;

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct FolderOutput {
    /// Result folder [default: out/ and the name of PATH; with suffix _live for a run at camera rate, _replay for replay].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

impl Output for FolderOutput {}
