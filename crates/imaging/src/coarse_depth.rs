//! A depth image reduced to cells: what depth-connected regions and moving things are looked for in.

use crate::DepthImage;

/// Samples that differ by at most this share of their depth are of one surface.
const ONE_SURFACE: f32 = 0.03;

/// One depth per square cell of the image; 0 where most of the cell has none.
///
/// A cell's depth is the mean of the valid ones among 16 samples when they are of one surface, else their median: at an
/// edge it is the depth of one side, never a mean of the two.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoarseDepth {
    cell: usize,
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl CoarseDepth {
    /// Reduces a depth image to cells of `cell` x `cell` px (at least 4); a remainder at the right and bottom is left out.
    #[must_use]
    pub fn new(depth: &DepthImage, cell: usize) -> Self {
        // A larger cell than any image has none either.
        let cell = cell.clamp(4, 1 << 24);
        let (width, height) = (depth.width() / cell, depth.height() / cell);
        let mut data = Vec::with_capacity(width * height);
        let offsets = [0, 1, 2, 3].map(|i| (2 * i + 1) * cell / 8);
        for y in 0..height {
            let rows = offsets.map(|o| {
                let start = (y * cell + o) * depth.width();
                &depth.data()[start..start + depth.width()]
            });
            for x in 0..width {
                data.push(cell_depth(&rows, x * cell, offsets));
            }
        }
        Self {
            cell,
            width,
            height,
            data,
        }
    }

    /// Side of a cell, px.
    #[must_use]
    pub fn cell(&self) -> usize {
        self.cell
    }

    /// Number of cells in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows of cells.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Depths, m, row by row; 0 where there is none.
    #[must_use]
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Depth of a cell, m; `None` where there is none or outside.
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> Option<f32> {
        let inside = x < self.width && y < self.height;
        inside
            .then(|| self.data[y * self.width + x])
            .filter(|z| *z > 0.0)
    }

    /// The raw pixel at the middle of a cell.
    #[must_use]
    #[inline]
    pub fn centre(&self, x: usize, y: usize) -> [f64; 2] {
        let size = self.cell as f64;
        let middle = |i: usize| (i as f64 + 0.5) * size - 0.5;
        [middle(x), middle(y)]
    }
}

/// The depth of one cell from four of its rows, at `offsets` from column `x`.
fn cell_depth(rows: &[&[f32]; 4], x: usize, offsets: [usize; 4]) -> f32 {
    let (mut near, mut far, mut sum, mut count) = (f32::MAX, 0.0_f32, 0.0_f32, 0_u32);
    for row in rows {
        for o in offsets {
            // Without a branch: holes lie where no predictor expects them.
            let z = row[x + o];
            let valid = (z > 0.0) & (z < f32::INFINITY);
            near = near.min(if valid { z } else { f32::MAX });
            far = far.max(if valid { z } else { 0.0 });
            sum += if valid { z } else { 0.0 };
            count += u32::from(valid);
        }
    }
    if count < 4 {
        return 0.0;
    }
    if far - near <= ONE_SURFACE * near {
        return sum / count as f32;
    }
    let mut found = [f32::MAX; 16];
    let samples = rows.iter().flat_map(|row| offsets.map(|o| row[x + o]));
    let valid = samples.filter(|z| *z > 0.0 && *z < f32::INFINITY);
    for (slot, z) in found.iter_mut().zip(valid) {
        *slot = z;
    }
    let count = count as usize;
    let (_, median, _) = found[..count].select_nth_unstable_by(count / 2, f32::total_cmp);
    *median
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(f: impl Fn(usize, usize) -> f32) -> DepthImage {
        let data = (0..24).flat_map(|y| (0..32).map(move |x| (x, y)));
        DepthImage::from_vec(32, 24, data.map(|(x, y)| f(x, y)).collect()).unwrap()
    }

    #[test]
    fn takes_one_side_of_an_edge() {
        let coarse = CoarseDepth::new(&image(|x, _| if x < 11 { 1.0 } else { 3.0 }), 8);
        assert_eq!((coarse.width(), coarse.height()), (4, 3));
        assert!(coarse.data().iter().all(|z| *z == 1.0 || *z == 3.0));
        assert_eq!(coarse.get(0, 0), Some(1.0));
        assert_eq!(coarse.get(3, 2), Some(3.0));
        assert_eq!(coarse.get(4, 0), None);
    }

    #[test]
    fn ignores_missing_and_broken_depths() {
        let coarse = CoarseDepth::new(
            &image(|x, y| match (x, y % 4) {
                (0..8, _) => 0.0,
                (_, 0) => f32::NAN,
                (_, 1) => 0.0,
                _ => 2.0,
            }),
            8,
        );
        assert_eq!(coarse.get(0, 1), None);
        assert_eq!(coarse.get(2, 1), Some(2.0));
    }

    #[test]
    fn the_middle_of_a_cell_is_between_its_pixels() {
        let coarse = CoarseDepth::new(&image(|_, _| 1.0), 8);
        // Pixels 0 to 7, 24 to 31 and 16 to 23.
        assert_eq!(coarse.centre(0, 0), [3.5, 3.5]);
        assert_eq!(coarse.centre(3, 2), [27.5, 19.5]);
    }
}
