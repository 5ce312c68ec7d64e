//! Plausible ranges of sensor parameters.

use crate::Vec3;
use std::ops::RangeInclusive;

/// A sensor parameter outside its plausible range.
#[derive(Clone, Debug, PartialEq)]
pub struct FigureError {
    /// The field.
    pub field: &'static str,
    /// The expected range, in words.
    pub expected: &'static str,
    /// The value found.
    pub found: f64,
}

impl std::fmt::Display for FigureError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            field,
            expected,
            found,
        } = self;
        write!(f, "expected {field} {expected}, found {found}")
    }
}

impl std::error::Error for FigureError {}

/// A parameter: name, value, allowed range, range in words.
pub(crate) type Figure = (&'static str, f64, RangeInclusive<f64>, &'static str);

/// Returns the first parameter out of range: first the sensor's own, then time offset (s) and lever arm (m).
pub(crate) fn check(own: &[Figure], time_offset: f64, lever: &Vec3) -> Result<(), FigureError> {
    let (second, ten) = ("within 1 s", "within 10 m");
    let mounted = [
        ("time_offset", time_offset, -1.0..=1.0, second),
        ("translation x", lever.x, -10.0..=10.0, ten),
        ("translation y", lever.y, -10.0..=10.0, ten),
        ("translation z", lever.z, -10.0..=10.0, ten),
    ];
    // Also rejects NaN.
    let wrong = |figure: &&Figure| !figure.2.contains(&figure.1);
    match own.iter().chain(&mounted).find(wrong) {
        None => Ok(()),
        Some(&(field, found, _, expected)) => Err(FigureError {
            field,
            expected,
            found,
        }),
    }
}
