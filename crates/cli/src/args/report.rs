//! Arguments of `report`.

use clap::Args;
use std::path::PathBuf;

/// Remake the report of a run, or make one of several runs.
///
/// The report is one page that a browser opens without a network: figures, the map in 3D, every frame on a time line, and images of frames.
/// A run writes it as report.html into its result folder. For a folder without one (run --no-report), the page is made from the other
/// files, and has neither map nor images.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint report out/desk
  stillpoint report out/desk out/desk_filter_off --out both.html"
)]
pub(crate) struct ReportArgs {
    /// Result folders; several give one page with all of them.
    #[arg(value_name = "RESULT", required = true)]
    pub(crate) results: Vec<PathBuf>,
    /// File to write [default: report.html in the result folder; comparison.html for several].
    #[arg(long, value_name = "FILE.html")]
    pub(crate) out: Option<PathBuf>,
}
