//! What flow says of a feature.

use stillpoint_geometry::Vec2;

/// A feature of the present frame and where it was in the frame before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FlowPair {
    /// Raw pixel in the frame before.
    pub(crate) before_raw: [f32; 2],
    /// The same, undistorted, as exposed.
    pub(crate) before_exposed: Vec2,
    /// Undistorted pixel in the frame before, at its stamp.
    pub(crate) before: Vec2,
    /// Undistorted pixel in the present frame.
    pub(crate) now: Vec2,
    /// Standard deviation of the flow that is measured between both pixels, px.
    pub(crate) flow_sigma: f64,
    /// Standard deviation of the unknown part of the shift by the rolling shutter, px.
    pub(crate) shutter_sigma: f64,
}

impl FlowPair {
    /// Standard deviation of the one pixel relative to the other, px.
    pub(crate) fn sigma(&self) -> f64 {
        libm::hypot(self.flow_sigma, self.shutter_sigma)
    }
}
