//! The regions of a frame that move, as they leave the filter.

use super::{Preset, StaticFilter, cells};
use std::sync::Arc;

/// The depth-connected regions of a frame that move, by square cells of the raw image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Segments {
    /// Side of a cell, px: cell (i, j) covers the pixels from `(i * cell_px, j * cell_px)`.
    pub cell_px: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of the region of each cell, row by row, from 1; 0 for what stands still. Empty where the filter knows no regions.
    pub labels: Arc<[u16]>,
    /// By the number of a region: whether a detector sees in it what moves by itself. Empty where it sees nobody.
    pub seen: Arc<[bool]>,
}

impl StaticFilter {
    /// The regions of the last frame that move.
    pub(super) fn segments(&self) -> Segments {
        if self.rules.config.preset != Preset::Default {
            return Segments::default();
        }
        Segments {
            cell_px: cells::CELL_PX,
            width: self.rules.cells.width,
            height: self.rules.cells.height,
            labels: self.surfaces.regions.as_slice().into(),
            seen: self.seen(),
        }
    }

    /// Of each region, by its number, whether most of it is what an object holds that may move. Nothing is allocated where none may.
    fn seen(&self) -> Arc<[bool]> {
        let movers = || self.movers.iter().filter(|m| m.strength > 0.0);
        if movers().next().is_none() {
            return Arc::default();
        }
        let (regions, cells) = (&self.surfaces.regions, &self.rules.cells);
        let middle = |i: usize| ((i as f64) + 0.5) * cells::CELL_PX as f64 - 0.5;
        let last = regions.iter().max().map_or(0, |r| usize::from(*r));
        let mut balance = vec![0_i32; last + 1];
        for (i, region) in regions.iter().enumerate().filter(|(_, r)| **r > 0) {
            let [u, v] = [i % cells.width, i / cells.width].map(middle);
            let held = movers().any(|m| m.holds(u, v, self.surfaces.depth[i]));
            balance[usize::from(*region)] += if held { 1 } else { -1 };
        }
        balance.into_iter().map(|b| b > 0).collect()
    }
}
