//! The table of a batch, as in `batch.json`, and its text form.

use crate::args::batch::Shard;
use crate::batch::row::{Method, Outcome, Row};
use crate::failure::Failure;
use crate::machine::Machine;
use serde::{Deserialize, Serialize};
use std::path::Path;
use stillpoint::evaluation::Table;

pub(crate) const FILE: &str = "batch.json";

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Batch {
    pub(crate) command: String,
    pub(crate) machine: Machine,
    #[serde(flatten)]
    pub(crate) method: Method,
    /// The shard, if the batch is one.
    pub(crate) shard: Option<ShardJson>,
    /// The folders that were merged, if any.
    pub(crate) merged: Vec<String>,
    /// Whether every recording has a row: false where the batch or a shard ended early or is missing.
    pub(crate) is_complete: bool,
    /// Number of recordings with an earlier result.
    pub(crate) skipped: usize,
    pub(crate) workers: usize,
    /// Duration from the first run to the last, s; for merged batches, the sum.
    pub(crate) seconds: f64,
    pub(crate) recordings: Vec<Row>,
}

/// One share of the recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct ShardJson {
    /// Index, from 1.
    pub(crate) index: u32,
    /// Number of shards.
    pub(crate) of: u32,
}

impl From<Shard> for ShardJson {
    fn from(Shard { index, of }: Shard) -> Self {
        Self { index, of }
    }
}

impl Batch {
    /// Reads the table of a folder.
    ///
    /// # Errors
    /// No table, or one of another version.
    pub(crate) fn read(folder: &Path) -> Result<Self, Failure> {
        let file = folder.join(FILE);
        let wrong = |found: &dyn std::fmt::Display| {
            Failure::input(format!(
                "{}: expected the table of a batch of this version, found: {found}; a batch writes it when it ends",
                file.display()
            ))
        };
        let text = std::fs::read_to_string(&file).map_err(|e| wrong(&e))?;
        serde_json::from_str(&text).map_err(|e| wrong(&e))
    }

    /// The table as JSON.
    ///
    /// # Errors
    /// Rows that cannot be encoded.
    pub(crate) fn to_json(&self) -> Result<String, Failure> {
        let text = serde_json::to_string_pretty(self).map_err(Failure::input)?;
        Ok(format!("{text}\n"))
    }

    pub(crate) fn failed(&self) -> impl Iterator<Item = &Row> {
        self.recordings
            .iter()
            .filter(|r| r.outcome == Outcome::Failed)
    }

    pub(crate) fn by_merit(&self) -> Vec<&Row> {
        let mut rows: Vec<&Row> = self.recordings.iter().collect();
        rows.sort_by(|a, b| a.by_merit(b));
        rows
    }

    pub(crate) fn to_text(&self) -> String {
        let mut table = Table::new(HEADER);
        for row in self.by_merit() {
            table.row(cells(row));
        }
        table.to_text()
    }
}

/// Headings of the printed columns.
pub(crate) const HEADER: [&str; 9] = [
    "recording",
    "outcome",
    "frames",
    "tracked %",
    "ATE mm",
    "RPE mm",
    "s",
    "peak MB",
    "runs",
];

/// The cells of a row as printed.
pub(crate) fn cells(row: &Row) -> [String; 9] {
    let f = &row.figures;
    let number = |x: Option<f64>, factor: f64, digits: usize| {
        x.map_or_else(|| "-".to_owned(), |x| format!("{:.digits$}", x * factor))
    };
    let outcome = match row.outcome {
        Outcome::Failed => "failed",
        Outcome::Lost => "lost",
        Outcome::Ok => "ok",
    };
    [
        row.name.clone(),
        outcome.to_owned(),
        f.frames.map_or_else(|| "-".to_owned(), |n| n.to_string()),
        number(f.tracked_share, 100.0, 1),
        number(f.ate_rmse, 1e3, 1),
        number(f.rpe_rmse, 1e3, 1),
        format!("{:.1}", row.seconds),
        number(f.peak_memory_bytes.map(|b| b as f64), 1e-6, 0),
        row.attempts.to_string(),
    ]
}
