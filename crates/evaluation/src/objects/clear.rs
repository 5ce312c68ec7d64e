//! CLEAR MOT: found, missed and switched objects, frame by frame.

use super::{Row, Table, share};
use stillpoint_geometry::assign;

/// MOTA and its components.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clear {
    /// 1 less the fraction of errors (missed, wrong, switched) in all true boxes; may be negative.
    pub mota: f64,
    /// Overlap of the right boxes, 0 to 1.
    pub motp: f64,
    /// Right boxes.
    pub right: usize,
    /// True boxes that were not found.
    pub missed: usize,
    /// Found boxes without an object.
    pub wrong: usize,
    /// Number of changes of an object's id.
    pub id_switches: usize,
    /// Number of times that an object was found again after being missed.
    pub fragments: usize,
}

/// Weight that keeps an object's id of the previous frame.
const KEPT: f64 = 1000.0;

/// The score, and the matches of each frame: indices into its lists of truth and found.
pub(super) fn score(table: &Table, least: f64) -> (Clear, Vec<Vec<(usize, usize)>>) {
    let mut s = Clear::default();
    let mut last_number = vec![None; table.truth_ids];
    let mut frame_before = vec![None; table.truth_ids];
    let mut starts = vec![0_usize; table.truth_ids];
    let mut overlap = 0.0;
    let mut all = Vec::with_capacity(table.rows.len());
    for row in &table.rows {
        if row.truth.is_empty() || row.found.is_empty() {
            s.wrong += row.found.len();
            s.missed += row.truth.len();
            all.push(Vec::new());
            continue;
        }
        let matches = matched(row, least, |t, d| {
            if frame_before[t] == Some(d) {
                KEPT
            } else {
                0.0
            }
        });
        let mut now = vec![None; table.truth_ids];
        for &(i, j) in &matches {
            let (t, d) = (row.truth[i], row.found[j]);
            s.id_switches += usize::from(last_number[t].is_some_and(|old| old != d));
            last_number[t] = Some(d);
            now[t] = Some(d);
            starts[t] += usize::from(frame_before[t].is_none());
            overlap += row.alike[i][j];
        }
        frame_before = now;
        s.right += matches.len();
        s.missed += row.truth.len() - matches.len();
        s.wrong += row.found.len() - matches.len();
        all.push(matches);
    }
    let truth = (s.right + s.missed) as f64;
    let errors = (s.wrong + s.id_switches) as f64;
    s.mota = share(s.right as f64 - errors, truth);
    s.motp = share(overlap, s.right as f64);
    s.fragments = starts.iter().map(|n| n.saturating_sub(1)).sum();
    (s, all)
}

/// Boxes without an object, over all frames.
pub(super) fn ghosts(table: &Table, least: f64) -> usize {
    let ghosts = |row: &Row| row.found.len() - matched(row, least, |_, _| 0.0).len();
    table.rows.iter().map(ghosts).sum()
}

/// Pairs of a frame that overlap by at least `least`, by the greatest sum of overlap and bonus.
fn matched(row: &Row, least: f64, bonus: impl Fn(usize, usize) -> f64) -> Vec<(usize, usize)> {
    let values: Vec<Vec<f64>> = row
        .alike
        .iter()
        .zip(&row.truth)
        .map(|(alike, &t)| {
            let value = |(a, &d): (&f64, &usize)| {
                if *a < least - f64::EPSILON {
                    0.0
                } else {
                    *a + bonus(t, d)
                }
            };
            alike.iter().zip(&row.found).map(value).collect()
        })
        .collect();
    let pairs = assign(&values).into_iter().enumerate();
    pairs
        .filter_map(|(i, j)| j.filter(|&j| values[i][j] > f64::EPSILON).map(|j| (i, j)))
        .collect()
}
