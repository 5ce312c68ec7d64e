//! Result files: JSON lines, one per run or table row, appended as they come.
//!
//! An incomplete last line of a killed process is removed, with a message, when the file is opened for appending.

use crate::Failure;
use crate::origin::Machine;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum Line {
    /// Origin of the lines after it.
    Made(Made),
    /// One run.
    Run(Box<Run>),
    /// The head of a table; its rows follow.
    Table(Columns),
    /// A row of the table before it.
    Row { cells: Vec<String> },
}

/// Origin of figures, repeated in each file if one command writes several.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Made {
    pub(crate) command: String,
    /// Commit of the measured program.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) commit: Option<String>,
    /// Machine; absent if the runs have it, or if it was not noted.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) machine: Option<String>,
    /// Such as `0 to 9`; absent if the runs have them, or if not noted.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) seeds: Option<String>,
    /// Copied from a document that predates result files; the commit is the last that changed the figures there.
    #[serde(skip_serializing_if = "std::ops::Not::not", default)]
    pub(crate) from_document: bool,
}

/// The head of a table.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Columns {
    pub(crate) columns: Vec<String>,
    /// Columns of text other than the first; the others are figures.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub(crate) words: Vec<usize>,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct Key {
    pub(crate) input: String,
    pub(crate) variant: String,
    pub(crate) seed: u64,
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub(crate) options: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) frames_at_most: Option<u64>,
    /// The program's hash; the name of a peer.
    pub(crate) program: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Run {
    #[serde(flatten)]
    pub(crate) key: Key,
    pub(crate) commit: String,
    pub(crate) machine: Machine,
    /// Hash of the program that rendered the images; absent for recordings.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) renderer: Option<String>,
    /// Number of parallel runs: with more than one, times mean little.
    pub(crate) jobs: usize,
    /// Duration of the process, s.
    pub(crate) seconds: f64,
    /// Reason for the lack of figures.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) error: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) figures: Option<Figures>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    pub(crate) frames: usize,
    /// Frames without a pose in the trajectory.
    pub(crate) lost: usize,
    /// Frames with a pose and an undecided motion hypothesis; absent for systems without it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) undecided: Option<usize>,
    /// Confident frames with an error above [`crate::score::WRONG`].
    pub(crate) wrong: usize,
    /// The camera stands still in the ground truth: errors are distances from the first pose.
    #[serde(skip_serializing_if = "std::ops::Not::not", default)]
    pub(crate) drift: bool,
    /// RMSE of the final poses after rigid alignment, mm.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) ate_mm: Option<f64>,
    /// RMSE of the poses known at each frame, mm.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) online_ate_mm: Option<f64>,
    /// Maximum error of a final pose, mm.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) worst_mm: Option<f64>,
    /// RMSE of the relative translation over 1 s, mm.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) rpe_mm: Option<f64>,
    /// RMSE of the relative rotation over 1 s, degrees.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) rpe_deg: Option<f64>,
    /// By stage, over the frames in which it ran.
    pub(crate) time_ms: BTreeMap<String, Time>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) memory_bytes: Option<u64>,
    /// Only of live runs.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) live: Option<Live>,
}

/// Milliseconds per frame of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Time {
    pub(crate) median: f64,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) p95: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) p99: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) max: Option<f64>,
}

/// Further figures of a live run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Live {
    /// Share of received frames replaced by a newer one before tracking, 0 to 1.
    pub(crate) dropped_share: f64,
    /// From a frame's arrival to its pose.
    pub(crate) latency_ms: Time,
    /// Frames processed by the detector.
    pub(crate) detections_per_second: f64,
    /// Mean age of the newest known detections, by the stamps of frames.
    pub(crate) detections_age_ms: f64,
}

impl Figures {
    /// Median, ms.
    pub(crate) fn frame_ms(&self) -> Option<f64> {
        self.time_ms.get("frame").map(|t| t.median)
    }
}

/// Omits an incomplete last line.
pub(crate) fn read(path: &Path) -> Result<Vec<Line>, Failure> {
    let bytes = std::fs::read(path)
        .map_err(|e| format!("{}: expected a result file, found: {e}", path.display()))?;
    parse(whole(&bytes), path)
}

fn whole(bytes: &[u8]) -> &[u8] {
    let last = bytes.iter().rposition(|b| *b == b'\n');
    last.map_or(&[], |end| &bytes[..=end])
}

fn parse(bytes: &[u8], path: &Path) -> Result<Vec<Line>, Failure> {
    let text = String::from_utf8_lossy(bytes);
    let line = |(i, text): (usize, &str)| {
        serde_json::from_str(text).map_err(|e| {
            format!(
                "{}:{}: expected a line of a result file (JSON with a field \"kind\"), found: {e}",
                path.display(),
                i + 1
            )
            .into()
        })
    };
    text.lines().enumerate().map(line).collect()
}

#[derive(Debug)]
pub(crate) struct Appended {
    file: std::fs::File,
    path: String,
}

impl Appended {
    /// Returns the existing lines; an incomplete last line is removed with a message.
    pub(crate) fn open(path: &Path) -> Result<(Self, Vec<Line>), Failure> {
        let wrong = |e: std::io::Error| {
            format!(
                "{}: expected a file that lines can be appended to, found: {e}",
                path.display()
            )
        };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(wrong)?;
        }
        let opened = OpenOptions::new().create(true).append(true).open(path);
        let file = opened.map_err(wrong)?;
        let bytes = std::fs::read(path).map_err(wrong)?;
        let kept = whole(&bytes);
        let lines = parse(kept, path)?;
        if kept.len() < bytes.len() {
            eprintln!(
                "{}: the last line was not written to its end and is left out",
                path.display()
            );
            file.set_len(kept.len() as u64).map_err(wrong)?;
        }
        let path = path.display().to_string();
        Ok((Self { file, path }, lines))
    }

    pub(crate) fn push(&mut self, line: &Line) -> Result<(), Failure> {
        let text = serde_json::to_string(line)? + "\n";
        let written = self.file.write_all(text.as_bytes());
        written.map_err(|e| {
            format!(
                "{}: expected to append a line to it, found: {e}; check the free space",
                self.path
            )
            .into()
        })
    }
}

/// The runs of a file. The last line of each run counts.
pub(crate) fn runs(lines: &[Line]) -> Vec<Run> {
    let mut by_key: BTreeMap<Key, Run> = BTreeMap::new();
    let mut order = Vec::new();
    for line in lines {
        if let Line::Run(run) = line
            && by_key
                .insert(run.key.clone(), run.as_ref().clone())
                .is_none()
        {
            order.push(run.key.clone());
        }
    }
    order.iter().filter_map(|key| by_key.remove(key)).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A run with an error, for tests.
    pub(crate) fn run(input: &str, variant: &str, seed: u64, ate_mm: f64) -> Run {
        Run {
            key: Key {
                input: input.to_owned(),
                variant: variant.to_owned(),
                seed,
                options: Vec::new(),
                frames_at_most: None,
                program: "p".to_owned(),
            },
            commit: "c".to_owned(),
            machine: Machine {
                cpu: "m".to_owned(),
                cores: 2,
            },
            renderer: None,
            jobs: 1,
            seconds: 1.0,
            error: None,
            figures: Some(Figures {
                frames: 100,
                ate_mm: Some(ate_mm),
                ..Figures::default()
            }),
        }
    }

    #[test]
    fn incomplete_last_line_is_removed_on_append() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("below/runs.jsonl");
        let line = |seed| Line::Run(Box::new(run("a", "b", seed, 1.5)));
        let (mut file, none) = Appended::open(&path).unwrap();
        assert!(none.is_empty());
        file.push(&line(0)).unwrap();
        file.push(&line(1)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        // The cut may split a character.
        let mut half = text.trim_end().as_bytes()[..text.len() - 20].to_vec();
        half.push(0xC3);
        std::fs::write(&path, &half).unwrap();
        assert_eq!(read(&path).unwrap(), [line(0)]);
        let (mut file, kept) = Appended::open(&path).unwrap();
        assert_eq!(kept, [line(0)]);
        file.push(&line(2)).unwrap();
        assert_eq!(read(&path).unwrap(), [line(0), line(2)]);
    }

    #[test]
    fn invalid_line_is_reported_with_its_number() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("runs.jsonl");
        std::fs::write(&path, "{\"kind\":\"row\",\"cells\":[]}\n{}\n").unwrap();
        let e = read(&path).unwrap_err().to_string();
        assert!(e.contains("runs.jsonl:2: expected"), "{e}");
    }

    #[test]
    fn last_line_of_a_repeated_run_counts() {
        let lines = [1.0, 2.0].map(|ate| Line::Run(Box::new(run("a", "b", 0, ate))));
        let runs = runs(&lines);
        assert_eq!(runs.len(), 1);
        assert_eq!(runs[0].figures.as_ref().unwrap().ate_mm, Some(2.0));
    }
}
