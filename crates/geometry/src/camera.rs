//! Pinhole camera with Brown-Conrady distortion.

use crate::{Vec2, Vec3};

/// Lens distortion of Brown (1966) and Conrady in the five-coefficient form of OpenCV and TUM: radial `k1 k2 k3`,
/// tangential `p1 p2`, on normalised image coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BrownConrady {
    /// Radial, second order.
    pub k1: f64,
    /// Radial, fourth order.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, sixth order.
    pub k3: f64,
}

impl BrownConrady {
    /// True when all coefficients are zero.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        *self == Self::default()
    }

    /// Distorts normalised coordinates (x/z, y/z).
    #[must_use]
    pub fn distort(&self, p: Vec2) -> Vec2 {
        let (x, y) = (p.x, p.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        Vec2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    /// The inverse of [`Self::distort`], by Newton's method from `p`; converges to 1e-12 where the model is one to one,
    /// which [`Camera::check`] verifies for a whole image.
    #[must_use]
    pub fn undistort(&self, p: Vec2) -> Vec2 {
        if self.is_zero() {
            return p;
        }
        let mut q = p;
        for _ in 0..20 {
            let e = self.distort(q) - p;
            let [a, b, d] = self.derivative(q);
            let det = a * d - b * b;
            let step = Vec2::new((d * e.x - b * e.y) / det, (a * e.y - b * e.x) / det);
            if !step.iter().all(|v| v.is_finite()) {
                break;
            }
            q -= step;
            if step.norm_squared() < 1e-26 {
                break;
            }
        }
        q
    }

    /// The derivative of [`Self::distort`] at a point: the symmetric matrix `[a b; b d]`.
    #[inline]
    pub(crate) fn derivative(&self, p: Vec2) -> [f64; 3] {
        let (x, y) = (p.x, p.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3);
        [
            radial + 2.0 * x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            2.0 * x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y,
            radial + 2.0 * y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        ]
    }
}

/// Pinhole camera with lens distortion. Pixel centres are at integers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Image width, px.
    pub width: u32,
    /// Image height, px.
    pub height: u32,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, x, px.
    pub cx: f64,
    /// Principal point, y, px.
    pub cy: f64,
    /// Lens distortion; zero for rectified images.
    pub distortion: BrownConrady,
}

impl Camera {
    /// A camera without distortion.
    #[must_use]
    pub fn pinhole(width: u32, height: u32, [fx, fy, cx, cy]: [f64; 4]) -> Self {
        Self {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion: BrownConrady::default(),
        }
    }

    /// The same camera without distortion, for undistorted pixels.
    #[must_use]
    pub fn rectified(&self) -> Self {
        Self {
            distortion: BrownConrady::default(),
            ..*self
        }
    }

    /// The undistorted pixel of a point in camera coordinates (m). Requires `p.z > 0`.
    #[must_use]
    pub fn project(&self, p: &Vec3) -> Vec2 {
        Vec2::new(self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy)
    }

    /// The raw (distorted) pixel of a point in camera coordinates (m).
    #[must_use]
    pub fn project_distorted(&self, p: &Vec3) -> Vec2 {
        self.distort(self.project(p))
    }

    /// The ray with z = 1 through an undistorted pixel.
    #[must_use]
    pub fn ray(&self, px: Vec2) -> Vec3 {
        Vec3::new((px.x - self.cx) / self.fx, (px.y - self.cy) / self.fy, 1.0)
    }

    /// The point (m) at depth `z` (m, along the optical axis) behind an undistorted pixel.
    #[must_use]
    pub fn backproject(&self, px: Vec2, z: f64) -> Vec3 {
        self.ray(px) * z
    }

    /// Undistorts a raw pixel.
    #[must_use]
    pub fn undistort(&self, px: Vec2) -> Vec2 {
        if self.distortion.is_zero() {
            return px;
        }
        let r = self.ray(px);
        let q = self.distortion.undistort(Vec2::new(r.x, r.y));
        Vec2::new(q.x * self.fx + self.cx, q.y * self.fy + self.cy)
    }

    /// Distorts an undistorted pixel.
    #[must_use]
    pub fn distort(&self, px: Vec2) -> Vec2 {
        if self.distortion.is_zero() {
            return px;
        }
        let r = self.ray(px);
        let q = self.distortion.distort(Vec2::new(r.x, r.y));
        Vec2::new(q.x * self.fx + self.cx, q.y * self.fy + self.cy)
    }

    /// True when a pixel lies in the image.
    #[must_use]
    pub fn contains(&self, px: Vec2) -> bool {
        px.x >= 0.0
            && px.y >= 0.0
            && px.x <= f64::from(self.width) - 1.0
            && px.y <= f64::from(self.height) - 1.0
    }

    /// Bounding rectangle `[min_x, min_y, max_x, max_y]` of the raw image in undistorted pixels.
    #[must_use]
    pub fn undistorted_bounds(&self) -> [f64; 4] {
        let (w, h) = (f64::from(self.width) - 1.0, f64::from(self.height) - 1.0);
        let mut b = [
            f64::INFINITY,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NEG_INFINITY,
        ];
        for k in 0..=64 {
            let s = f64::from(k) / 64.0;
            for p in [
                Vec2::new(s * w, 0.0),
                Vec2::new(s * w, h),
                Vec2::new(0.0, s * h),
                Vec2::new(w, s * h),
            ] {
                let q = self.undistort(p);
                b = [b[0].min(q.x), b[1].min(q.y), b[2].max(q.x), b[3].max(q.y)];
            }
        }
        b
    }
}
