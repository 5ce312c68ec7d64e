//! Moving regions, as output of the filter.

use super::{Preset, StaticFilter, cells};
use std::sync::Arc;

/// The moving depth-connected regions of a frame, by square cells of the raw image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Segments {
    /// Side of a cell, px: cell (i, j) covers the pixels from `(i * cell_px, j * cell_px)`.
    pub cell_px: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Region of each cell, row by row, from 1; 0 if static. Empty if the preset has no regions.
    pub labels: Arc<[u16]>,
    /// By region: whether a detector sees a self-moving object in it. Empty if there is none.
    pub seen: Arc<[bool]>,
}

impl StaticFilter {
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

    /// By region, whether objects that may move hold most of it. Allocates nothing without such objects.
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
