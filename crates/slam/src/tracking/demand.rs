//! Number of keypoints to extract from the next image, adapted to the last inliers.

/// Sufficient number of inliers, in multiples of the minimum for a pose: where 120 agree, more keypoints change
/// nothing, and poses with five times as many are as accurate (decision 17).
const ENOUGH: f64 = 4.0;
/// Maximum increase of the number of keypoints, a factor. Corners that are only found among more keypoints make
/// landmarks that are not found again; twice as many are as accurate and cost up to twice the time (decision 17).
const MOST_TIMES: f64 = 1.4;

/// Number of keypoints to extract from the next image.
///
/// Only keypoints on static, mapped surfaces are useful. Where people fill the image, or it is blurred, the usual
/// number leaves too few, so more are extracted in proportion to the shortage in the last image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    wanted: usize,
    /// Inliers of the last image; `None` before there was a map.
    found: Option<u32>,
}

impl Demand {
    pub(super) fn new(wanted: usize) -> Self {
        Self {
            wanted,
            found: None,
        }
    }

    /// Sets the usual number of keypoints.
    pub(super) fn set(&mut self, wanted: usize) {
        self.wanted = wanted;
    }

    /// Records the inliers of an image: 0 without a pose, `None` without a map.
    pub(super) fn note_inliers(&mut self, inliers: Option<u32>) {
        self.found = inliers;
    }

    /// Number of keypoints for the next image, if a pose needs `min_inliers`.
    pub(super) fn next(&self, min_inliers: usize) -> usize {
        let Some(found) = self.found else {
            return self.wanted;
        };
        let lack = ENOUGH * min_inliers as f64 / f64::from(found.max(1));
        (self.wanted as f64 * lack.clamp(1.0, MOST_TIMES)) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn demand_is_unchanged_with_enough_inliers() {
        let mut demand = Demand::new(1000);
        assert_eq!(demand.next(30), 1000);
        demand.note_inliers(Some(120));
        assert_eq!(demand.next(30), 1000);
        demand.note_inliers(Some(5000));
        assert_eq!(demand.next(30), 1000);
    }

    #[test]
    fn demand_grows_with_missing_inliers() {
        let mut demand = Demand::new(300);
        for (found, asked) in [(119, 302), (100, 360), (60, 420), (30, 420), (0, 420)] {
            demand.note_inliers(Some(found));
            assert_eq!(demand.next(30), asked, "{found} found");
        }
        demand.set(1000);
        for (found, asked) in [(100, 1200), (80, 1400), (0, 1400)] {
            demand.note_inliers(Some(found));
            assert_eq!(demand.next(30), asked, "{found} found");
        }
        demand.note_inliers(None);
        assert_eq!(demand.next(30), 1000);
    }
}
