//! Log lines with odometry samples.

use super::LogError;
use super::reader::{AllLines, Line, Words};
use std::fmt::Write;
use stillpoint_imaging::OdometrySample;

pub(super) fn write(text: &mut String, samples: &[OdometrySample]) {
    let _ = writeln!(text, "odometry {}", samples.len());
    for s in samples {
        let ([x, y, z], [i, j, k, w]) = (s.position, s.orientation);
        let _ = write!(
            text,
            "  base {:?} {x:?} {y:?} {z:?} {i:?} {j:?} {k:?} {w:?}",
            s.stamp
        );
        if let Some([place, turn]) = s.sigmas {
            let _ = write!(text, " {place:?} {turn:?}");
        }
        text.push('\n');
    }
}

/// Reads the samples, whose number is the next word.
pub(super) fn read(
    words: &mut Words<'_>,
    rest: &mut AllLines<'_>,
) -> Result<Vec<OdometrySample>, LogError> {
    let count: usize = words.number("the number of samples")?;
    // No preallocation, as the number may be corrupt.
    let mut samples = Vec::new();
    for _ in 0..count {
        let line = Line::next(rest)?;
        let mut words = line.words("base")?;
        let stamp = words.number("a stamp in seconds")?;
        let mut number = |of: &str| words.number::<f64>(of);
        let place = "a place in m";
        let position = [number(place)?, number(place)?, number(place)?];
        let turn = "a quaternion x y z w";
        let orientation = [number(turn)?, number(turn)?, number(turn)?, number(turn)?];
        let known = line.text.split_ascii_whitespace().count() > 9;
        let sigmas = if known {
            let of = "standard deviations of place and direction";
            Some([number(of)?, number(of)?])
        } else {
            None
        };
        words.finish()?;
        samples.push(OdometrySample {
            stamp,
            position,
            orientation,
            sigmas,
        });
    }
    Ok(samples)
}
