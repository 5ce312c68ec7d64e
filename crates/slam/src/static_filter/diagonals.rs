//! Cells ordered by diagonals, to vectorise a sweep over them.
//!
//! In a row-by-row Gauss-Seidel sweep each cell depends on its left and upper neighbours. For the cells of a diagonal
//! (`x + y` constant) these lie on the previous diagonal, so they are computed together, with bit-identical results.

use std::ops::Range;

/// Memory layout: one slot per cell, those of a diagonal adjacent, with a free slot around the image.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Diagonals {
    width: usize,
    height: usize,
}

/// Per slot: weight of each neighbour, 1 or 0, and the factor on their sum.
#[derive(Default)]
pub(super) struct Weights {
    pub(super) right: Vec<f32>,
    pub(super) below: Vec<f32>,
    pub(super) left: Vec<f32>,
    pub(super) above: Vec<f32>,
    pub(super) share: Vec<f32>,
}

impl Weights {
    pub(super) fn reset(&mut self, layout: &Diagonals) {
        for slots in [
            &mut self.right,
            &mut self.below,
            &mut self.left,
            &mut self.above,
            &mut self.share,
        ] {
            slots.clear();
            slots.resize(layout.slots(), 0.0);
        }
    }
}

impl Diagonals {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    pub(super) fn slots(&self) -> usize {
        (self.width + self.height + 1) * self.stride()
    }

    /// Distance in slots between neighbours in a row.
    fn stride(&self) -> usize {
        self.height + 2
    }

    pub(super) fn of_rows(self) -> impl Iterator<Item = usize> {
        let stride = self.stride();
        let first = move |y: usize| (y + 1) * (stride + 1);
        (0..self.height).flat_map(move |y| (0..self.width).map(move |x| first(y) + x * stride))
    }

    fn diagonal(&self, d: usize) -> Range<usize> {
        let first = (d + 1).saturating_sub(self.width);
        let end = self.height.min(d + 1);
        let start = (d + 1) * self.stride() + 1;
        start + first..start + end
    }

    /// One forward and one backward sweep of `x_i = clamp(own_i + share_i * sum of neighbours x_j)`, within +-`limit`.
    pub(super) fn sweep(&self, weights: &Weights, own: &[f32], values: &mut [f32], limit: f32) {
        if self.width == 0 || self.height == 0 {
            return;
        }
        let count = self.width + self.height - 1;
        for d in 0..count {
            self.update(d, weights, own, values, limit);
        }
        for d in (0..count).rev() {
            self.update(d, weights, own, values, limit);
        }
    }

    fn update(&self, d: usize, weights: &Weights, own: &[f32], values: &mut [f32], limit: f32) {
        let (slots, stride) = (self.diagonal(d), self.stride());
        let n = slots.len();
        let (before, rest) = values.split_at_mut(slots.start);
        let (now, after) = rest.split_at_mut(n);
        let before = &before[slots.start - stride - 1..][..n + 1];
        let after = &after[stride - n..][..n + 1];
        let (above, left) = (&before[..n], &before[1..]);
        let (right, below) = (&after[..n], &after[1..]);
        let [w_right, w_below, w_left, w_above, share] = [
            &weights.right[slots.clone()],
            &weights.below[slots.clone()],
            &weights.left[slots.clone()],
            &weights.above[slots.clone()],
            &weights.share[slots.clone()],
        ];
        let own = &own[slots];
        for k in 0..n {
            let mut sum = w_right[k] * right[k];
            sum += w_below[k] * below[k];
            sum += w_left[k] * left[k];
            sum += w_above[k] * above[k];
            now[k] = (own[k] + share[k] * sum).clamp(-limit, limit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_have_unique_slots_with_neighbours_at_the_stride() {
        for (w, h) in [(7, 4), (4, 7), (1, 5), (5, 1), (1, 1)] {
            let layout = Diagonals::new(w, h);
            let slots: Vec<usize> = layout.of_rows().collect();
            let mut sorted = slots.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), w * h);
            let of_diagonals: Vec<usize> =
                (0..w + h - 1).flat_map(|d| layout.diagonal(d)).collect();
            assert_eq!(of_diagonals, sorted);
            let stride = layout.stride();
            for i in 0..w * h {
                assert!(slots[i] > stride && slots[i] + stride + 1 < layout.slots());
                assert!(i % w == 0 || slots[i] == slots[i - 1] + stride);
                assert!(i < w || slots[i] == slots[i - w] + stride + 1);
            }
        }
    }
}
