//! Predicted appearance of a track in an image.

use super::fit::CHI2_99;
use super::measurement::Measurement;
use super::spatial::Projection;
use super::view::Sides;
use crate::BoundingBox;

/// Predicted appearance of a track, computed once for all comparisons.
#[derive(Clone, Debug)]
pub(super) struct Expected {
    /// Of an object with depth, unless behind the camera.
    pub(super) projection: Option<Projection>,
    /// Box in the raw image; empty when outside.
    pub(super) bounds: BoundingBox,
    /// Standard deviation of the depth, m.
    pub(super) depth_sigma: f64,
    /// Sides of the box, undistorted px, with their variances; `None` behind the camera.
    pub(super) sides: Option<(Sides, [f64; 4])>,
}

impl Expected {
    /// Depth in this camera, m.
    pub(super) fn depth(&self) -> Option<f64> {
        self.projection.as_ref().map(|p| p.z)
    }

    /// Whether one side alone of a distant detection fails all gates. Uses only quantities that do not depend
    /// on other tracks.
    pub(super) fn is_far_from(&self, m: &Measurement, share: f64) -> bool {
        let Some((sides, variances)) = &self.sides else {
            return false;
        };
        let beside = |axis: usize| {
            let (low, high) = (axis, axis + 2);
            // The nearest side of the predicted box: it is valid at the image border, too.
            let side = if m.sides[low] > sides[high] {
                high
            } else if m.sides[high] < sides[low] {
                low
            } else {
                return false;
            };
            let error = m.sides[side] - sides[side];
            error * error > CHI2_99[5] * (variances[side] + m.side_variance(axis, sides, share))
        };
        (beside(0) || beside(1)) && self.bounds.iou(&m.detection.bounds) <= 0.0
    }
}
