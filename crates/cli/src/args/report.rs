//! Arguments of `report`.

use clap::Args;
use std::path::PathBuf;

/// Make the report of a run again, or one of several runs.
///
/// The report is one page that a browser opens without a network: figures, the map in three dimensions, every frame on a
/// time line, and pictures of frames. A run writes it as report.html into its result folder. Of a folder without one (run
/// --no-report), the page is made of the other files, and has neither map nor pictures.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint report out/desk
  stillpoint report out/desk out/desk_filter_off --out both.html"
)]
pub(crate) struct ReportArgs {
    /// Result folders; of several, one page with all of them.
    #[arg(value_name = "RESULT", required = true)]
    pub(crate) results: Vec<PathBuf>,
    /// The page [default: report.html in the result folder; comparison.html of several].
    #[arg(long, value_name = "FILE.html")]
    pub(crate) out: Option<PathBuf>,
}
