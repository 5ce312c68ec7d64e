//! Output of a batch: `batch.json`, `batch.parquet`, `batch.html`, and its final messages.

use crate::batch::columns::to_parquet;
use crate::batch::page::to_html;
use crate::batch::table::{Batch, FILE};
use crate::console;
use crate::failure::{Failure, Status};
use crate::output;
use std::path::Path;

/// Maximum number of recordings named in a line.
const SAID: usize = 10;

/// Writes all files.
///
/// # Errors
/// A folder that is not writable.
pub(crate) fn write(batch: &Batch, out: &Path) -> Result<(), Failure> {
    let write = |name: &str, bytes: &[u8]| output::write_file(&out.join(name), bytes);
    write("batch.parquet", &to_parquet(&batch.recordings)?)?;
    write("batch.html", to_html(batch).as_bytes())?;
    write(FILE, batch.to_json()?.as_bytes())
}

/// Prints the table, or JSON, and names the recordings without a result.
///
/// # Errors
/// Rows that cannot be encoded as JSON.
pub(crate) fn print(batch: &Batch, out: &Path, as_json: bool) -> Result<Status, Failure> {
    if as_json {
        console::print(&batch.to_json()?);
    } else {
        console::report(&format!(
            "{}\nwritten to {}: {FILE}, batch.parquet, batch.html\n",
            batch.to_text(),
            out.display()
        ));
    }
    let failed: Vec<&str> = batch.failed().map(|r| r.name.as_str()).collect();
    if !failed.is_empty() {
        let more = match failed.len().saturating_sub(SAID) {
            0 => String::new(),
            n => format!(" and {n} more, see {FILE}"),
        };
        console::line(&format!(
            "{} of {} without a result: {}{more}",
            console::counted(failed.len(), "recording"),
            batch.recordings.len(),
            failed[..failed.len().min(SAID)].join(", "),
        ));
    }
    Ok(if failed.is_empty() && batch.is_complete {
        Status::Ok
    } else {
        Status::Failed
    })
}
