//! Residuals and their Jacobians, shared by pose optimisation and bundle adjustment.

use crate::{Intrinsics, Measurement};
use stillpoint_geometry::{Mat3, Vec3};

/// Residual and Jacobians of one measurement at a point `p` in camera coordinates. Rows: u, v, inverse depth.
#[derive(Clone, Copy, Debug)]
pub struct Linearised {
    /// Measured minus predicted: px, px, 1/m. The part along an edge is scaled to the deviation across it.
    pub residual: [f64; 3],
    /// Derivative of the prediction by `p`, 3x3, row by row.
    pub by_point: [[f64; 3]; 3],
    /// Derivative of the prediction by a left perturbation `exp([rho; phi])` of the pose `camera_from_world`, 3x6.
    pub by_pose: [[f64; 6]; 3],
}

/// Linearises a measurement at the point `p` (m, camera coordinates, `p.z > 0`).
///
/// With `p' = p + rho + phi x p`, a row `j` of the derivative by the point gives the row `[j, p x j]` by the pose.
#[must_use]
#[inline]
pub fn linearise(k: &Intrinsics, m: &Measurement, p: &Vec3) -> Linearised {
    let iz = 1.0 / p.z;
    let (a, b) = (k.fx * iz, k.fy * iz);
    let (x, y) = (p.x * iz, p.y * iz);
    let iz2 = iz * iz;
    // On an edge the residual mixes both pixel coordinates, and so do its derivatives.
    let columns = [[a, 0.0], [0.0, b], [-a * x, -b * y]].map(|column| m.even(column));
    let [u, v] = [0, 1].map(|row| columns.map(|column| column[row]));
    let by_point = [u, v, [0.0, 0.0, -iz2]];
    let [eu, ev] = m.even([m.pixel.x - (k.fx * x + k.cx), m.pixel.y - (k.fy * y + k.cy)]);
    let row = |j: [f64; 3]| {
        [
            j[0],
            j[1],
            j[2],
            p.y * j[2] - p.z * j[1],
            p.z * j[0] - p.x * j[2],
            p.x * j[1] - p.y * j[0],
        ]
    };
    Linearised {
        residual: [eu, ev, m.inverse_depth - iz],
        by_point,
        by_pose: by_point.map(row),
    }
}

/// The derivative by the point in world coordinates: `by_point * rotation`.
#[inline]
pub(crate) fn by_world_point(by_point: &[[f64; 3]; 3], rotation: &Mat3) -> [[f64; 3]; 3] {
    let mut out = [[0.0; 3]; 3];
    for (o, j) in out.iter_mut().zip(by_point) {
        for (c, v) in o.iter_mut().enumerate() {
            *v = j[0] * rotation[(0, c)] + j[1] * rotation[(1, c)] + j[2] * rotation[(2, c)];
        }
    }
    out
}
