//! Measurements of points, and their distance from a prediction.

use stillpoint_geometry::{Camera, Vec2, Vec3, robust};

/// Focal lengths and principal point, px, of a camera without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, x, px.
    pub cx: f64,
    /// Principal point, y, px.
    pub cy: f64,
}

impl From<&Camera> for Intrinsics {
    fn from(c: &Camera) -> Self {
        Self {
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
        }
    }
}

/// An undistorted pixel and optionally a depth. Depth is used as its inverse: the error of structured light and of
/// stereo is uniform in disparity, which is proportional to 1/z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Undistorted pixel.
    pub pixel: Vec2,
    /// 1 / variance of the pixel across `edge`, 1/px^2; without an edge, in any direction.
    pub pixel_weight: f64,
    /// 1 / depth, 1/m.
    pub inverse_depth: f64,
    /// 1 / variance of the inverse depth, m^2; 0 without depth.
    pub inverse_depth_weight: f64,
    /// The direction in which the pixel is less certain, as on an image edge: the unit vector along it times the square
    /// root of 1 less the ratio of the standard deviations across and along it. Zero if they are equal.
    pub edge: Vec2,
}

impl Measurement {
    /// From a pixel with standard deviation `sigma_px` and an optional depth `(z, sigma)` in m.
    #[must_use]
    pub fn new(pixel: Vec2, sigma_px: f64, depth: Option<(f64, f64)>) -> Self {
        let (inverse_depth, inverse_depth_weight) = depth.map_or((0.0, 0.0), |(z, sigma)| {
            let s = sigma / (z * z);
            (1.0 / z, 1.0 / (s * s))
        });
        Self {
            pixel,
            pixel_weight: 1.0 / (sigma_px * sigma_px),
            inverse_depth,
            inverse_depth_weight,
            edge: Vec2::zeros(),
        }
    }

    /// The measurement with an [`edge`](Self::edge).
    #[must_use]
    pub fn on_edge(self, edge: Vec2) -> Self {
        Self { edge, ..self }
    }

    /// Shortens the part of an offset along the edge by the ratio of the deviations, so that both directions have that
    /// across it.
    #[inline]
    pub(crate) fn even(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let along = self.edge.x * u + self.edge.y * v;
        [u - self.edge.x * along, v - self.edge.y * along]
    }

    /// Whether there is a depth.
    #[must_use]
    pub fn has_depth(&self) -> bool {
        self.inverse_depth_weight > 0.0
    }

    /// Whether all numbers are finite and both weights valid.
    pub(crate) fn is_sound(&self) -> bool {
        (self.pixel.sum() + self.inverse_depth).is_finite()
            && self.edge.norm_squared() <= 1.0
            && (self.pixel_weight + self.inverse_depth_weight).is_finite()
            && self.pixel_weight > 0.0
            && self.inverse_depth_weight >= 0.0
    }

    /// The 95 % chi-square gate of this measurement: 3 degrees of freedom with depth, else 2.
    #[must_use]
    pub fn gate(&self) -> f64 {
        if self.has_depth() {
            robust::CHI2_95_3
        } else {
            robust::CHI2_95_2
        }
    }

    /// Squared Mahalanobis distance to the prediction from a point in camera coordinates (m); infinite behind the
    /// camera.
    #[must_use]
    pub fn chi2(&self, k: &Intrinsics, p: &Vec3) -> f64 {
        if p.z <= 1e-3 {
            return f64::INFINITY;
        }
        let iz = 1.0 / p.z;
        let eu = self.pixel.x - (k.fx * p.x * iz + k.cx);
        let ev = self.pixel.y - (k.fy * p.y * iz + k.cy);
        let [eu, ev] = self.even([eu, ev]);
        let ed = self.inverse_depth - iz;
        self.pixel_weight * (eu * eu + ev * ev) + self.inverse_depth_weight * ed * ed
    }
}
