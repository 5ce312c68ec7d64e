//! Conjugate gradients for symmetric systems of 6x6 blocks that are too dense to factor.

use crate::sparse::{Block, Pattern, backward, cholesky, forward};
use stillpoint_geometry::Vec6;

/// Maximum number of iterations. Most systems end here, with the remaining error spread over many poses (decision 11);
/// the next system of bundle adjustment continues from there.
pub(crate) const MAX_ITERATIONS: u64 = 200;

/// Relative residual at which to stop, a share of the right hand side's norm, both in the norm of the preconditioner.
/// Chosen: a thousandth of the gain at which bundle adjustment ends (1e-4).
const TOLERANCE: f64 = 1e-7;

/// Solves `A x = b` by preconditioned conjugate gradients (Hestenes, Stiefel 1952), with the Cholesky factors of the
/// diagonal blocks as preconditioner (block Jacobi: Agarwal et al., "Bundle adjustment in the large", ECCV 2010).
/// `values` are the blocks of the lower triangle in the order of the pattern, which must be without fill.
///
/// After [`MAX_ITERATIONS`] the current solution is returned, which is a direction of descent. `None` if `A` is found
/// not to be positive definite.
pub(crate) fn solve(pattern: &Pattern, values: &[Block], b: &[[f64; 6]]) -> Option<Vec<Vec6>> {
    let factors = (0..pattern.count())
        .map(|k| {
            let mut d = values[pattern.column(k).0];
            cholesky(&mut d).map(|()| d)
        })
        .collect::<Option<Vec<Block>>>()?;
    let mut x = vec![[0.0; 6]; b.len()];
    let mut r = b.to_vec();
    let mut z = precondition(&factors, &r);
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    let enough = TOLERANCE * TOLERANCE * rz;
    for _ in 0..MAX_ITERATIONS {
        // NaN ends the iteration as well.
        if rz.is_nan() || rz <= enough {
            break;
        }
        let q = multiply(pattern, values, &p);
        let curvature = dot(&p, &q);
        if curvature.is_nan() || curvature <= 0.0 {
            return None;
        }
        let alpha = rz / curvature;
        add_scaled(&mut x, &p, alpha);
        add_scaled(&mut r, &q, -alpha);
        z = precondition(&factors, &r);
        let next = dot(&r, &z);
        let beta = next / rz;
        rz = next;
        for (p, z) in p.iter_mut().zip(&z) {
            for (a, b) in p.iter_mut().zip(z) {
                *a = b + beta * *a;
            }
        }
    }
    Some(x.into_iter().map(Vec6::from).collect())
}

fn precondition(factors: &[Block], r: &[[f64; 6]]) -> Vec<[f64; 6]> {
    let solved = |(l, r): (&Block, &[f64; 6])| {
        let mut y = *r;
        forward(l, &mut y);
        backward(l, &mut y);
        y
    };
    factors.iter().zip(r).map(solved).collect()
}

/// `A x`, from the lower triangle.
fn multiply(pattern: &Pattern, values: &[Block], x: &[[f64; 6]]) -> Vec<[f64; 6]> {
    let mut y = vec![[0.0; 6]; x.len()];
    for k in 0..pattern.count() {
        let (first, rows) = pattern.column(k);
        let xk = x[k];
        let mut yk = [0.0; 6];
        for (offset, (row, block)) in rows.iter().zip(&values[first..]).enumerate() {
            let row = *row as usize;
            for (i, l) in block.iter().enumerate() {
                let mut sum = 0.0;
                for (a, b) in l.iter().zip(&xk) {
                    sum += a * b;
                }
                y[row][i] += sum;
            }
            // Off-diagonal blocks also stand for their transposes.
            if offset > 0 {
                for (l, s) in block.iter().zip(&x[row]) {
                    for (v, a) in yk.iter_mut().zip(l) {
                        *v += a * s;
                    }
                }
            }
        }
        for (v, a) in y[k].iter_mut().zip(yk) {
            *v += a;
        }
    }
    y
}

fn dot(a: &[[f64; 6]], b: &[[f64; 6]]) -> f64 {
    let mut sum = 0.0;
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        sum += a * b;
    }
    sum
}

fn add_scaled(x: &mut [[f64; 6]], p: &[[f64; 6]], s: f64) {
    for (a, b) in x.iter_mut().flatten().zip(p.iter().flatten()) {
        *a += s * b;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Purpose, rng};
    use proptest::prelude::*;

    proptest! {
        /// Compared with the factorisation of the same system.
        #[test]
        fn conjugate_gradients_match_the_factorisation(count in 1usize..30, per in 0usize..6, seed in any::<u64>()) {
            let random = &mut rng(seed, 0, Purpose(1000));
            let mut neighbours = vec![Vec::new(); count];
            for _ in 0..per * count {
                let (a, b) = (random.below(count), random.below(count));
                if a != b && !neighbours[a].contains(&(b as u32)) {
                    neighbours[a].push(b as u32);
                    neighbours[b].push(a as u32);
                }
            }
            let (plain, filled) = (Pattern::without_fill(neighbours.clone()), Pattern::new(neighbours));
            let mut values = vec![[[0.0; 6]; 6]; plain.blocks()];
            let mut same = vec![[[0.0; 6]; 6]; filled.blocks()];
            for k in 0..count {
                let (first, rows) = plain.column(k);
                for (i, row) in rows.iter().enumerate() {
                    let mut block: Block = std::array::from_fn(|_| std::array::from_fn(|_| random.unit() - 0.5));
                    if i == 0 {
                        block = std::array::from_fn(|r| std::array::from_fn(|c| if r == c { 6.0 * count as f64 } else { 0.3 }));
                    }
                    values[first + i] = block;
                    let (at, swapped) = filled.find(*row, k as u32).unwrap();
                    same[at] = if swapped { crate::sparse::transposed(&block) } else { block };
                }
            }
            let b: Vec<[f64; 6]> = (0..count).map(|_| std::array::from_fn(|_| random.unit() - 0.5)).collect();
            let x = solve(&plain, &values, &b).unwrap();
            let expected = filled.factor(same).unwrap().solve(&b);
            for (x, e) in x.iter().zip(&expected) {
                prop_assert!((x - e).amax() < 1e-7 * (1.0 + e.amax()), "{x} {e}");
            }
            values[plain.column(count - 1).0][2][2] = -1.0;
            prop_assert!(solve(&plain, &values, &b).is_none());
        }
    }
}
