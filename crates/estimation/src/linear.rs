//! Small dense algebra of the minimal solvers, with a fixed order of operations.

use stillpoint_geometry::{Mat3, Vec3};

/// The unit eigenvector of the smallest eigenvalue of a symmetric positive semidefinite matrix, by inverse iteration.
/// `None` for a matrix that is zero or not finite.
pub(crate) fn smallest_eigenvector<const N: usize>(m: &[[f64; N]; N]) -> Option<[f64; N]> {
    let trace: f64 = (0..N).map(|i| m[i][i]).sum();
    if !(trace.is_finite() && trace > 0.0) {
        return None;
    }
    // The shift keeps pivots above rounding if the smallest eigenvalue is zero, and is far below the second one.
    let (l, d) = ldlt(m, 1e-14 * trace)?;
    let mut x: [f64; N] = std::array::from_fn(|i| 1.0 + 0.1 * i as f64);
    for _ in 0..16 {
        let mut y = x;
        for i in 0..N {
            for k in 0..i {
                y[i] -= l[i][k] * y[k];
            }
        }
        for i in (0..N).rev() {
            y[i] /= d[i];
            for k in i + 1..N {
                y[i] -= l[k][i] * y[k];
            }
        }
        let norm = y.iter().map(|v| v * v).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > 0.0) {
            return None;
        }
        let mut moved = 0.0_f64;
        for (a, b) in x.iter_mut().zip(&y) {
            let next = b / norm;
            moved = moved.max((next - *a).abs());
            *a = next;
        }
        if moved < 1e-13 {
            break;
        }
    }
    Some(x)
}

/// `m + shift I = L D L^T` with unit diagonal of L; pivots are at least the shift.
#[allow(clippy::type_complexity)]
fn ldlt<const N: usize>(m: &[[f64; N]; N], shift: f64) -> Option<([[f64; N]; N], [f64; N])> {
    let (mut l, mut d) = ([[0.0; N]; N], [0.0; N]);
    for j in 0..N {
        let mut pivot = m[j][j] + shift;
        for k in 0..j {
            pivot -= l[j][k] * l[j][k] * d[k];
        }
        if !pivot.is_finite() {
            return None;
        }
        d[j] = pivot.max(shift);
        for i in j + 1..N {
            let mut v = m[i][j];
            for k in 0..j {
                v -= l[i][k] * l[j][k] * d[k];
            }
            l[i][j] = v / d[j];
        }
    }
    Some((l, d))
}

/// The nearest rank-2 matrix in Frobenius norm, sharing the kernel of the smallest singular value.
pub(crate) fn to_rank_two(f: &Mat3) -> Option<Mat3> {
    let g = f.tr_mul(f);
    let rows = [0, 1, 2].map(|r| [0, 1, 2].map(|c| g[(r, c)]));
    let v = Vec3::from(smallest_eigenvector(&rows)?);
    Some(f - (f * v) * v.transpose())
}

/// The adjugate: `adjugate(m) * m = det(m) I`.
pub(crate) fn adjugate(m: &Mat3) -> Mat3 {
    let (a, b, c) = (m.column(0), m.column(1), m.column(2));
    let rows = [b.cross(&c), c.cross(&a), a.cross(&b)];
    Mat3::from_fn(|r, k| rows[r][k])
}

/// Coefficients `c0 + c1 x + c2 x^2 + c3 x^3` of `det(x a + b)`.
pub(crate) fn determinant_cubic(a: &Mat3, b: &Mat3) -> [f64; 4] {
    let (adj_a, adj_b) = (adjugate(a), adjugate(b));
    let trace = |m: &Mat3, n: &Mat3| {
        let mut sum = 0.0;
        for i in 0..3 {
            for k in 0..3 {
                sum += m[(i, k)] * n[(k, i)];
            }
        }
        sum
    };
    let det = |m: &Mat3, adj: &Mat3| {
        m[(0, 0)] * adj[(0, 0)] + m[(0, 1)] * adj[(1, 0)] + m[(0, 2)] * adj[(2, 0)]
    };
    [
        det(b, &adj_b),
        trace(&adj_b, a),
        trace(&adj_a, b),
        det(a, &adj_a),
    ]
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Roots {
    values: [f64; 3],
    count: usize,
}

impl Roots {
    fn push(&mut self, x: f64) {
        if x.is_finite() && self.count < 3 {
            self.values[self.count] = x;
            self.count += 1;
        }
    }

    pub(crate) fn as_slice(&self) -> &[f64] {
        &self.values[..self.count]
    }
}

/// The real roots of `c0 + c1 x + c2 x^2`, without cancellation. A discriminant that is negative by rounding counts as
/// zero.
pub(crate) fn quadratic_roots(c: [f64; 3]) -> Roots {
    let mut roots = Roots::default();
    let size = c[0].abs().max(c[1].abs()).max(c[2].abs());
    if c[2].abs() <= 1e-14 * size {
        roots.push(-c[0] / c[1]);
        return roots;
    }
    let mut discriminant = c[1] * c[1] - 4.0 * c[2] * c[0];
    if discriminant < 0.0 {
        if discriminant < -1e-12 * (c[1] * c[1] + (4.0 * c[2] * c[0]).abs()) {
            return roots;
        }
        discriminant = 0.0;
    }
    let q = -0.5 * (c[1] + discriminant.sqrt().copysign(c[1]));
    roots.push(q / c[2]);
    if q != 0.0 && discriminant > 0.0 {
        roots.push(c[0] / q);
    }
    roots
}

/// The real roots of `c0 + c1 x + c2 x^2 + c3 x^3` (Press et al., "Numerical Recipes", 5.6), polished by Newton's
/// method. A root near infinity, where c3 vanishes, is left out.
pub(crate) fn cubic_roots(c: [f64; 4]) -> Roots {
    let size = c.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    if c[3].abs() <= 1e-13 * size {
        return quadratic_roots([c[0], c[1], c[2]]);
    }
    let (a, b, d) = (c[2] / c[3], c[1] / c[3], c[0] / c[3]);
    let q = (a * a - 3.0 * b) / 9.0;
    let r = (2.0 * a * a * a - 9.0 * a * b + 27.0 * d) / 54.0;
    let (q3, shift) = (q * q * q, a / 3.0);
    let mut roots = Roots::default();
    if r * r <= q3 * (1.0 + 1e-13) && q3 > 0.0 {
        let root = q.sqrt();
        let theta = libm::acos((r / (root * q)).clamp(-1.0, 1.0));
        let third = 2.0 * std::f64::consts::PI / 3.0;
        for k in [0.0, 1.0, -1.0] {
            let x = -2.0 * root * libm::cos(theta / 3.0 + k * third) - shift;
            roots.push(polish(a, b, d, x));
        }
    } else {
        let u = -(r.abs() + (r * r - q3).max(0.0).sqrt()).copysign(r);
        let u = libm::cbrt(u);
        let v = if u == 0.0 { 0.0 } else { q / u };
        roots.push(polish(a, b, d, u + v - shift));
    }
    roots
}

/// Newton steps on the monic cubic, while its value decreases.
fn polish(a: f64, b: f64, d: f64, mut x: f64) -> f64 {
    let value = |x: f64| ((x + a) * x + b) * x + d;
    let mut f = value(x);
    for _ in 0..3 {
        let slope = (3.0 * x + 2.0 * a) * x + b;
        let next = x - f / slope;
        let g = value(next);
        if g.is_nan() || g.abs() >= f.abs() {
            break;
        }
        (x, f) = (next, g);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cubic_roots_are_found(a in -5.0..5.0f64, b in -5.0..5.0f64, c in -5.0..5.0f64, size in 0.1..10.0f64) {
            let gap = (a - b).abs().min((a - c).abs()).min((b - c).abs());
            prop_assume!(gap > 1e-2);
            let found = cubic_roots([-a * b * c, a * b + a * c + b * c, -a - b - c, 1.0].map(|v| v * size));
            let (mut found, mut expected) = (found.as_slice().to_vec(), vec![a, b, c]);
            found.sort_by(f64::total_cmp);
            expected.sort_by(f64::total_cmp);
            prop_assert_eq!(found.len(), 3);
            for (f, e) in found.iter().zip(&expected) {
                prop_assert!((f - e).abs() < 1e-9, "{f} {e}");
            }
        }

        /// One real root beside a pair of complex ones.
        #[test]
        fn single_real_cubic_root_is_found(a in -5.0..5.0f64, re in -3.0..3.0f64, im in 0.1..3.0f64) {
            let (s, p) = (2.0 * re, re * re + im * im);
            let found = cubic_roots([-a * p, a * s + p, -a - s, 1.0]);
            prop_assert_eq!(found.as_slice().len(), 1);
            prop_assert!((found.as_slice()[0] - a).abs() < 1e-9);
        }

        #[test]
        fn quadratic_roots_are_found(a in -5.0..5.0f64, b in -5.0..5.0f64, size in 0.1..10.0f64) {
            prop_assume!((a - b).abs() > 1e-3);
            let found = quadratic_roots([a * b * size, -(a + b) * size, size]);
            let mut found = found.as_slice().to_vec();
            found.sort_by(f64::total_cmp);
            prop_assert_eq!(found.len(), 2);
            prop_assert!((found[0] - a.min(b)).abs() < 1e-9 && (found[1] - a.max(b)).abs() < 1e-9);
            let complex = quadratic_roots([a * a + 1.0, -2.0 * a, 1.0]);
            prop_assert!(complex.as_slice().is_empty());
        }

        #[test]
        fn determinant_cubic_matches_the_determinant(m in prop::array::uniform9(-1.0..1.0f64), n in prop::array::uniform9(-1.0..1.0f64), x in -3.0..3.0f64) {
            let (m, n) = (Mat3::from_row_slice(&m), Mat3::from_row_slice(&n));
            let c = determinant_cubic(&m, &n);
            let value = ((c[3] * x + c[2]) * x + c[1]) * x + c[0];
            prop_assert!((value - (m * x + n).determinant()).abs() < 1e-12 * 100.0);
            prop_assert!((adjugate(&m) * m - Mat3::identity() * m.determinant()).amax() < 1e-14);
        }

        /// Compared with the library's eigenvalues.
        #[test]
        fn smallest_eigenvector_matches_the_library(m in prop::array::uniform9(-1.0..1.0f64)) {
            let m = Mat3::from_row_slice(&m);
            let g = m.tr_mul(&m);
            let values = g.symmetric_eigenvalues();
            let smallest = values.min();
            let second = values.iter().filter(|v| **v > smallest).fold(f64::INFINITY, |a, v| a.min(*v));
            prop_assume!(second > 4.0 * smallest);
            let v = Vec3::from(smallest_eigenvector(&[0, 1, 2].map(|r| [0, 1, 2].map(|c| g[(r, c)]))).unwrap());
            prop_assert!((v.norm() - 1.0).abs() < 1e-14);
            prop_assert!((g * v - v * smallest).norm() < 1e-8);
            let flat = to_rank_two(&m).unwrap();
            prop_assert!(flat.determinant().abs() < 1e-14);
            prop_assert!(((m - flat).norm() - smallest.max(0.0).sqrt()).abs() < 1e-7);
        }
    }

    #[test]
    fn zero_matrix_has_no_eigenvector() {
        assert!(smallest_eigenvector(&[[0.0; 3]; 3]).is_none());
        assert!(smallest_eigenvector(&[[f64::NAN; 3]; 3]).is_none());
        // Any vector of a two-dimensional kernel is valid.
        let v = smallest_eigenvector(&[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]);
        assert!(v.unwrap()[0].abs() < 1e-12);
    }
}
