//! Result files: JSON lines, one per run or per row of a table, appended as they come. Every line says what kind it is.
//!
//! A process that is killed while it writes leaves a last line without its end. It is cut off when the file is opened to be gone on with, and said.

use crate::Failure;
use crate::origin::Machine;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

/// A line of a result file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum Line {
    /// How the lines after it were made.
    Made(Made),
    /// A run.
    Run(Box<Run>),
    /// The head of a table; its rows follow.
    Table(Columns),
    /// A row of the table before it.
    Row { cells: Vec<String> },
}

/// How figures were made. Where several files are written by one command, each says so.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Made {
    /// What was typed.
    pub(crate) command: String,
    /// Of the program that was measured.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) commit: Option<String>,
    /// Where; absent where it is in the runs, or was not noted.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) machine: Option<String>,
    /// In words, such as `0 to 9`; absent where they are in the runs, or were not noted.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) seeds: Option<String>,
    /// The figures stood in a document before result files were kept: the commit is the one that last changed them there.
    #[serde(skip_serializing_if = "std::ops::Not::not", default)]
    pub(crate) from_document: bool,
}

/// The head of a table.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Columns {
    pub(crate) columns: Vec<String>,
    /// Columns of words, beside the first one; the others are figures.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub(crate) words: Vec<usize>,
}

/// What was run.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct Key {
    pub(crate) input: String,
    pub(crate) variant: String,
    pub(crate) seed: u64,
    /// Options of the variant.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub(crate) options: Vec<String>,
    /// The first so many frames only.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) frames_at_most: Option<u64>,
    /// The program's hash; the name of a peer.
    pub(crate) program: String,
}

/// One run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Run {
    #[serde(flatten)]
    pub(crate) key: Key,
    pub(crate) commit: String,
    pub(crate) machine: Machine,
    /// The hash of the program that rendered the images; absent of recordings.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) renderer: Option<String>,
    /// Runs at once: times of one that is not alone mean little.
    pub(crate) jobs: usize,
    /// From start to end of the process, s.
    pub(crate) seconds: f64,
    /// Why there are no figures.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) error: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) figures: Option<Figures>,
}

/// What came of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    pub(crate) frames: usize,
    /// Frames without a pose in the trajectory.
    pub(crate) lost: usize,
    /// Frames with a pose while it was undecided who moves; absent of systems that do not say it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) undecided: Option<usize>,
    /// Frames that are off by more than [`crate::score::WRONG`] and were said to be certain.
    pub(crate) wrong: usize,
    /// The camera stands still in the ground truth: errors are distances from the first pose.
    #[serde(skip_serializing_if = "std::ops::Not::not", default)]
    pub(crate) drift: bool,
    /// RMSE of the final poses after alignment by a rigid motion, mm.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) ate_mm: Option<f64>,
    /// The same of the poses as known at each frame.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) online_ate_mm: Option<f64>,
    /// Largest error of a final pose, mm.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) worst_mm: Option<f64>,
    /// RMSE of the motion over 1 s, mm.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) rpe_mm: Option<f64>,
    /// The same, degrees.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) rpe_deg: Option<f64>,
    /// By stage, over the frames in which it ran.
    pub(crate) time_ms: BTreeMap<String, Time>,
    /// Largest amount of memory held.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) memory_bytes: Option<u64>,
    /// Of live runs.
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

/// What a live run says beside other runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Live {
    /// Frames that a newer one replaced before tracking took them: their share of those that arrived, 0 to 1.
    pub(crate) dropped_share: f64,
    /// From a frame's arrival to its pose.
    pub(crate) latency_ms: Time,
    /// Frames that the detector answered for.
    pub(crate) detections_per_second: f64,
    /// By how much a frame's stamp is later than that of the newest detections that were known, mean.
    pub(crate) detections_age_ms: f64,
}

impl Figures {
    /// Median time of the call that tracks a frame, ms.
    pub(crate) fn frame_ms(&self) -> Option<f64> {
        self.time_ms.get("frame").map(|t| t.median)
    }
}

/// Reads a result file. What follows its last line break is a line that was not written to its end, and is left out.
pub(crate) fn read(path: &Path) -> Result<Vec<Line>, Failure> {
    let bytes = std::fs::read(path)
        .map_err(|e| format!("{}: expected a result file, found: {e}", path.display()))?;
    parse(whole(&bytes), path)
}

/// The lines that were written to their end.
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

/// A file that lines are appended to.
#[derive(Debug)]
pub(crate) struct Appended {
    file: std::fs::File,
    path: String,
}

impl Appended {
    /// Opens a file to go on with it, or makes it. Gives what it holds; a last line without an end is cut off and said.
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

    /// Appends a line in one write.
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

/// The runs of a file. Of several lines about the same run the last one counts.
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
    fn a_half_written_last_line_is_cut_off_and_the_file_goes_on() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("below/runs.jsonl");
        let line = |seed| Line::Run(Box::new(run("a", "b", seed, 1.5)));
        let (mut file, none) = Appended::open(&path).unwrap();
        assert!(none.is_empty());
        file.push(&line(0)).unwrap();
        file.push(&line(1)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        // Also in the midst of a character.
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
    fn a_broken_line_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("runs.jsonl");
        std::fs::write(&path, "{\"kind\":\"row\",\"cells\":[]}\n{}\n").unwrap();
        let e = read(&path).unwrap_err().to_string();
        assert!(e.contains("runs.jsonl:2: expected"), "{e}");
    }

    #[test]
    fn of_a_run_that_was_repeated_the_last_line_counts() {
        let lines = [1.0, 2.0].map(|ate| Line::Run(Box::new(run("a", "b", 0, ate))));
        let runs = runs(&lines);
        assert_eq!(runs.len(), 1);
        assert_eq!(runs[0].figures.as_ref().unwrap().ate_mm, Some(2.0));
    }
}
