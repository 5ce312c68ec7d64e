//! Tests whether two views determine a fundamental matrix.
//!
//! Pure rotation and planar scenes leave a family of fundamental matrices, and a static camera leaves all of them:
//! epipolar lines then carry no information on motion.

use crate::fundamental::sampson_squared;
use crate::two_view::PixelPair;
use stillpoint_geometry::{Mat3, Vec3};

/// Why epipolar lines are undetermined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degeneracy {
    /// They are determined: the fundamental matrix explains more than simpler relations do.
    None,
    /// A homography explains the pairs: planar scene or pure rotation.
    PlanarOrRotation,
    /// No motion explains the pairs: the camera motion is below the noise.
    LowMotion,
}

/// The verdict and the scores; the lowest score wins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DegeneracyTest {
    /// The verdict.
    pub degeneracy: Degeneracy,
    /// Score of the fundamental matrix; infinite if there is none.
    pub fundamental: f64,
    /// Score of the homography; infinite if there is none.
    pub homography: f64,
    /// Score of no motion.
    pub identity: f64,
}

/// Compares fundamental matrix, homography and no motion by the geometric robust information criterion (Torr, "Bayesian
/// model estimation and selection for epipolar geometry and generic manifold fitting", IJCV 2002):
///
/// `GRIC = sum min(e^2 / sigma^2, 2 (4 - d)) + d n log 4 + k log(4 n)`
///
/// for n pairs, the squared Sampson distance e^2, and models of dimension d with k parameters: 3 and 7 for the
/// fundamental matrix, 2 and 8 for the homography, 2 and 0 for no motion. So a homography wins if it explains more than
/// about four fifths of the pairs explained by the fundamental matrix. `sigma_px` is the standard deviation of a pixel
/// coordinate, px.
///
/// Without relations or pairs, no motion wins.
#[must_use]
pub fn test_degeneracy(
    pairs: &[PixelPair],
    f_matrix: Option<&Mat3>,
    h_matrix: Option<&Mat3>,
    sigma_px: f64,
) -> DegeneracyTest {
    let inverse_variance = 1.0 / (sigma_px * sigma_px);
    let score = |dimension: f64, parameters: f64, squared: &dyn Fn(&PixelPair) -> f64| {
        let (mut sum, cap) = (0.0, 2.0 * (4.0 - dimension));
        for pair in pairs {
            // NaN counts as the cap.
            sum += f64::min(squared(pair) * inverse_variance, cap);
        }
        let n = pairs.len() as f64;
        sum + dimension * n * libm::log(4.0) + parameters * libm::log(f64::max(4.0 * n, 1.0))
    };
    let fundamental = f_matrix.map_or(f64::INFINITY, |f| {
        score(3.0, 7.0, &|(p, q)| sampson_squared(f, *p, *q))
    });
    let homography = h_matrix.map_or(f64::INFINITY, |h| {
        score(2.0, 8.0, &|(p, q)| transfer_squared(h, *p, *q))
    });
    let identity = score(2.0, 0.0, &|(p, q)| {
        let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
        0.5 * (dx * dx + dy * dy)
    });
    let degeneracy = if identity <= homography && identity <= fundamental {
        Degeneracy::LowMotion
    } else if homography <= fundamental {
        Degeneracy::PlanarOrRotation
    } else {
        Degeneracy::None
    };
    DegeneracyTest {
        degeneracy,
        fundamental,
        homography,
        identity,
    }
}

/// Squared Sampson distance (px^2) to a homography: to first order how far both pixels together must move to agree with
/// it (Hartley, Zisserman, section 4.2.6). Infinite where the homography maps to infinity.
#[must_use]
pub fn transfer_squared(h: &Mat3, p1: [f64; 2], p2: [f64; 2]) -> f64 {
    let q = h * Vec3::new(p1[0], p1[1], 1.0);
    let w = 1.0 / q.z;
    let (u, v) = (q.x * w, q.y * w);
    let (ex, ey) = (p2[0] - u, p2[1] - v);
    // Derivative of the mapped pixel by the first one; that by the second is the identity.
    let j = [
        [
            (h[(0, 0)] - u * h[(2, 0)]) * w,
            (h[(0, 1)] - u * h[(2, 1)]) * w,
        ],
        [
            (h[(1, 0)] - v * h[(2, 0)]) * w,
            (h[(1, 1)] - v * h[(2, 1)]) * w,
        ],
    ];
    let a = 1.0 + j[0][0] * j[0][0] + j[0][1] * j[0][1];
    let b = j[0][0] * j[1][0] + j[0][1] * j[1][1];
    let c = 1.0 + j[1][0] * j[1][0] + j[1][1] * j[1][1];
    let d = (c * ex * ex - 2.0 * b * ex * ey + a * ey * ey) / (a * c - b * b);
    if d.is_nan() { f64::INFINITY } else { d }
}
