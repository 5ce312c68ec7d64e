//! IDF1: one id per object for the whole sequence.

use super::{Table, share};
use stillpoint_geometry::assign;

/// IDF1 and its components, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Identity {
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Fraction of the found boxes with the id of their object.
    pub precision: f64,
    /// Fraction of the true boxes found with their object's id.
    pub recall: f64,
}

pub(super) fn score(table: &Table, least: f64) -> Identity {
    let mut together = vec![vec![0.0; table.found_ids]; table.truth_ids];
    for row in &table.rows {
        for (alike, &t) in row.alike.iter().zip(&row.truth) {
            for (a, &d) in alike.iter().zip(&row.found) {
                together[t][d] += f64::from(u8::from(*a >= least));
            }
        }
    }
    let pairs = assign(&together).into_iter().enumerate();
    let right: f64 = pairs.filter_map(|(t, d)| Some(together[t][d?])).sum();
    let truth: f64 = table.truth_count.iter().sum();
    let found: f64 = table.found_count.iter().sum();
    Identity {
        f1: share(right, (truth + found) / 2.0),
        precision: share(right, found),
        recall: share(right, truth),
    }
}
