//! `--json`: the summary on stdout.

use crate::sink::Output;
use clap::Args;

#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct JsonOutput {
    /// Print summary.json and nothing else on stdout.
    #[arg(long)]
    pub(crate) json: bool,
}

impl Output for JsonOutput {}
