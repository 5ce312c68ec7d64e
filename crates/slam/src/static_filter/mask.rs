//! The regions that move as an image: pixel by pixel, by the surface that each pixel shows.

use super::{Segments, cells};
use stillpoint_imaging::{DepthImage, GrayImage};

/// What a mask holds where the scene moves; 0 where it stands still.
const MOVING: u8 = 255;

impl Segments {
    /// An image of `depth`'s size: 255 where the scene moves, 0 where it stands still or nothing is known. `depth` is that of the
    /// frame that the regions are of.
    ///
    /// A pixel belongs to the cell around it whose depth is nearest to its own, so that the border of the mask is that of the
    /// surface and not that of cells. A pixel without depth belongs to the cell that it lies in.
    #[must_use]
    pub fn mask(&self, depth: &DepthImage) -> GrayImage {
        let (width, height) = (depth.width(), depth.height());
        let mut mask = GrayImage::new(width, height);
        if self.labels.iter().all(|l| *l == 0) {
            return mask;
        }
        let grid = cells::coarse(depth);
        let around = |cell: usize, end: usize| cell.saturating_sub(1)..(cell + 2).min(end);
        for y in 0..height {
            for x in 0..width {
                let home = (x / self.cell_px, y / self.cell_px);
                let z = depth.at(x, y);
                // Of a cell's width the surface itself may slope by this much.
                let mut nearest = (0.05 + 0.03 * z, None);
                for j in around(home.1, self.height) {
                    for i in around(home.0, self.width) {
                        let other = grid.get(i, j).unwrap_or(0.0);
                        let gap = (other - z).abs() + if (i, j) == home { 0.0 } else { 0.01 };
                        if z > 0.0 && other > 0.0 && gap < nearest.0 {
                            nearest = (gap, Some((i, j)));
                        }
                    }
                }
                let (i, j) = match nearest.1 {
                    Some(cell) => cell,
                    None if z > 0.0 => continue,
                    None => home,
                };
                if i < self.width && self.labels.get(j * self.width + i).is_some_and(|l| *l > 0) {
                    mask.data_mut()[y * width + x] = MOVING;
                }
            }
        }
        mask
    }
}
