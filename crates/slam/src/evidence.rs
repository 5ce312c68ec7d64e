//! Tracking statistics of a frame, from which [`HealthMonitor`](crate::HealthMonitor) judges the quality of its pose.

use stillpoint_geometry::Mat6;
use stillpoint_map::{KeyframeData, KeyframeId};

/// Tracking statistics of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Whether the static filter ran.
    pub judged: bool,
    /// Matches used to estimate the pose.
    pub matched: u32,
    /// Inliers among them.
    pub agreed: u32,
    /// Image cells with inliers.
    pub cells: Cells,
    /// Inverse covariance of the pose, as a twist `[translation; rotation]` in camera axes (m, rad); `None` if no pose
    /// was optimised.
    pub information: Option<Mat6>,
    /// Scatter of the matches; `None` if the pose does not come from matches.
    pub scatter: Option<Scatter>,
    /// Keyframe relative to which the pose was measured.
    pub reference: Option<KeyframeId>,
    /// Whether a map existed.
    pub has_map: bool,
}

/// Scatter of the matches of a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Mean squared residual of their pixel coordinates, relative to the stated variance.
    pub variance: f64,
    /// Number of matches.
    pub count: u32,
}

/// The set of the 8x6 image cells that have an inlier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cells(u64);

impl Cells {
    /// Cells across the image: chosen, so that a cell is 80 px wide at 640x480 and all cells fit into 64 bits.
    const COLUMNS: u32 = 8;
    /// Cells down the image: three quarters of [`Self::COLUMNS`], so that cells of a 4:3 image are square.
    const ROWS: u32 = 6;
    /// Number of cells: the product of both, 48.
    pub const COUNT: u32 = Self::COLUMNS * Self::ROWS;

    /// Number of cells in the set.
    #[must_use]
    pub fn count(self) -> u32 {
        self.0.count_ones()
    }

    /// Cells of the features for which `is_inlier` holds.
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

    fn add(&mut self, pixel: [f32; 2], width: u32, height: u32) {
        let cell = |at: f32, size: u32, cells: u32| {
            // Pixels outside count to the border cells; the cast maps negative values and NaN to 0.
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
        fn every_pixel_maps_to_exactly_one_cell(x in any::<f32>(), y in any::<f32>(), w in any::<u32>(), h in any::<u32>()) {
            let mut cells = Cells::default();
            cells.add([x, y], w, h);
            prop_assert_eq!(cells.0.count_ones(), 1);
            prop_assert!(cells.0 >> Cells::COUNT == 0);
        }
    }

    #[test]
    fn occupied_cells_match_inlier_positions() {
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
