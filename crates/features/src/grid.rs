//! Which keypoints are near a position.

use std::ops::RangeInclusive;

use crate::Window;

/// Side of a cell, px: search windows are 10 to 100 px wide.
const CELL: f32 = 16.0;
/// Cells per side at most, so that odd bounds do not ask for absurd memory.
const MAX_CELLS: usize = 512;

/// Keypoint indices in square cells. Positions outside the bounds are held by the nearest cell at the border and are found all the same.
#[derive(Clone, Debug, Default)]
pub struct FeatureGrid {
    bounds: [f32; 4],
    cells_per_px: [f32; 2],
    columns: usize,
    rows: usize,
    /// `starts[c]..starts[c + 1]` is the part of `entries` in cell `c`.
    starts: Vec<u32>,
    entries: Vec<Entry>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    x: f32,
    y: f32,
    index: u32,
    level: u8,
}

impl FeatureGrid {
    /// A grid of `positions` (px) with their `levels`; `bounds` are min x, min y, max x, max y. Positions that are not finite are left out, and of
    /// lists of different length the common part is taken.
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
            let all = positions.iter().zip(levels).enumerate();
            all.filter(|(_, (position, _))| position[0].is_finite() && position[1].is_finite())
        };
        for (_, (position, _)) in known() {
            let cell = self.cell_of(position[0], position[1]);
            // Counted one place further on, so that running sums give where cells begin.
            self.starts[cell + 1] += 1;
        }
        for cell in 1..self.starts.len() {
            self.starts[cell] += self.starts[cell - 1];
        }
        let total = *self.starts.last().unwrap_or(&0) as usize;
        self.entries.clear();
        self.entries.resize(total, Entry::default());
        for (index, (position, &level)) in known() {
            let cell = self.cell_of(position[0], position[1]);
            let slot = &mut self.starts[cell];
            self.entries[*slot as usize] = Entry {
                x: position[0],
                y: position[1],
                index: index as u32,
                level,
            };
            *slot += 1;
        }
        // Every start now is its cell's end, i.e. the start of the next.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// The bounds it was built with, px: min x, min y, max x, max y.
    #[must_use]
    pub fn bounds(&self) -> [f32; 4] {
        self.bounds
    }

    /// Number of positions held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Calls `f` with the index of each position at most `radius` px from (x, y) in Euclidean distance whose level is in `levels`, cell by cell and
    /// within a cell by index.
    pub fn for_each_in(
        &self,
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
        self.for_each_with_level(&window, |index, _| f(index));
    }

    /// As [`FeatureGrid::for_each_in`], passing the level along.
    pub(crate) fn for_each_with_level(&self, window: &Window, mut f: impl FnMut(u32, u8)) {
        let Window { x, y, radius, .. } = *window;
        let levels = window.min_level..=window.max_level;
        if self.entries.is_empty() || !(x.is_finite() && y.is_finite() && radius >= 0.0) {
            return;
        }
        let (left, right) = (self.column_of(x - radius), self.column_of(x + radius));
        let (top, bottom) = (self.row_of(y - radius), self.row_of(y + radius));
        let limit = radius * radius;
        for row in top..=bottom {
            // Cells of a row are adjacent in memory.
            let begin = self.starts[row * self.columns + left] as usize;
            let end = self.starts[row * self.columns + right + 1] as usize;
            for entry in &self.entries[begin..end] {
                let (dx, dy) = (entry.x - x, entry.y - y);
                if dx * dx + dy * dy <= limit && levels.contains(&entry.level) {
                    f(entry.index, entry.level);
                }
            }
        }
    }

    fn column_of(&self, x: f32) -> usize {
        // The cast saturates, so far positions land in the border cells.
        (((x - self.bounds[0]) * self.cells_per_px[0]) as usize).min(self.columns - 1)
    }

    fn row_of(&self, y: f32) -> usize {
        (((y - self.bounds[1]) * self.cells_per_px[1]) as usize).min(self.rows - 1)
    }

    fn cell_of(&self, x: f32, y: f32) -> usize {
        self.row_of(y) * self.columns + self.column_of(x)
    }
}
