//! The homography of two views: `p2 ~ H p1` for the pixels of a plane, or of all points under pure rotation.

use crate::linear::{adjugate, smallest_eigenvector};
use crate::sampling::Rng;
use crate::two_view::{Block, LANES, Pairs, PixelPair, Relation, TwoViewOptions};
use crate::two_view::{gate, rows, search};
use stillpoint_geometry::{Mat3, Vec3};

/// A homography with its inliers.
#[derive(Clone, Debug)]
pub struct Homography {
    /// Maps homogeneous pixels of the first image to the second; Frobenius norm 1, positive determinant.
    pub h_matrix: Mat3,
    /// Per pair: transfer error in the second image within the threshold.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub count: usize,
    /// Samples drawn.
    pub iterations: usize,
}

/// The homography of four pairs (Hartley, Zisserman, example 4.7.1: through the basis that the points form). `None` if
/// three points of an image are collinear, or the points would be on both sides of the camera.
#[must_use]
pub fn four_point(sample: &[PixelPair; 4]) -> Option<Mat3> {
    let (a, ka) = basis(&sample.map(|p| p.0))?;
    let (b, kb) = basis(&sample.map(|p| p.1))?;
    // H maps point i to kb_i / ka_i times its partner: factors of equal sign keep points in front of the camera.
    if (0..3).any(|i| ka[i] * kb[i] <= 0.0) {
        return None;
    }
    let h = b * adjugate(&a);
    let norm = h.norm();
    (norm.is_finite() && norm > 0.0).then(|| h / norm)
}

/// The matrix whose columns are the first three points, scaled so that they add up to the fourth, and the factors.
fn basis(p: &[[f64; 2]; 4]) -> Option<(Mat3, Vec3)> {
    let [a, b, c, d] = p.map(|[x, y]| Vec3::new(x, y, 1.0));
    let m = Mat3::from_columns(&[a, b, c]);
    let (adj, det) = (adjugate(&m), m.determinant());
    let scaled = adj * d;
    // Twice the areas of the four triangles: zero for collinear corners.
    let least = scaled.iter().fold(det.abs(), |x, v| x.min(v.abs()));
    if least.is_nan() || least <= 1e-9 {
        return None;
    }
    let k = scaled / det;
    Some((Mat3::from_columns(&[a * k.x, b * k.y, c * k.z]), k))
}

struct Planar;

impl Relation<4> for Planar {
    fn minimal(sample: &[PixelPair; 4]) -> Vec<Mat3> {
        four_point(sample).into_iter().collect()
    }

    /// The normalised direct linear method (Hartley, Zisserman, algorithm 4.2), each equation divided by the third
    /// coordinate at `start`, so that residuals are distances.
    fn refit(pairs: &Pairs, start: &Mat3, gate: f64) -> Option<Mat3> {
        let h = rows(start);
        let mut sums = [[0.0; 6]; 4];
        let mut used = 0;
        for block in &pairs.blocks {
            let squared = Self::squared(&h, block);
            for lane in (0..LANES).filter(|&lane| squared[lane] < gate) {
                used += 1;
                let (x, y, u, v) = (
                    block.x1[lane],
                    block.y1[lane],
                    block.x2[lane],
                    block.y2[lane],
                );
                let w = 1.0 / (h[6] * x + h[7] * y + h[8]);
                let w = w * w;
                let first = [x * x, x * y, x, y * y, y, 1.0];
                for (row, s) in sums.iter_mut().zip([w, w * u, w * v, w * (u * u + v * v)]) {
                    for (sum, f) in row.iter_mut().zip(first) {
                        *sum += s * f;
                    }
                }
            }
        }
        if used < 4 {
            return None;
        }
        // Rows [m, 0, -u m] and [0, m, -v m] with m = (x, y, 1) give 3 x 3 blocks of these sums.
        const PRODUCT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
        let moments: [[f64; 9]; 9] = std::array::from_fn(|i| {
            std::array::from_fn(|k| {
                let at = PRODUCT[i % 3][k % 3];
                match (i / 3, k / 3) {
                    (0, 0) | (1, 1) => sums[0][at],
                    (0, 2) | (2, 0) => -sums[1][at],
                    (1, 2) | (2, 1) => -sums[2][at],
                    (2, 2) => sums[3][at],
                    _ => 0.0,
                }
            })
        });
        Some(Mat3::from_row_slice(&smallest_eigenvector(&moments)?))
    }

    #[inline]
    fn squared(h: &[f64; 9], b: &Block) -> [f64; LANES] {
        std::array::from_fn(|i| {
            let (x, y) = (b.x1[i], b.y1[i]);
            let w = 1.0 / (h[6] * x + h[7] * y + h[8]);
            let du = b.x2[i] - (h[0] * x + h[1] * y + h[2]) * w;
            let dv = b.y2[i] - (h[3] * x + h[4] * y + h[5]) * w;
            du * du + dv * dv
        })
    }
}

/// Finds the homography with most inliers: samples of four; the smallest truncated transfer error wins and is refined
/// on its inliers. Pairs that are not finite are never inliers.
///
/// `None` with fewer than five finite pairs, or if no homography has five inliers: four pairs always have one.
#[must_use]
pub fn find_homography(
    pairs: &[PixelPair],
    options: &TwoViewOptions,
    mut rng: Rng,
) -> Option<Homography> {
    let normalised = Pairs::new(pairs, 5, &mut rng)?;
    let winner = search::<Planar, 4>(&normalised, options, rng)?;
    let m = rows(&winner.matrix);
    let (inliers, count) = normalised.inliers(pairs.len(), gate(&normalised, options), |b| {
        Planar::squared(&m, b)
    });
    let h = normalised.denormaliser(1) * winner.matrix * normalised.normaliser(0);
    let norm = h.norm().copysign(h.determinant());
    (count >= 5 && norm.is_finite() && norm != 0.0).then(|| Homography {
        h_matrix: h / norm,
        inliers,
        count,
        iterations: winner.iterations,
    })
}
