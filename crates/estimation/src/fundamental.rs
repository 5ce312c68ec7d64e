//! The fundamental matrix of two views: `p2^T F p1 = 0` for the pixels of all static points.

use crate::linear::{cubic_roots, determinant_cubic, smallest_eigenvector, to_rank_two};
use crate::sampling::Rng;
use crate::two_view::{Block, LANES, Pairs, PixelPair, Relation, TwoViewOptions};
use crate::two_view::{gate, rows, search};
use stillpoint_geometry::{Mat3, Vec3};

/// A fundamental matrix with its inliers.
#[derive(Clone, Debug)]
pub struct Fundamental {
    /// Maps pixels of the first image to lines of the second; rank 2, Frobenius norm 1.
    pub f_matrix: Mat3,
    /// Per pair: Sampson distance within the threshold.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub count: usize,
    /// Samples drawn.
    pub iterations: usize,
}

/// Distance (px) of the pixel `p2` to the epipolar line of `p1`: with `l = F p1 = (X, Y, Z)`, `|p2^T l| / sqrt(X^2 +
/// Y^2)`. Infinite if `p1` is the epipole.
#[must_use]
pub fn epipolar_distance(f: &Mat3, p1: [f64; 2], p2: [f64; 2]) -> f64 {
    let l = f * Vec3::new(p1[0], p1[1], 1.0);
    let distance = (p2[0] * l.x + p2[1] * l.y + l.z).abs() / (l.x * l.x + l.y * l.y).sqrt();
    if distance.is_nan() {
        f64::INFINITY
    } else {
        distance
    }
}

/// Squared Sampson distance (px^2): to first order how far both pixels together must move to agree with `f` (Hartley,
/// Zisserman, "Multiple View Geometry", equation 11.9). Infinite where undefined, at both epipoles.
#[must_use]
pub fn sampson_squared(f: &Mat3, p1: [f64; 2], p2: [f64; 2]) -> f64 {
    let (a, b) = (Vec3::new(p1[0], p1[1], 1.0), Vec3::new(p2[0], p2[1], 1.0));
    let (l2, l1) = (f * a, f.tr_mul(&b));
    let e = b.dot(&l2);
    let d = e * e / (l2.x * l2.x + l2.y * l2.y + l1.x * l1.x + l1.y * l1.y);
    if d.is_nan() { f64::INFINITY } else { d }
}

/// All fundamental matrices (one to three, Frobenius norm 1) of seven pairs (Hartley, Zisserman, 11.1.2). Coordinates
/// should be of order one, as [`find_fundamental`] ensures. Empty if the pairs do not determine a pencil of matrices.
#[must_use]
pub fn seven_point(sample: &[PixelPair; 7]) -> Vec<Mat3> {
    let Some([a, b]) = kernel(sample.map(|(p, q)| kronecker(p, q))) else {
        return Vec::new();
    };
    let (a, b) = (Mat3::from_row_slice(&a), Mat3::from_row_slice(&b));
    let c = determinant_cubic(&a, &b);
    let mut found: Vec<Mat3> = Vec::with_capacity(3);
    for x in cubic_roots(c).as_slice() {
        found.push(a * *x + b);
    }
    // A root at infinity is the matrix `a` itself.
    let size = c.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if c[3].abs() <= 1e-13 * size && found.len() < 3 {
        found.push(a);
    }
    found.retain_mut(|f| {
        let norm = f.norm();
        *f /= norm;
        norm.is_finite() && norm > 0.0
    });
    found
}

/// The coefficients of F, row by row, in `p2^T F p1`.
#[inline]
fn kronecker([x, y]: [f64; 2], [u, v]: [f64; 2]) -> [f64; 9] {
    [u * x, u * y, u, v * x, v * y, v, x, y, 1.0]
}

/// Two vectors that span the kernel of seven equations, by Gauss-Jordan elimination with complete pivoting.
fn kernel(mut m: [[f64; 9]; 7]) -> Option<[[f64; 9]; 2]> {
    let mut column: [usize; 9] = std::array::from_fn(|i| i);
    let mut first = 0.0;
    for step in 0..7 {
        let (mut row, mut at, mut largest) = (step, step, 0.0);
        for (r, equation) in m.iter().enumerate().skip(step) {
            for (c, value) in equation.iter().enumerate().skip(step) {
                if value.abs() > largest {
                    (row, at, largest) = (r, c, value.abs());
                }
            }
        }
        if step == 0 {
            first = largest;
        }
        if largest <= 1e-12 * first || !largest.is_finite() {
            return None;
        }
        m.swap(step, row);
        column.swap(step, at);
        for equation in &mut m {
            equation.swap(step, at);
        }
        let inverse = 1.0 / m[step][step];
        for value in &mut m[step] {
            *value *= inverse;
        }
        let pivot = m[step];
        for (r, equation) in m.iter_mut().enumerate() {
            if r != step {
                let factor = equation[step];
                for (value, p) in equation.iter_mut().zip(&pivot) {
                    *value -= factor * p;
                }
            }
        }
    }
    let mut basis = [[0.0; 9]; 2];
    for (free, vector) in basis.iter_mut().enumerate() {
        for (r, equation) in m.iter().enumerate() {
            vector[column[r]] = -equation[7 + free];
        }
        vector[column[7 + free]] = 1.0;
    }
    Some(basis)
}

struct Epipolar;

impl Relation<7> for Epipolar {
    fn minimal(sample: &[PixelPair; 7]) -> Vec<Mat3> {
        seven_point(sample)
    }

    /// The normalised eight-point method with each equation divided by its standard deviation at `start`, so that it
    /// minimises the Sampson distance to first order (Hartley, Zisserman, 11.4.3; Zhang, IJCV 1998, section 3.2).
    fn refit(pairs: &Pairs, start: &Mat3, gate: f64) -> Option<Mat3> {
        let f = rows(start);
        // Rows of the design matrix are Kronecker products of two pixels, so only 6 x 6 sums differ.
        let mut sums = [[0.0; 6]; 6];
        let mut used = 0;
        for block in &pairs.blocks {
            let (squared, inverse) = sampson(&f, block);
            for lane in 0..LANES {
                if squared[lane] < gate {
                    used += 1;
                    let (x, y, u, v) = (
                        block.x1[lane],
                        block.y1[lane],
                        block.x2[lane],
                        block.y2[lane],
                    );
                    let w = inverse[lane];
                    let first = [x * x, x * y, x, y * y, y, 1.0];
                    let second = [w * u * u, w * u * v, w * u, w * v * v, w * v, w];
                    for (row, s) in sums.iter_mut().zip(second) {
                        for (sum, f) in row.iter_mut().zip(first) {
                            *sum += s * f;
                        }
                    }
                }
            }
        }
        if used < 8 {
            return None;
        }
        const PRODUCT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
        let moments: [[f64; 9]; 9] = std::array::from_fn(|i| {
            std::array::from_fn(|k| sums[PRODUCT[i / 3][k / 3]][PRODUCT[i % 3][k % 3]])
        });
        to_rank_two(&Mat3::from_row_slice(&smallest_eigenvector(&moments)?))
    }

    #[inline]
    fn squared(f: &[f64; 9], block: &Block) -> [f64; LANES] {
        sampson(f, block).0
    }
}

/// Squared Sampson distances of a block, and the reciprocal squared gradients.
#[inline]
fn sampson(f: &[f64; 9], b: &Block) -> ([f64; LANES], [f64; LANES]) {
    let (mut squared, mut inverse) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let (x, y, u, v) = (b.x1[i], b.y1[i], b.x2[i], b.y2[i]);
        let lx = f[0] * x + f[1] * y + f[2];
        let ly = f[3] * x + f[4] * y + f[5];
        let lz = f[6] * x + f[7] * y + f[8];
        let mx = f[0] * u + f[3] * v + f[6];
        let my = f[1] * u + f[4] * v + f[7];
        let e = u * lx + v * ly + lz;
        let g = 1.0 / ((lx * lx + ly * ly) + (mx * mx + my * my));
        inverse[i] = g;
        squared[i] = e * e * g;
    }
    (squared, inverse)
}

/// Finds the fundamental matrix with most inliers: samples of seven, all real roots; the smallest truncated Sampson
/// cost wins and is refined on its inliers. Pairs that are not finite are never inliers.
///
/// `None` with fewer than eight finite pairs, or if no matrix has eight inliers: seven pairs always have one.
#[must_use]
pub fn find_fundamental(
    pairs: &[PixelPair],
    options: &TwoViewOptions,
    mut rng: Rng,
) -> Option<Fundamental> {
    let normalised = Pairs::new(pairs, 8, &mut rng)?;
    let winner = search::<Epipolar, 7>(&normalised, options, rng)?;
    let m = rows(&winner.matrix);
    let (inliers, count) = normalised.inliers(pairs.len(), gate(&normalised, options), |b| {
        Epipolar::squared(&m, b)
    });
    let f = normalised.normaliser(1).transpose() * winner.matrix * normalised.normaliser(0);
    let norm = f.norm();
    (count >= 8 && norm.is_finite() && norm > 0.0).then(|| Fundamental {
        f_matrix: f / norm,
        inliers,
        count,
        iterations: winner.iterations,
    })
}
