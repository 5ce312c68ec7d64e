//! Arguments of the commands about public data sets.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Where sequences are put and looked for when no folder is named.
pub(crate) const FOLDER: &str = "data";

/// Sequences of public data sets: which are known, and how to get them.
///
/// They are those of bench --suite: people and things move in them, and figures of other systems are
/// published on them. They are not part of this program: each data set has its own page and licence.
#[derive(Debug, Subcommand)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint datasets list
  stillpoint datasets pull fr3_walking_xyz
  stillpoint datasets pull bonn ~/data
  stillpoint bench --suite tum-dynamic --pull"
)]
pub(crate) enum DatasetsCommand {
    List(ListArgs),
    Pull(PullArgs),
}

/// List the sequences that are known, with the pages and licences of their data sets.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint datasets list"
)]
pub(crate) struct ListArgs {}

/// Get a sequence, or all of a suite, from the data set's official page.
///
/// Address, licence and size are shown before the download. One that breaks off, or that Ctrl-C ends, is kept
/// and resumed the next time. Its SHA-256 is kept beside the folder, and later downloads are
/// compared with it. The archive is unpacked, and removed once the folder is in its place; a sequence
/// that is there already is left as it is.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint datasets pull fr3_walking_xyz
  stillpoint datasets pull rgbd_bonn_crowd ~/data/bonn
  stillpoint datasets pull tum-dynamic ~/data/tum
  HTTPS_PROXY=http://proxy:3128 stillpoint datasets pull bonn_balloon

Exit code 1 when Ctrl-C ended it; 2 when a sequence could not be had."
)]
pub(crate) struct PullArgs {
    /// Name of a sequence or suite: see datasets list.
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    /// Folder to put it in.
    #[arg(value_name = "DIR", default_value = FOLDER)]
    pub(crate) dir: PathBuf,
    /// Server with the same paths to get it from, instead of the official one.
    #[arg(long, value_name = "URL")]
    pub(crate) mirror: Option<String>,
}
