//! The row of a recording: `recording.json` in its result folder, and a row in the table of the batch.

use crate::batch::digest::InputDigest;
use crate::batch::inputs::Item;
use crate::failure::Failure;
use crate::output;
use crate::run::summary::{ScoreJson, Summary};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// File name in a result folder. Written after the result and removed before a new run: its presence means that the result is complete.
const FILE: &str = "recording.json";

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Outcome {
    Failed,
    /// There is a result, with lost frames.
    Lost,
    Ok,
}

/// Program and configuration of a batch.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Method {
    pub(crate) stillpoint: String,
    pub(crate) program_sha256: String,
    pub(crate) configuration_sha256: String,
}

/// One recording. The field names are the columns of `batch.parquet`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) name: String,
    /// The recording, as given by the user.
    pub(crate) input: String,
    /// The result folder, relative to the table.
    pub(crate) folder: String,
    pub(crate) outcome: Outcome,
    /// Why there is no result.
    pub(crate) error: Option<String>,
    pub(crate) attempts: u32,
    /// Duration of the last run, from start to end of its process, s.
    pub(crate) seconds: f64,
    pub(crate) input_bytes: u64,
    #[serde(flatten)]
    pub(crate) figures: Figures,
    pub(crate) input_sha256: String,
    #[serde(flatten)]
    pub(crate) method: Method,
}

#[derive(Clone, Debug)]
pub(crate) struct Job {
    pub(crate) item: Item,
    /// Its row, still without a result.
    pub(crate) row: Row,
}

/// Results of a run; all `None` where there is none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    pub(crate) frames: Option<u64>,
    /// Frames that could not be read.
    pub(crate) skipped: Option<u64>,
    pub(crate) tracked: Option<u64>,
    pub(crate) tracked_share: Option<f64>,
    /// Number of intervals without a pose.
    pub(crate) lost_stretches: Option<u64>,
    pub(crate) submaps: Option<u64>,
    pub(crate) keyframes: Option<u64>,
    pub(crate) landmarks: Option<u64>,
    pub(crate) loops: Option<u64>,
    /// RMSE of the final poses, or of the drift where the ground truth stands still, m; with ground truth.
    pub(crate) ate_rmse: Option<f64>,
    /// RMSE of the relative error over 1 s, m; with ground truth.
    pub(crate) rpe_rmse: Option<f64>,
    pub(crate) peak_memory_bytes: Option<u64>,
}

/// Rounds to 9 decimals (nanometres, nanoseconds), which survive a round trip through a file exactly, so that the row does not change each
/// time it is read.
pub(crate) fn rounded(x: f64) -> f64 {
    (x * 1e9).round() / 1e9
}

impl From<&Summary> for Figures {
    fn from(s: &Summary) -> Self {
        let (ate, rpe) = match s.accuracy.as_ref().map(|a| &a.final_poses) {
            Some(ScoreJson::Moving(m)) => {
                (Some(m.ate.rmse), m.rpe.as_ref().map(|r| r.translation.rmse))
            }
            Some(ScoreJson::Fixed(f)) => (Some(f.drift.rmse), None),
            None => (None, None),
        };
        let tracking = &s.tracking;
        Self {
            frames: Some(tracking.frames as u64),
            skipped: Some(tracking.skipped as u64),
            tracked: Some(tracking.tracked as u64),
            tracked_share: Some(rounded(
                tracking.tracked as f64 / tracking.frames.max(1) as f64,
            )),
            lost_stretches: Some(tracking.lost.len() as u64),
            submaps: Some(tracking.submaps.len() as u64),
            keyframes: Some(s.map.keyframes as u64),
            landmarks: Some(s.map.landmarks as u64),
            loops: Some(s.stages.loops.closed.into()),
            ate_rmse: ate.map(rounded),
            rpe_rmse: rpe.map(rounded),
            peak_memory_bytes: s.pace.peak_memory_bytes,
        }
    }
}

impl Row {
    pub(crate) fn new(item: &Item, input: &InputDigest, method: &Method) -> Self {
        Self {
            name: item.name.clone(),
            input: item.path.display().to_string(),
            folder: item.name.clone(),
            outcome: Outcome::Failed,
            error: None,
            attempts: 0,
            seconds: 0.0,
            input_bytes: input.bytes,
            figures: Figures::default(),
            input_sha256: input.sha256.clone(),
            method: method.clone(),
        }
    }

    /// Reads the row of a complete result; `None` where there is none.
    pub(crate) fn read(folder: &Path) -> Option<Self> {
        let text = std::fs::read_to_string(folder.join(FILE)).ok()?;
        serde_json::from_str(&text).ok()
    }

    /// Marks the result in a folder as complete.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(self).map_err(Failure::input)?;
        output::write_file(&folder.join(FILE), format!("{text}\n").as_bytes())
    }

    /// Marks the result in a folder as incomplete, before it is replaced.
    pub(crate) fn remove(folder: &Path) -> std::io::Result<()> {
        match std::fs::remove_file(folder.join(FILE)) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(e),
            _ => Ok(()),
        }
    }

    /// Orders the worst first: without a result, then by the share of frames without a pose, then by error.
    pub(crate) fn by_merit(&self, other: &Self) -> std::cmp::Ordering {
        let key = |r: &Self| {
            let ate = r.figures.ate_rmse.unwrap_or(0.0);
            (r.outcome, r.figures.tracked_share.unwrap_or(0.0), -ate)
        };
        let (a, b) = (key(self), key(other));
        a.0.cmp(&b.0)
            .then(a.1.total_cmp(&b.1))
            .then(a.2.total_cmp(&b.2))
            .then_with(|| self.name.cmp(&other.name))
    }

    pub(crate) fn words(&self) -> String {
        let f = &self.figures;
        let (Some(frames), Some(share)) = (f.frames, f.tracked_share) else {
            return self.error.clone().unwrap_or_default();
        };
        let ate = f
            .ate_rmse
            .map_or_else(String::new, |m| format!(", ATE {:.1} mm", m * 1e3));
        format!(
            "{frames} frames, {:.1} % tracked{ate}, {:.1} s",
            share * 100.0,
            self.seconds
        )
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn row(name: &str, outcome: Outcome, share: Option<f64>, ate: Option<f64>) -> Row {
        let item = Item {
            path: format!("/r/{name}").into(),
            name: name.to_owned(),
        };
        let input = InputDigest {
            sha256: format!("of {name}"),
            bytes: 1000,
        };
        let method = Method {
            stillpoint: "1.2.3".to_owned(),
            program_sha256: "p".to_owned(),
            configuration_sha256: "c".to_owned(),
        };
        Row {
            outcome,
            error: share.is_none().then(|| "a | <reason>".to_owned()),
            attempts: 1,
            seconds: 1.5,
            figures: Figures {
                frames: share.map(|_| 100),
                tracked_share: share,
                ate_rmse: ate,
                ..Figures::default()
            },
            ..Row::new(&item, &input, &method)
        }
    }

    #[test]
    fn rows_sort_worst_first() {
        let mut rows = [
            row("well", Outcome::Ok, Some(1.0), Some(0.01)),
            row("astray", Outcome::Ok, Some(1.0), Some(0.5)),
            row("none", Outcome::Failed, None, None),
            row("half", Outcome::Lost, Some(0.5), Some(0.01)),
            row("blind", Outcome::Ok, Some(1.0), None),
        ];
        rows.sort_by(Row::by_merit);
        let names: Vec<&str> = rows.iter().map(|r| r.name.as_str()).collect();
        assert_eq!(names, ["none", "half", "astray", "well", "blind"]);
    }

    #[test]
    fn numbers_round_trip_through_json() {
        for i in 1..5000 {
            let x = rounded(f64::from(i).sqrt() / 7.0);
            let text = serde_json::to_string(&x).unwrap();
            assert_eq!(serde_json::from_str::<f64>(&text).unwrap(), x, "{text}");
        }
    }

    #[test]
    fn row_round_trips_through_its_file() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(Row::read(dir.path()), None);
        let written = row("a", Outcome::Lost, Some(0.25), None);
        written.write(dir.path()).unwrap();
        assert_eq!(Row::read(dir.path()), Some(written));
        Row::remove(dir.path()).unwrap();
        Row::remove(dir.path()).unwrap();
        assert_eq!(Row::read(dir.path()), None);
        std::fs::write(dir.path().join(FILE), "{half").unwrap();
        assert_eq!(Row::read(dir.path()), None);
    }
}
