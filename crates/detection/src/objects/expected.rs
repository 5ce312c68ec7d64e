//! Where an object is expected in an image.

use super::fit::CHI2_99;
use super::measurement::Measurement;
use super::spatial::Projection;
use super::view::Sides;
use crate::BoundingBox;

/// Where a track is expected in an image: computed once for all that it is compared with.
#[derive(Clone, Debug)]
pub(super) struct Expected {
    /// Of an object in space, unless it is behind the camera.
    pub(super) projection: Option<Projection>,
    /// Box in the raw image; without area when it is outside.
    pub(super) bounds: BoundingBox,
    /// Standard deviation of the depth, m.
    pub(super) depth_sigma: f64,
    /// Sides of the box, undistorted px, and the variance of each; none behind the camera.
    pub(super) sides: Option<(Sides, [f64; 4])>,
}

impl Expected {
    /// Depth in this camera, m.
    pub(super) fn depth(&self) -> Option<f64> {
        self.projection.as_ref().map(|p| p.z)
    }

    /// Whether a detection lies so far beside the box that one side alone is outside all gates. Only what depends on nobody else is looked at.
    pub(super) fn is_far_from(&self, m: &Measurement, share: f64) -> bool {
        let Some((sides, variances)) = &self.sides else {
            return false;
        };
        let beside = |axis: usize| {
            let (low, high) = (axis, axis + 2);
            // The side of the box that the detection is beyond: it binds at the border of the image, too.
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
