//! How many keypoints the next image is asked for: more of them where few of the last ones held on to the map.

/// Inliers that are enough, in multiples of the fewest that make a pose: where 120 agree, more keypoints change nothing, and poses with five times as
/// many are as accurate (decision 17).
const ENOUGH: f64 = 4.0;
/// More keypoints than wanted, at most, a factor. What is found only among more of them makes landmarks that are not found again; twice as many are
/// as accurate and cost up to twice the time (decision 17).
const MOST_TIMES: f64 = 1.4;

/// How many keypoints the next image is asked for.
///
/// Of the keypoints, only those on what stands still and is mapped are of use. Where people fill the image, or where it is blurred, the
/// wanted number leaves too few of them, and tracking would be lost, so more are asked for, as many as the last image lacked.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    wanted: usize,
    /// Inliers of the last image, none before there was a map.
    found: Option<u32>,
}

impl Demand {
    pub(super) fn new(wanted: usize) -> Self {
        Self {
            wanted,
            found: None,
        }
    }

    /// Keypoints wanted where enough of them hold.
    pub(super) fn set(&mut self, wanted: usize) {
        self.wanted = wanted;
    }

    /// Takes note of how many keypoints of an image agreed with its pose: 0 where there was no pose, none where there was no map to agree with.
    pub(super) fn note_inliers(&mut self, inliers: Option<u32>) {
        self.found = inliers;
    }

    /// Keypoints to ask of the next image, where a pose needs `min_inliers`.
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
    fn nothing_more_is_asked_for_where_enough_holds() {
        let mut demand = Demand::new(1000);
        assert_eq!(demand.next(30), 1000);
        demand.note_inliers(Some(120));
        assert_eq!(demand.next(30), 1000);
        demand.note_inliers(Some(5000));
        assert_eq!(demand.next(30), 1000);
    }

    #[test]
    fn more_is_asked_for_as_the_last_image_lacked() {
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
