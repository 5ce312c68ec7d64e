//! Lines of a log.

use super::reader::{ABOUT, AllLines, Line, Words};
use super::word::escaped;
use super::{LogEntry, LogError};
use super::{inertial, odometry};
use crate::mapping::MappingEffort;
use std::fmt::Write;
use stillpoint_detection::{BoundingBox, DetectError, Detection, Detections};
use stillpoint_imaging::FrameId;

/// Writes the text about a run, plain if possible, else quoted.
pub(super) fn write_about(text: &mut String, about: &str) {
    if about.is_empty() {
        return;
    }
    for line in about.split('\n') {
        let plain = line.bytes().all(|b| b == b' ' || b.is_ascii_graphic());
        let _ = if plain && !line.starts_with('"') {
            writeln!(text, "{ABOUT}{line}")
        } else {
            writeln!(text, "{ABOUT}{}", escaped(line))
        };
    }
}

/// Writes an entry and, in lines of their own, its boxes or samples.
pub(super) fn write(text: &mut String, entry: &LogEntry) {
    // Writing to a string cannot fail.
    let _ = match entry {
        LogEntry::TrackFrame { frame, stamp } => writeln!(text, "frame {frame} {stamp:?}"),
        LogEntry::TrackView { answer } => writeln!(text, "view {answer}"),
        LogEntry::TrackPlaces { answer } => writeln!(text, "places {answer}"),
        LogEntry::TrackDetections { next, said } => {
            match said {
                Ok(detections) => write_detections(text, *next, detections),
                Err(e) => write_failure(text, *next, e),
            }
            Ok(())
        }
        LogEntry::TrackInertial { samples } => {
            inertial::write(text, samples);
            Ok(())
        }
        LogEntry::TrackOdometry { samples } => {
            odometry::write(text, samples);
            Ok(())
        }
        LogEntry::TrackEnd => writeln!(text, "track-end"),
        LogEntry::TrackEffort { features } => writeln!(text, "track-effort {features}"),
        LogEntry::MapEffort { effort } => {
            writeln!(text, "map-effort {} {}", effort.neighbours, effort.window)
        }
        LogEntry::MapKeyframe { keyframe } => writeln!(text, "map-keyframe {}", keyframe.0),
        LogEntry::MapRejudge { keyframe } => writeln!(text, "map-rejudge {}", keyframe.0),
        LogEntry::MapRevoke { first, last } => {
            writeln!(text, "map-revoke {} {}", first.0, last.0)
        }
        LogEntry::MapCorrect { base_version } => writeln!(text, "map-correct {base_version}"),
        LogEntry::LoopKeyframe {
            keyframe,
            map_version,
        } => writeln!(text, "loop-keyframe {} {map_version}", keyframe.0),
        LogEntry::LoopRejudged {
            keyframe,
            map_version,
        } => writeln!(text, "loop-rejudged {} {map_version}", keyframe.0),
        LogEntry::LoopRevoked { map_version } => writeln!(text, "loop-revoked {map_version}"),
        LogEntry::LoopCorrected { map_version } => writeln!(text, "loop-corrected {map_version}"),
    };
}

fn write_detections(text: &mut String, next: FrameId, detections: &Detections) {
    let Detections {
        frame,
        stamp,
        items,
    } = detections;
    let _ = writeln!(text, "seen {next} {frame} {stamp:?} {}", items.len());
    for Detection {
        class,
        score,
        bounds: b,
    } in items
    {
        let _ = writeln!(
            text,
            "  box {} {score:?} {:?} {:?} {:?} {:?}",
            class.0, b.x0, b.y0, b.x1, b.y1
        );
    }
}

fn write_failure(text: &mut String, next: FrameId, error: &DetectError) {
    let _ = match error {
        DetectError::NoColour { frame } => writeln!(text, "failed {next} {frame} no-colour"),
        DetectError::ImageSize {
            frame,
            expected: (w, h),
            found: (fw, fh),
        } => writeln!(text, "failed {next} {frame} image-size {w} {h} {fw} {fh}"),
        DetectError::Runtime { frame, reason } => {
            writeln!(text, "failed {next} {frame} runtime {}", escaped(reason))
        }
        DetectError::Output {
            frame,
            expected,
            found,
        } => writeln!(
            text,
            "failed {next} {frame} output {} {}",
            escaped(expected),
            escaped(found)
        ),
        // Other failures are stored as text.
        other => writeln!(
            text,
            "failed {next} {next} runtime {}",
            escaped(&other.to_string())
        ),
    };
}

/// Reads the entry that begins with `line`, and its boxes or samples from the lines that follow.
pub(super) fn read(line: &Line<'_>, rest: &mut AllLines<'_>) -> Result<LogEntry, LogError> {
    let name = line.text.split(' ').next().unwrap_or_default();
    let mut words = line.words(name)?;
    let entry = match name {
        "frame" => LogEntry::TrackFrame {
            frame: words.frame()?,
            stamp: words.number("a stamp in seconds")?,
        },
        "view" => LogEntry::TrackView {
            answer: words.number("the number of an answer")?,
        },
        "places" => LogEntry::TrackPlaces {
            answer: words.number("the number of an answer")?,
        },
        "seen" => LogEntry::TrackDetections {
            next: words.frame()?,
            said: Ok(read_detections(&mut words, rest)?),
        },
        "failed" => LogEntry::TrackDetections {
            next: words.frame()?,
            said: Err(read_failure(&mut words)?),
        },
        "inertial" => LogEntry::TrackInertial {
            samples: inertial::read(&mut words, rest)?,
        },
        "odometry" => LogEntry::TrackOdometry {
            samples: odometry::read(&mut words, rest)?,
        },
        "track-end" => LogEntry::TrackEnd,
        "track-effort" => LogEntry::TrackEffort {
            features: words.number("a number of keypoints")?,
        },
        _ => read_behind_tracking(name, line, &mut words)?,
    };
    words.finish()?;
    Ok(entry)
}

/// Reads an entry of the mapper or the loop closer.
fn read_behind_tracking(
    name: &str,
    line: &Line<'_>,
    words: &mut Words<'_>,
) -> Result<LogEntry, LogError> {
    Ok(match name {
        "map-effort" => LogEntry::MapEffort {
            effort: MappingEffort {
                neighbours: words.number("a number of neighbours")?,
                window: words.number("a number of keyframes")?,
            },
        },
        "map-keyframe" => LogEntry::MapKeyframe {
            keyframe: words.keyframe()?,
        },
        "map-rejudge" => LogEntry::MapRejudge {
            keyframe: words.keyframe()?,
        },
        "map-revoke" => LogEntry::MapRevoke {
            first: words.keyframe()?,
            last: words.keyframe()?,
        },
        "map-correct" => LogEntry::MapCorrect {
            base_version: words.version()?,
        },
        "loop-keyframe" => LogEntry::LoopKeyframe {
            keyframe: words.keyframe()?,
            map_version: words.version()?,
        },
        "loop-rejudged" => LogEntry::LoopRejudged {
            keyframe: words.keyframe()?,
            map_version: words.version()?,
        },
        "loop-revoked" => LogEntry::LoopRevoked {
            map_version: words.version()?,
        },
        "loop-corrected" => LogEntry::LoopCorrected {
            map_version: words.version()?,
        },
        _ => return Err(line.error("an entry, or the trajectory's number after the last one")),
    })
}

fn read_detections(words: &mut Words<'_>, rest: &mut AllLines<'_>) -> Result<Detections, LogError> {
    let frame = words.frame()?;
    let stamp = words.number("a stamp in seconds")?;
    let count: usize = words.number("the number of boxes")?;
    // No preallocation, as the number may be corrupt.
    let mut items = Vec::new();
    for _ in 0..count {
        let mut words = Line::next(rest)?.words("box")?;
        items.push(Detection {
            class: words.class()?,
            score: words.number("a score")?,
            bounds: BoundingBox {
                x0: words.number("x0")?,
                y0: words.number("y0")?,
                x1: words.number("x1")?,
                y1: words.number("y1")?,
            },
        });
        words.finish()?;
    }
    Ok(Detections {
        frame,
        stamp,
        items,
    })
}

fn read_failure(words: &mut Words<'_>) -> Result<DetectError, LogError> {
    let frame = words.frame()?;
    let kinds = "no-colour, image-size, runtime or output";
    Ok(match words.word(kinds)? {
        "no-colour" => DetectError::NoColour { frame },
        "image-size" => DetectError::ImageSize {
            frame,
            expected: words.size()?,
            found: words.size()?,
        },
        "runtime" => DetectError::Runtime {
            frame,
            reason: words.text()?,
        },
        "output" => DetectError::Output {
            frame,
            expected: words.text()?,
            found: words.text()?,
        },
        _ => return Err(words.line.error(kinds)),
    })
}
