//! All recordings of a batch, as they stand in `batch.json`, and a recording as it is shown.

use crate::args::batch::Shard;
use crate::batch::row::{Method, Outcome, Row};
use crate::failure::Failure;
use crate::machine::Machine;
use serde::{Deserialize, Serialize};
use std::path::Path;
use stillpoint::evaluation::Table;

/// Its name in the folder of a batch.
pub(crate) const FILE: &str = "batch.json";

/// The file `batch.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Batch {
    /// What was typed.
    pub(crate) command: String,
    pub(crate) machine: Machine,
    #[serde(flatten)]
    pub(crate) method: Method,
    /// Which share of the recordings it is, where it is one.
    pub(crate) shard: Option<ShardJson>,
    /// The folders that it was joined from, where it was.
    pub(crate) merged: Vec<String>,
    /// Whether every recording has a row: not where the batch, or a part of it, ended early or is missing.
    pub(crate) is_complete: bool,
    /// Recordings whose results were there before.
    pub(crate) skipped: usize,
    /// Runs at a time.
    pub(crate) workers: usize,
    /// From the first run to the last, s; of several batches, their sum.
    pub(crate) seconds: f64,
    /// In the order of names.
    pub(crate) recordings: Vec<Row>,
}

/// One share of the recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct ShardJson {
    /// Which, from 1 on.
    pub(crate) index: u32,
    /// How many there are.
    pub(crate) of: u32,
}

impl From<Shard> for ShardJson {
    fn from(Shard { index, of }: Shard) -> Self {
        Self { index, of }
    }
}

impl Batch {
    /// Reads that of a folder.
    ///
    /// # Errors
    /// A folder in which there is none, or none of this version.
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

    /// The file.
    ///
    /// # Errors
    /// Rows that cannot be written as JSON.
    pub(crate) fn to_json(&self) -> Result<String, Failure> {
        let text = serde_json::to_string_pretty(self).map_err(Failure::input)?;
        Ok(format!("{text}\n"))
    }

    /// Rows without a result.
    pub(crate) fn failed(&self) -> impl Iterator<Item = &Row> {
        self.recordings
            .iter()
            .filter(|r| r.outcome == Outcome::Failed)
    }

    /// The rows, the worst first.
    pub(crate) fn by_merit(&self) -> Vec<&Row> {
        let mut rows: Vec<&Row> = self.recordings.iter().collect();
        rows.sort_by(|a, b| a.by_merit(b));
        rows
    }

    /// The rows as text.
    pub(crate) fn to_text(&self) -> String {
        let mut table = Table::new(HEADER);
        for row in self.by_merit() {
            table.row(cells(row));
        }
        table.to_text()
    }
}

/// Heads of the columns that are shown.
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

/// A row as it is shown.
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
