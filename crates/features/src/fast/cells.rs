//! Cells that use the low threshold if they have no strong corner.

use super::{Corner, FastOptions};

/// Side of a cell that is searched with the low threshold if the other finds nothing, px. Chosen: near the 30 px of
/// ORB-SLAM2 (Mur-Artal, Tardos 2017).
const CELL: usize = 32;

/// Cells of equal size, as near to [`CELL`] as the image allows, over the searched rectangle.
#[derive(Clone, Debug, Default)]
pub(super) struct Cells {
    margin: usize,
    across: usize,
    width: usize,
    pub(super) height: usize,
    strong: Vec<bool>,
    /// For each image column the score that corners must exceed in the current row of cells: once a cell has a strong
    /// corner, weak ones are ignored.
    pub(super) thresholds: Vec<u8>,
}

impl Cells {
    pub(super) fn lay_out(&mut self, image: (usize, usize), options: &FastOptions) {
        let inner = (image.0 - 2 * options.margin, image.1 - 2 * options.margin);
        let count = |length: usize| ((length + CELL / 2) / CELL).max(1);
        let down = count(inner.1);
        self.margin = options.margin;
        self.across = count(inner.0);
        self.width = inner.0.div_ceil(self.across);
        self.height = inner.1.div_ceil(down);
        self.strong.clear();
        self.strong.resize(self.across * down, false);
        self.thresholds.clear();
        self.thresholds.resize(image.0, options.low);
    }

    fn index(&self, corner: &Corner) -> usize {
        let column = (usize::from(corner.x) - self.margin) / self.width;
        let row = (usize::from(corner.y) - self.margin) / self.height;
        row * self.across + column
    }

    pub(super) fn is_strong(&self, corner: &Corner) -> bool {
        self.strong[self.index(corner)]
    }

    pub(super) fn mark_strong(&mut self, corner: &Corner, high: u8) {
        let index = self.index(corner);
        if !self.strong[index] {
            self.strong[index] = true;
            let begin = self.margin + index % self.across * self.width;
            let end = (begin + self.width).min(self.thresholds.len());
            self.thresholds[begin..end].fill(high);
        }
    }
}
