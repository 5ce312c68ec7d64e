//! Arguments of the data set commands.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Default folder for sequences.
pub(crate) const FOLDER: &str = "data";

/// List or download sequences of public data sets.
///
/// These are the sequences of bench --suite: they contain moving people and objects, and results of other systems on them are published.
/// They are not part of this program: each data set has its own page and licence.
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

/// List the known sequences with the pages and licences of their data sets.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint datasets list"
)]
pub(crate) struct ListArgs {}

/// Download a sequence, or all of a suite, from the data set's official page.
///
/// Address, licence and size are shown before the download. An interrupted download (also by Ctrl-C) is kept and resumed the next time. The
/// SHA-256 of the archive is stored beside the folder, and later downloads are compared with it. The archive is unpacked, and removed once
/// the folder is in place; a sequence that already exists is left unchanged.
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
    /// Destination folder.
    #[arg(value_name = "DIR", default_value = FOLDER)]
    pub(crate) dir: PathBuf,
    /// Mirror with the same paths, instead of the official server.
    #[arg(long, value_name = "URL")]
    pub(crate) mirror: Option<String>,
}
