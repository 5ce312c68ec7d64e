//! `--json`: the summary on stdout.

use crate::sink::Output;
use clap::Args;

/// What is asked for.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct JsonOutput {
    /// Print the summary as JSON, as it stands in summary.json, and nothing else on stdout.
    #[arg(long)]
    pub(crate) json: bool,
}

impl Output for JsonOutput {}
