//! Pixel masks of moving regions.

use super::outline::{STEP, Window, refine};
use super::sides::Sample;
use super::things::things;
use super::{Segments, cells};
use stillpoint_imaging::{CoarseDepth, DepthImage, GrayImage, RgbdFrame};

/// Mask value of moving pixels, the largest number of 8 bits (docs/masks.md); static ones are 0.
const MOVING: u8 = 255;
/// Margin of cells around a region that its outline may reach, cells: 40 px, chosen above the sum of the filter's 20 px
/// and the 10 px of a near person who walks between depth and image.
const MARGIN: usize = 5;
/// Depth difference by which a pixel's own cell is preferred to those around it, m: a Kinect's noise at 2 m (Khoshelham
/// and Elberink, Sensors 2012).
const OTHER: f32 = 0.01;
/// Weight of a pixel without a known surface, relative to 1 of the others, chosen: holes do not fill a region.
const UNKNOWN: f32 = 0.1;

impl Segments {
    /// Mask of `frame`, of which these are the segments: 255 where the scene moves, 0 where it is static or unknown.
    ///
    /// A pixel belongs to the neighbouring cell whose depth is nearest to its own; without depth, to the cell that it
    /// lies in. A guided filter then aligns the outline with image edges and smooths it. A region that is not separated
    /// from the surface around it is part of a wall, and is omitted.
    #[must_use]
    pub fn mask(&self, frame: &RgbdFrame) -> GrayImage {
        let depth = &frame.depth;
        let mut mask = GrayImage::new(depth.width(), depth.height());
        if self.labels.iter().all(|l| *l == 0) {
            return mask;
        }
        let grid = cells::coarse(depth);
        // Regions of an image of another size do not apply.
        if (self.width, self.labels.len()) != (grid.width(), grid.data().len()) {
            return mask;
        }
        let things = things(self, &grid);
        let Some(window) = self.window(&things, depth) else {
            return mask;
        };
        let rough = self.rough(&things, (depth, &grid), &window);
        let refined = refine(&frame.gray, &window, rough);
        let width = mask.width();
        let inside = refined.chunks_exact(window.columns.len());
        for (y, inside) in window.rows.clone().zip(inside) {
            let row = &mut mask.data_mut()[y * width..][window.columns.clone()];
            for (pixel, inside) in row.iter_mut().zip(inside) {
                *pixel = if *inside { MOVING } else { 0 };
            }
        }
        mask
    }

    /// The pixels around all cells of things; `None` if there are none.
    fn window(&self, things: &[bool], depth: &DepthImage) -> Option<Window> {
        let cells = || (0..things.len()).filter(|i| things[*i]);
        let range = |of: &dyn Fn(usize) -> usize, count: usize, end: usize| {
            let (first, last) = (cells().map(of).min()?, cells().map(of).max()?);
            // Pixels beyond the last whole cell are included with it.
            let whole = last + 1 + MARGIN >= count;
            let end = if whole {
                end
            } else {
                (last + 1 + MARGIN) * self.cell_px
            };
            Some(first.saturating_sub(MARGIN) * self.cell_px..end)
        };
        Some(Window {
            columns: range(&|i| i % self.width, self.width, depth.width())?,
            rows: range(&|i| i / self.width, self.height, depth.height())?,
        })
    }

    /// Weights from depth for the samples of a window.
    fn rough(
        &self,
        things: &[bool],
        (depth, grid): (&DepthImage, &CoarseDepth),
        window: &Window,
    ) -> Vec<Sample> {
        let [w, h] = window.samples();
        let mut samples = vec![Sample::default(); w * h];
        let near: Vec<bool> = (0..things.len())
            .map(|i| {
                self.around((i % self.width, i / self.width))
                    .any(|j| things[j])
            })
            .collect();
        for (j, y) in window.rows.clone().enumerate() {
            let samples = &mut samples[j / STEP * w..][..w];
            let depths = &depth.data()[y * depth.width()..][window.columns.clone()];
            // Windows begin with a cell, and cells are whole samples.
            for (i, (sample, depths)) in samples.iter_mut().zip(depths.chunks(STEP)).enumerate() {
                let first = (window.columns.start + i * STEP, y);
                let home = self.home(first);
                if home.is_some_and(|home| !near[home]) {
                    let known = depths.iter().map(|z| if *z > 0.0 { 1.0 } else { UNKNOWN });
                    sample.weight += known.sum::<f32>();
                    continue;
                }
                for z in depths {
                    let surface = self.surface_of(first, home, *z, grid);
                    let weight = if surface.is_some() { 1.0 } else { UNKNOWN };
                    let cell = surface.or(home.filter(|_| *z <= 0.0));
                    sample.weight += weight;
                    sample.inside += cell.filter(|c| things[*c]).map_or(0.0, |_| weight);
                }
            }
        }
        samples
    }

    /// The cell of a pixel; `None` beyond the last whole cell.
    fn home(&self, (x, y): (usize, usize)) -> Option<usize> {
        let (i, j) = (x / self.cell_px, y / self.cell_px);
        (i < self.width && j < self.height).then_some(j * self.width + i)
    }

    fn around(&self, (i, j): (usize, usize)) -> impl Iterator<Item = usize> {
        let range = |v: usize, end: usize| v.saturating_sub(1)..(v + 2).min(end);
        let (columns, width) = (range(i, self.width), self.width);
        range(j, self.height).flat_map(move |j| columns.clone().map(move |i| j * width + i))
    }

    /// The cell whose surface a pixel of depth `z` shows, given a pixel in its cell and the cell `home`; `None` without
    /// depth, or if no neighbouring cell matches.
    fn surface_of(
        &self,
        pixel: (usize, usize),
        home: Option<usize>,
        z: f32,
        grid: &CoarseDepth,
    ) -> Option<usize> {
        let depths = grid.data();
        let gap = |cell: usize| (depths[cell] - z).abs();
        if z <= 0.0 {
            return None;
        }
        // No other cell can be nearer after the penalty.
        if let Some(home) = home.filter(|h| depths[*h] > 0.0 && gap(*h) <= OTHER) {
            return Some(home);
        }
        // Slope of a surface within a cell.
        let mut nearest = (0.05 + 0.03 * z, None);
        for cell in self.around((pixel.0 / self.cell_px, pixel.1 / self.cell_px)) {
            let gap = gap(cell) + if Some(cell) == home { 0.0 } else { OTHER };
            if depths[cell] > 0.0 && gap < nearest.0 {
                nearest = (gap, Some(cell));
            }
        }
        nearest.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::FrameId;

    const W: usize = 160;
    const H: usize = 120;
    const CELLS: [usize; 2] = [20, 15];

    /// A round body in front of a wall.
    fn person(x: usize, y: usize) -> bool {
        let [dx, dy] = [x as f64 - 81.3, y as f64 - 58.7];
        dx * dx / (27.0 * 27.0) + dy * dy / (38.0 * 38.0) < 1.0
    }

    fn frame(depth: impl Fn(usize, usize) -> f32) -> RgbdFrame {
        let pixels = || (0..W * H).map(|i| (i % W, i / W));
        let noise = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 23) as u8;
        let grey = |(x, y)| if person(x, y) { 70 } else { 150 } + noise(x, y);
        RgbdFrame {
            id: FrameId(0),
            stamp: 0.0,
            depth_stamp: 0.0,
            gray: GrayImage::from_vec(W, H, pixels().map(grey).collect()).unwrap(),
            colour: None,
            depth: DepthImage::from_vec(W, H, pixels().map(|(x, y)| depth(x, y)).collect())
                .unwrap(),
        }
    }

    /// A region of all cells whose centres satisfy `chosen`.
    fn segments(chosen: impl Fn(usize, usize) -> bool) -> Segments {
        let middle = |i: usize| (i % CELLS[0] * 8 + 4, i / CELLS[0] * 8 + 4);
        let label = |i: usize| u16::from(chosen(middle(i).0, middle(i).1));
        Segments {
            cell_px: 8,
            width: CELLS[0],
            height: CELLS[1],
            labels: (0..CELLS[0] * CELLS[1]).map(label).collect(),
            seen: [].into(),
        }
    }

    fn wrong(mask: &GrayImage) -> usize {
        let is = |i: &usize| (mask.data()[*i] > 0) != person(i % W, i / W);
        (0..W * H).filter(is).count()
    }

    #[test]
    fn mask_outline_is_accurate_despite_ragged_depth() {
        let torn = |x: usize, y: usize| (x * 31 + y * 17).is_multiple_of(5);
        let depth = |x: usize, y: usize| match person(x, y) {
            true => 1.5,
            // Depth shadow beside the foreground.
            false if x < 81 && person(x + 6, y) => 0.0,
            false if torn(x, y) && person(x.saturating_sub(3), y) => 1.5,
            false => 3.0,
        };
        let mask = segments(person).mask(&frame(depth));
        // Of 3200 px and an outline of 205.
        assert!(wrong(&mask) < 60, "{} px", wrong(&mask));
        let (labels, cells) = (segments(person).labels, |i: usize| {
            i % W / 8 + i / W / 8 * CELLS[0]
        });
        let coarse = (0..W * H).map(|i| if labels[cells(i)] > 0 { MOVING } else { 0 });
        let coarse = GrayImage::from_vec(W, H, coarse.collect()).unwrap();
        assert!(wrong(&coarse) > 300, "{} px", wrong(&coarse));
    }

    #[test]
    fn wall_patch_is_not_masked() {
        let masked = |found: Segments, depth: fn(usize, usize) -> f32| {
            let mask = found.mask(&frame(depth));
            mask.data().iter().filter(|v| **v > 0).count()
        };
        assert_eq!(masked(segments(person), |_, _| 3.0), 0);
        assert_eq!(masked(segments(|_, _| false), |_, _| 3.0), 0);
        // Likewise for a region behind something else.
        let behind = |x, y| if person(x, y) { 3.0 } else { 1.5 };
        assert_eq!(masked(segments(person), behind), 0);
        let before = |x, y| if person(x, y) { 1.5 } else { 3.0 };
        assert!(masked(segments(person), before) > 3000);
        // A background too far to be measured separates as well.
        let alone = |x: usize, y: usize| match person(x, y) {
            true => 1.4 + (x as f32 - 81.0) * (x as f32 - 81.0) / 3600.0,
            false => 0.0,
        };
        let found = masked(segments(person), alone);
        assert!(found > 2500, "{found}");
    }

    #[test]
    fn image_borders_beyond_whole_cells_are_masked() {
        let mut found = frame(|_, _| 1.0);
        let (w, h) = (W + 5, H + 3);
        found.gray = GrayImage::new(w, h);
        let depth = (0..w * h).map(|i| if i % w < 40 { 3.0 } else { 1.5 });
        found.depth = DepthImage::from_vec(w, h, depth.collect()).unwrap();
        let mask = segments(|x, _| x >= 40).mask(&found);
        let row = |y: usize| mask.row(y).iter().filter(|v| **v > 0).count();
        for y in 0..h {
            assert!((123..=127).contains(&row(y)), "{y}: {}", row(y));
        }
    }
}
