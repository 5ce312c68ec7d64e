//! Depth-connected regions: what is known of one part of a surface holds for its neighbours.

use super::cells::Cells;

/// Bound of the log odds of a cell, so that years of evidence can be overturned in a few frames.
pub(super) const LIMIT: f32 = 8.0;
/// How much of its neighbours' mean a cell takes over.
const COUPLING: f32 = 0.9;
/// Rounds of sweeping there and back: enough to cross a person.
const SWEEPS: usize = 3;

/// Which neighbours each cell is joined to: bit 0 right, bit 1 below.
pub(super) struct Links(Vec<u8>);

impl Links {
    /// Joins neighbours whose depths differ by less than a step.
    pub(super) fn new(cells: &Cells, depth: &[f32]) -> Self {
        let joined = |a: f32, b: f32| a > 0.0 && b > 0.0 && (a - b).abs() < 0.02 + 0.025 * a.min(b);
        let (w, h) = (cells.width, cells.height);
        let mut links = vec![0; w * h];
        for y in 0..h {
            for x in 0..w {
                let i = y * w + x;
                let right = x + 1 < w && joined(depth[i], depth[i + 1]);
                let below = y + 1 < h && joined(depth[i], depth[i + w]);
                links[i] = u8::from(right) | u8::from(below) << 1;
            }
        }
        Self(links)
    }

    /// Spreads each cell's own value over the region it belongs to: solves
    /// `x_i = clamp(own_i + COUPLING * mean of joined neighbours x_j)` by symmetric Gauss-Seidel sweeps.
    pub(super) fn spread(&self, cells: &Cells, own: &[f32], values: &mut Vec<f32>) {
        values.clear();
        values.extend(own.iter().map(|v| v.clamp(-LIMIT, LIMIT)));
        let n = own.len();
        for _ in 0..SWEEPS {
            for i in 0..n {
                self.update(cells.width, i, own, values);
            }
            for i in (0..n).rev() {
                self.update(cells.width, i, own, values);
            }
        }
    }

    fn update(&self, w: usize, i: usize, own: &[f32], values: &mut [f32]) {
        let (mut sum, mut count) = (0.0, 0.0);
        let links = &self.0;
        if links[i] & 1 != 0 {
            sum += values[i + 1];
            count += 1.0;
        }
        if links[i] & 2 != 0 {
            sum += values[i + w];
            count += 1.0;
        }
        // The rightmost cell of a row is never joined to its right, so the previous index is a neighbour whenever it says so.
        if i > 0 && links[i - 1] & 1 != 0 {
            sum += values[i - 1];
            count += 1.0;
        }
        if i >= w && links[i - w] & 2 != 0 {
            sum += values[i - w];
            count += 1.0;
        }
        if count > 0.0 {
            values[i] = (own[i] + COUPLING * sum / count).clamp(-LIMIT, LIMIT);
        }
    }
}
