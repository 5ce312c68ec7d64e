//! Detections from text, one box per line: for tests, fast experiments, and external detectors.

use crate::detector::{DetectError, Detector, DetectorInfo, DetectorKind};
use crate::hash::sha256_hex;
use crate::{BoundingBox, ClassId, Detection, Detections};
use std::fmt::Write;
use stillpoint_imaging::RgbdFrame;

/// The columns, also the optional header line of a script.
pub const SCRIPT_HEADER: &str = "timestamp,class,score,x0,y0,x1,y1";

/// Largest difference between a row's stamp and that of its frame, s. Stamps are written with six decimals, and frames
/// are more than twice this apart.
const STAMP_TOLERANCE: f64 = 1e-3;

/// One line of a script.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptRow {
    /// Colour stamp of the frame, s.
    pub stamp: f64,
    /// The detection.
    pub detection: Detection,
}

/// A malformed script.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name}:{line}: expected {expected}, found {found}; {advice}")]
pub struct ScriptError {
    /// Name of the script.
    pub name: String,
    /// Line number, from 1; for rows created by a program, the row number.
    pub line: usize,
    /// Expected content.
    pub expected: String,
    /// Actual content.
    pub found: String,
    /// Advice to the user.
    pub advice: String,
}

/// Usage of a script. A script of another recording matches nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScriptUse {
    /// Rows of the script.
    pub rows: usize,
    /// Rows matched by a frame.
    pub rows_matched: usize,
    /// Frames processed.
    pub frames: usize,
    /// Frames that matched at least one row.
    pub frames_matched: usize,
}

/// Replays the detections of a script. A frame without rows has no detections.
#[derive(Clone, Debug)]
pub struct ScriptedDetector {
    name: String,
    sha256: String,
    /// By stamp, then best score first.
    rows: Vec<ScriptRow>,
    matched: Vec<bool>,
    frames: usize,
    frames_matched: usize,
}

impl ScriptedDetector {
    /// Parses a script: lines `timestamp,class,score,x0,y0,x1,y1` in any order, with the stamp in seconds, the class as
    /// COCO name or number, the score from 0 to 1, and the box in raw pixels. The header line is optional; blank lines
    /// and lines that start with `#` are skipped. `name` identifies the script in errors and summaries.
    ///
    /// # Errors
    /// [`ScriptError`] for the first malformed line.
    pub fn parse(name: &str, text: &str) -> Result<Self, ScriptError> {
        let rows = parse_script(name, text)?;
        Ok(Self::from_rows(name, rows, sha256_hex(text.as_bytes())))
    }

    /// From rows in any order. The SHA-256 is that of the rows as written by [`format_script`].
    ///
    /// # Errors
    /// [`ScriptError`], with the number of the row from 1, for invalid values.
    pub fn new(name: &str, rows: Vec<ScriptRow>) -> Result<Self, ScriptError> {
        for (i, row) in rows.iter().enumerate() {
            check(row).map_err(|p| p.at(name, i + 1))?;
        }
        let sha256 = sha256_hex(format_script(&rows).as_bytes());
        Ok(Self::from_rows(name, rows, sha256))
    }

    fn from_rows(name: &str, mut rows: Vec<ScriptRow>, sha256: String) -> Self {
        rows.sort_by(|a, b| {
            let by_score = b.detection.score.total_cmp(&a.detection.score);
            a.stamp.total_cmp(&b.stamp).then(by_score)
        });
        Self {
            name: name.to_owned(),
            sha256,
            matched: vec![false; rows.len()],
            rows,
            frames: 0,
            frames_matched: 0,
        }
    }

    /// The rows, by stamp, best score first.
    #[must_use]
    pub fn rows(&self) -> &[ScriptRow] {
        &self.rows
    }

    /// Usage of the script up to the present.
    #[must_use]
    pub fn usage(&self) -> ScriptUse {
        ScriptUse {
            rows: self.rows.len(),
            rows_matched: self.matched.iter().filter(|&&m| m).count(),
            frames: self.frames,
            frames_matched: self.frames_matched,
        }
    }
}

impl Detector for ScriptedDetector {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        let (low, high) = (frame.stamp - STAMP_TOLERANCE, frame.stamp + STAMP_TOLERANCE);
        let first = self.rows.partition_point(|r| r.stamp < low);
        let end = first + self.rows[first..].partition_point(|r| r.stamp <= high);
        self.matched[first..end].fill(true);
        self.frames += 1;
        self.frames_matched += usize::from(end > first);
        let mut items: Vec<Detection> = self.rows[first..end].iter().map(|r| r.detection).collect();
        // Stamps of one frame's rows may differ in their last digits: sort by score again.
        items.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items,
        })
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo {
            sha256: Some(self.sha256.clone()),
            ..DetectorInfo::new(DetectorKind::Scripted, &self.name)
        }
    }

    fn remark(&self) -> Option<String> {
        let used = self.usage();
        let (Some(first), Some(last)) = (self.rows.first(), self.rows.last()) else {
            return Some(format!("{}: the script holds no detections", self.name));
        };
        (used.frames > 0 && used.frames_matched == 0).then(|| {
            format!(
                "{}: none of its {} rows, {:.6} to {:.6} s, is within {STAMP_TOLERANCE} s of any of the {} frames; check that the script belongs to this recording",
                self.name, used.rows, first.stamp, last.stamp, used.frames
            )
        })
    }
}

/// Parses the rows of a script in the order of its lines. See [`ScriptedDetector::parse`].
///
/// # Errors
/// [`ScriptError`] for the first malformed line.
pub fn parse_script(name: &str, text: &str) -> Result<Vec<ScriptRow>, ScriptError> {
    let mut rows = Vec::new();
    let mut header_allowed = true;
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        if !(header_allowed && is_header(line)) {
            rows.push(parse_row(line).map_err(|p| p.at(name, i + 1))?);
        }
        header_allowed = false;
    }
    Ok(rows)
}

/// Writes a script with its header: stamps with six decimals, scores with six, boxes with three. Reading it gives the
/// same rows up to that rounding.
#[must_use]
pub fn format_script(rows: &[ScriptRow]) -> String {
    let mut text = format!("{SCRIPT_HEADER}\n");
    for ScriptRow { stamp, detection } in rows {
        let BoundingBox { x0, y0, x1, y1 } = detection.bounds;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{stamp:.6},{},{:.6},{x0:.3},{y0:.3},{x1:.3},{y1:.3}",
            detection.class, detection.score
        );
    }
    text
}

fn is_header(line: &str) -> bool {
    line.split(',').map(str::trim).eq(SCRIPT_HEADER.split(','))
}

struct Problem {
    expected: String,
    found: String,
    advice: &'static str,
}

impl Problem {
    fn new(expected: impl Into<String>, found: impl Into<String>, advice: &'static str) -> Self {
        Self {
            expected: expected.into(),
            found: found.into(),
            advice,
        }
    }

    fn at(self, name: &str, line: usize) -> ScriptError {
        ScriptError {
            name: name.to_owned(),
            line,
            expected: self.expected,
            found: self.found,
            advice: self.advice.to_owned(),
        }
    }
}

fn parse_row(line: &str) -> Result<ScriptRow, Problem> {
    let columns: Vec<&str> = line.split(',').map(str::trim).collect();
    let [stamp, class, score, x0, y0, x1, y1] = columns[..] else {
        return Err(Problem::new(
            format!("7 columns {SCRIPT_HEADER}"),
            format!("{} in {}", columns.len(), quote(line)),
            "separate the columns by commas",
        ));
    };
    let row = ScriptRow {
        stamp: number("timestamp", stamp)?,
        detection: Detection {
            class: parse_class(class)?,
            score: number("score", score)? as f32,
            bounds: BoundingBox {
                x0: number("x0", x0)?,
                y0: number("y0", y0)?,
                x1: number("x1", x1)?,
                y1: number("y1", y1)?,
            },
        },
    };
    check(&row).map(|()| row)
}

fn number(column: &str, text: &str) -> Result<f64, Problem> {
    text.parse().map_err(|_| {
        Problem::new(
            format!("a number as {column}"),
            quote(text),
            "the columns are timestamp,class,score,x0,y0,x1,y1",
        )
    })
}

fn parse_class(text: &str) -> Result<ClassId, Problem> {
    let by_number = || {
        text.parse()
            .ok()
            .filter(|&n| usize::from(n) < ClassId::COUNT)
    };
    ClassId::from_name(text)
        .or_else(|| by_number().map(ClassId))
        .ok_or_else(|| {
            let nearest = ClassId::nearest(text).unwrap_or(ClassId::PERSON);
            Problem::new(
                format!("a COCO class such as \"{nearest}\", or its number from 0 to 79"),
                quote(text),
                "correct the name or leave the line out",
            )
        })
}

fn check(row: &ScriptRow) -> Result<(), Problem> {
    let Detection {
        class,
        score,
        bounds,
    } = row.detection;
    if !row.stamp.is_finite() {
        return Err(Problem::new(
            "a finite stamp",
            row.stamp.to_string(),
            "write it in seconds",
        ));
    }
    if usize::from(class.0) >= ClassId::COUNT {
        return Err(Problem::new(
            "a class from 0 to 79",
            class.0.to_string(),
            "use COCO's classes",
        ));
    }
    if !(0.0..=1.0).contains(&score) {
        return Err(Problem::new(
            "a score from 0 to 1",
            score.to_string(),
            "write it as a share, not in percent",
        ));
    }
    let BoundingBox { x0, y0, x1, y1 } = bounds;
    let finite = [x0, y0, x1, y1].iter().all(|v| v.is_finite());
    if !(finite && x0 < x1 && y0 < y1) {
        return Err(Problem::new(
            "a box with x0 < x1 and y0 < y1",
            format!("{x0},{y0},{x1},{y1}"),
            "write the corners left, top, right, bottom in pixels, not a corner and a size",
        ));
    }
    Ok(())
}

/// Quotes text in a message: one line, limited length.
fn quote(text: &str) -> String {
    const LONGEST: usize = 60;
    let printable = |c: char| if c.is_control() { ' ' } else { c };
    let mut s: String = text.chars().take(LONGEST).map(printable).collect();
    if text.chars().nth(LONGEST).is_some() {
        s.push_str("...");
    }
    format!("\"{s}\"")
}
