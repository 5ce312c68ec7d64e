//! HOTA: detection and association in one value, over thresholds of overlap.

use super::{Row, Table, share};
use stillpoint_geometry::assign;

/// HOTA and its parts, each the mean over the thresholds 0.05 to 0.95 in steps of 0.05; 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hota {
    /// The root of detection times association.
    pub hota: f64,
    /// Fraction of right boxes among all true or found ones.
    pub detection: f64,
    /// Likewise along the tracks of each right box.
    pub association: f64,
    /// Overlap of the right boxes.
    pub localisation: f64,
}

const THRESHOLDS: usize = 19;

pub(super) fn score(table: &Table) -> Hota {
    let aligned = alignment(table);
    let mut counts = vec![Count::new(table); THRESHOLDS];
    for row in &table.rows {
        let values: Vec<Vec<f64>> = row
            .truth
            .iter()
            .enumerate()
            .map(|(i, &t)| {
                let found = row.found.iter().enumerate();
                found
                    .map(|(j, &d)| aligned[t][d] * row.alike[i][j])
                    .collect()
            })
            .collect();
        let assigned = assign(&values);
        for (k, count) in counts.iter_mut().enumerate() {
            count.add(row, &assigned, 0.05 * (k + 1) as f64);
        }
    }
    let mut mean = Hota::default();
    for count in &counts {
        let h = count.score(table);
        mean.hota += h.hota / THRESHOLDS as f64;
        mean.detection += h.detection / THRESHOLDS as f64;
        mean.association += h.association / THRESHOLDS as f64;
        mean.localisation += h.localisation / THRESHOLDS as f64;
    }
    mean
}

/// Global alignment of two tracks, by truth and found.
fn alignment(table: &Table) -> Vec<Vec<f64>> {
    let mut together = vec![vec![0.0; table.found_ids]; table.truth_ids];
    for row in &table.rows {
        let by_found: Vec<f64> = (0..row.found.len())
            .map(|j| row.alike.iter().map(|a| a[j]).sum())
            .collect();
        for (alike, &t) in row.alike.iter().zip(&row.truth) {
            let by_truth: f64 = alike.iter().sum();
            for (j, &d) in row.found.iter().enumerate() {
                let all = by_found[j] + by_truth - alike[j];
                if all > f64::EPSILON {
                    together[t][d] += alike[j] / all;
                }
            }
        }
    }
    for (t, row) in together.iter_mut().enumerate() {
        for (d, value) in row.iter_mut().enumerate() {
            *value /= table.truth_count[t] + table.found_count[d] - *value;
        }
    }
    together
}

#[derive(Clone)]
struct Count {
    right: f64,
    missed: f64,
    wrong: f64,
    overlap: f64,
    pairs: Vec<Vec<f64>>,
}

impl Count {
    fn new(table: &Table) -> Self {
        Self {
            right: 0.0,
            missed: 0.0,
            wrong: 0.0,
            overlap: 0.0,
            pairs: vec![vec![0.0; table.found_ids]; table.truth_ids],
        }
    }

    fn add(&mut self, row: &Row, assigned: &[Option<usize>], threshold: f64) {
        let mut right = 0.0;
        for (i, j) in assigned.iter().enumerate() {
            let Some(j) = *j else { continue };
            if row.alike[i][j] >= threshold - f64::EPSILON {
                right += 1.0;
                self.overlap += row.alike[i][j];
                self.pairs[row.truth[i]][row.found[j]] += 1.0;
            }
        }
        self.right += right;
        self.missed += row.truth.len() as f64 - right;
        self.wrong += row.found.len() as f64 - right;
    }

    fn score(&self, table: &Table) -> Hota {
        let mut association = 0.0;
        for (t, row) in self.pairs.iter().enumerate() {
            for (d, &n) in row.iter().enumerate() {
                let all = table.truth_count[t] + table.found_count[d] - n;
                association += n * share(n, all);
            }
        }
        let detection = share(self.right, self.right + self.missed + self.wrong);
        let association = share(association, self.right);
        Hota {
            hota: (detection * association).sqrt(),
            detection,
            association,
            localisation: if self.right > 0.0 {
                self.overlap / self.right
            } else {
                1.0
            },
        }
    }
}
