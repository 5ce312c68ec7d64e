//! Spatial index of keypoints.

use std::ops::RangeInclusive;

use crate::Window;

/// Side of a cell, px. Chosen: search windows are 10 to 100 px wide, so that one meets a few cells.
const CELL: f32 = 16.0;
/// Maximum number of cells per side, so that odd bounds do not use excessive memory. Chosen: cells grow beyond 8192 px
/// a side only.
const MAX_CELLS: usize = 512;

/// Maximum number of positions in a grid: those that 16 bits number.
const MAX_POSITIONS: usize = u16::MAX as usize;

/// Keypoint indices in square cells. Positions outside the bounds belong to the nearest border cell and are found as
/// well.
///
/// The positions themselves are stored by the caller: a map keeps thousands of grids.
#[derive(Clone, Debug, Default)]
pub struct FeatureGrid {
    bounds: [f32; 4],
    cells_per_px: [f32; 2],
    columns: usize,
    rows: usize,
    /// `starts[c]..starts[c + 1]` is the part of `indices` and `levels` in cell `c`.
    starts: Vec<u16>,
    indices: Vec<u16>,
    levels: Vec<u8>,
}

impl FeatureGrid {
    /// A grid of `positions` (px) with their `levels`; `bounds` are min x, min y, max x, max y. Positions that are not
    /// finite, and those from number 65535 on, are left out; of lists of different length the common part is used.
    #[must_use]
    pub fn build(positions: &[[f32; 2]], levels: &[u8], bounds: [f32; 4]) -> Self {
        let mut grid = Self::default();
        grid.rebuild(positions, levels, bounds);
        grid
    }

    /// As [`FeatureGrid::build`], reusing the memory.
    pub fn rebuild(&mut self, positions: &[[f32; 2]], levels: &[u8], bounds: [f32; 4]) {
        let cells = |length: f32| ((length / CELL).ceil() as usize).clamp(1, MAX_CELLS);
        let (width, height) = (bounds[2] - bounds[0], bounds[3] - bounds[1]);
        (self.columns, self.rows) = (cells(width), cells(height));
        self.bounds = bounds;
        self.cells_per_px = [
            self.columns as f32 / width.max(1.0),
            self.rows as f32 / height.max(1.0),
        ];
        self.starts.clear();
        self.starts.resize(self.columns * self.rows + 1, 0);
        let known = || {
            let all = positions.iter().zip(levels).take(MAX_POSITIONS).enumerate();
            all.filter(|(_, (position, _))| position[0].is_finite() && position[1].is_finite())
        };
        for (_, (position, _)) in known() {
            let cell = self.cell_of(position[0], position[1]);
            // Shifted by one, so that running sums give the starts of cells.
            self.starts[cell + 1] += 1;
        }
        for cell in 1..self.starts.len() {
            self.starts[cell] += self.starts[cell - 1];
        }
        let total = usize::from(*self.starts.last().unwrap_or(&0));
        self.indices.clear();
        self.indices.resize(total, 0);
        self.levels.clear();
        self.levels.resize(total, 0);
        for (index, (position, &level)) in known() {
            let cell = self.cell_of(position[0], position[1]);
            let slot = &mut self.starts[cell];
            self.indices[usize::from(*slot)] = index as u16;
            self.levels[usize::from(*slot)] = level;
            *slot += 1;
        }
        // Every start is now its cell's end, i.e. the start of the next.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// The bounds it was built with, px: min x, min y, max x, max y.
    #[must_use]
    pub fn bounds(&self) -> [f32; 4] {
        self.bounds
    }

    /// Number of positions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// Memory, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + 2 * (self.starts.len() + self.indices.len()) + self.levels.len()
    }

    /// Calls `f` with the index of each position at most `radius` px from (x, y) in Euclidean distance whose level is
    /// in `levels`, cell by cell and within a cell by index. `positions` must be those it was built from.
    pub fn for_each_in(
        &self,
        positions: &[[f32; 2]],
        x: f32,
        y: f32,
        radius: f32,
        levels: RangeInclusive<u8>,
        mut f: impl FnMut(u32),
    ) {
        let window = Window {
            x,
            y,
            radius,
            min_level: *levels.start(),
            max_level: *levels.end(),
        };
        self.for_each_with_level(positions, &window, |index, _| f(index));
    }

    /// As [`FeatureGrid::for_each_in`], with the level.
    #[inline]
    pub(crate) fn for_each_with_level(
        &self,
        positions: &[[f32; 2]],
        window: &Window,
        mut f: impl FnMut(u32, u8),
    ) {
        let Window { x, y, radius, .. } = *window;
        let levels = window.min_level..=window.max_level;
        if self.indices.is_empty() || !(x.is_finite() && y.is_finite() && radius >= 0.0) {
            return;
        }
        let (left, right) = (self.column_of(x - radius), self.column_of(x + radius));
        let (top, bottom) = (self.row_of(y - radius), self.row_of(y + radius));
        let limit = radius * radius;
        for row in top..=bottom {
            // Cells of a row are adjacent in memory.
            let begin = usize::from(self.starts[row * self.columns + left]);
            let end = usize::from(self.starts[row * self.columns + right + 1]);
            for (index, level) in self.indices[begin..end]
                .iter()
                .zip(&self.levels[begin..end])
            {
                let Some([px, py]) = positions.get(usize::from(*index)) else {
                    continue;
                };
                let (dx, dy) = (px - x, py - y);
                if dx * dx + dy * dy <= limit && levels.contains(level) {
                    f(u32::from(*index), *level);
                }
            }
        }
    }

    fn column_of(&self, x: f32) -> usize {
        // The cast saturates, so distant positions fall into border cells.
        (((x - self.bounds[0]) * self.cells_per_px[0]) as usize).min(self.columns - 1)
    }

    fn row_of(&self, y: f32) -> usize {
        (((y - self.bounds[1]) * self.cells_per_px[1]) as usize).min(self.rows - 1)
    }

    fn cell_of(&self, x: f32, y: f32) -> usize {
        self.row_of(y) * self.columns + self.column_of(x)
    }
}
