//! Optical flow of a feature.

use stillpoint_geometry::Vec2;

/// A feature of the current frame and its position in the last frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FlowPair {
    /// Raw pixel in the last frame.
    pub(crate) before_raw: [f32; 2],
    /// Likewise undistorted, as exposed.
    pub(crate) before_exposed: Vec2,
    /// Undistorted pixel in the last frame, at its stamp.
    pub(crate) before: Vec2,
    /// Undistorted pixel in the current frame.
    pub(crate) now: Vec2,
    /// Standard deviation of the measured flow, px.
    pub(crate) flow_sigma: f64,
    /// Standard deviation of the uncompensated rolling-shutter displacement, px.
    pub(crate) shutter_sigma: f64,
    /// The image edge along which the flow is uncertain, as in [`stillpoint_features::Edge::vector`].
    pub(crate) edge: Vec2,
}

impl FlowPair {
    /// Length of an offset from an expected position, px, of which the part along an edge counts less.
    pub(crate) fn length(&self, offset: Vec2) -> f64 {
        (offset - self.edge * self.edge.dot(&offset)).norm()
    }

    /// Combined standard deviation, px.
    pub(crate) fn sigma(&self) -> f64 {
        libm::hypot(self.flow_sigma, self.shutter_sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offset_along_an_edge_counts_less() {
        let pair = |edge: Vec2| FlowPair {
            before_raw: [0.0; 2],
            before_exposed: Vec2::zeros(),
            before: Vec2::zeros(),
            now: Vec2::zeros(),
            flow_sigma: 0.1,
            shutter_sigma: 0.0,
            edge,
        };
        let (along, across) = (Vec2::new(5.0, 0.0), Vec2::new(0.0, 5.0));
        let edge = pair(Vec2::new(0.9, 0.0));
        assert!((edge.length(along) - 0.95).abs() < 1e-12);
        assert!((edge.length(across) - 5.0).abs() < 1e-12);
        // Control: at a corner both count alike.
        let corner = pair(Vec2::zeros());
        assert!((corner.length(along) - 5.0).abs() < 1e-12);
    }
}
