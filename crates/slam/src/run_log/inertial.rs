//! Log lines with inertial samples.

use super::LogError;
use super::reader::{AllLines, Line, Words};
use std::fmt::Write;
use stillpoint_imaging::ImuSample;

pub(super) fn write(text: &mut String, samples: &[ImuSample]) {
    let _ = writeln!(text, "inertial {}", samples.len());
    for s in samples {
        let ([x, y, z], [u, v, w]) = (s.angular_rate, s.specific_force);
        let _ = writeln!(
            text,
            "  imu {:?} {x:?} {y:?} {z:?} {u:?} {v:?} {w:?}",
            s.stamp
        );
    }
}

/// Reads the samples, whose number is the next word.
pub(super) fn read(
    words: &mut Words<'_>,
    rest: &mut AllLines<'_>,
) -> Result<Vec<ImuSample>, LogError> {
    let count: usize = words.number("the number of samples")?;
    // No preallocation, as the number may be corrupt.
    let mut samples = Vec::new();
    for _ in 0..count {
        let mut words = Line::next(rest)?.words("imu")?;
        let stamp = words.number("a stamp in seconds")?;
        let mut vector = |of| -> Result<[f64; 3], LogError> {
            Ok([words.number(of)?, words.number(of)?, words.number(of)?])
        };
        let angular_rate = vector("an angular rate in rad/s")?;
        let specific_force = vector("a specific force in m/s^2")?;
        words.finish()?;
        samples.push(ImuSample {
            stamp,
            angular_rate,
            specific_force,
        });
    }
    Ok(samples)
}
