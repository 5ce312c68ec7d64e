//! What the tracker saw of a frame beside its pose: what the quality of the pose is judged by.
//!
//! Answers: how many matches agreed, where in the image they lie, how certain the pose is. Draws no conclusions, which is the
//! business of [`HealthMonitor`](crate::HealthMonitor).

use stillpoint_geometry::Mat6;
use stillpoint_map::{KeyframeData, KeyframeId};

/// What tracking notes of a frame on its way.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Whether the static filter was asked.
    pub judged: bool,
    /// Matches that the pose was sought from.
    pub matched: u32,
    /// Of these, the ones that agree with it.
    pub agreed: u32,
    /// Where they lie.
    pub cells: Cells,
    /// Inverse covariance of the pose, as a twist `[translation; rotation]` in the axes of the camera (m, rad); none where no
    /// pose was optimised.
    pub information: Option<Mat6>,
    /// How the matches that tell it scatter; none where others than matches do.
    pub scatter: Option<Scatter>,
    /// The keyframe that the pose was measured from.
    pub reference: Option<KeyframeId>,
    /// Whether there was a map to be tracked in.
    pub has_map: bool,
}

/// How the matches of a pose scatter about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Mean squared residual of their pixel coordinates, by the variance that was stated.
    pub variance: f64,
    /// Number of matches.
    pub count: u32,
}

/// Which of the 8x6 cells of an image have an inlier: a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cells(u64);

impl Cells {
    /// Cells across the image, a number: chosen, so that a cell is 80 px wide at 640x480, and all cells fit into 64 bits.
    const COLUMNS: u32 = 8;
    /// Cells down the image, a number: three quarters of [`Self::COLUMNS`], so that cells of an image of 4:3 are squares.
    const ROWS: u32 = 6;
    /// Number of cells: the product of both, 48.
    pub const COUNT: u32 = Self::COLUMNS * Self::ROWS;

    /// Number of cells in the set.
    #[must_use]
    pub fn count(self) -> u32 {
        self.0.count_ones()
    }

    /// The cells of the features for which `is_inlier` holds.
    pub(crate) fn of(data: &KeyframeData, is_inlier: impl Fn(usize) -> bool) -> Self {
        let mut cells = Self::default();
        let (width, height) = (data.camera.width, data.camera.height);
        for (i, k) in data.keypoints.iter().enumerate() {
            if is_inlier(i) {
                cells.add([k.x, k.y], width, height);
            }
        }
        cells
    }

    /// Adds the cell of a raw pixel of an image of this size, px.
    fn add(&mut self, pixel: [f32; 2], width: u32, height: u32) {
        let cell = |at: f32, size: u32, cells: u32| {
            // What lies outside counts as at the border; a cast takes what is negative or no number to 0.
            let i = (at / size.max(1) as f32 * cells as f32) as u32;
            i.min(cells - 1)
        };
        let column = cell(pixel[0], width, Self::COLUMNS);
        let row = cell(pixel[1], height, Self::ROWS);
        self.0 |= 1 << (row * Self::COLUMNS + column);
    }
}

#[cfg(test)]
impl Cells {
    /// The cells of the bits that are set.
    pub(crate) fn of_bits(bits: u64) -> Self {
        Self(bits & ((1 << Self::COUNT) - 1))
    }

    pub(crate) fn bits(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_pixel_has_a_cell(x in any::<f32>(), y in any::<f32>(), w in any::<u32>(), h in any::<u32>()) {
            let mut cells = Cells::default();
            cells.add([x, y], w, h);
            prop_assert_eq!(cells.0.count_ones(), 1);
            prop_assert!(cells.0 >> Cells::COUNT == 0);
        }
    }

    #[test]
    fn cells_tell_where_inliers_lie() {
        let mut cells = Cells::default();
        for i in 0..640 {
            cells.add([i as f32, 10.0], 640, 480);
        }
        assert_eq!(cells.0, 0xff);
        for i in 0..480 {
            cells.add([639.0, i as f32], 640, 480);
        }
        assert_eq!(cells.0.count_ones(), 8 + 5);
    }
}
