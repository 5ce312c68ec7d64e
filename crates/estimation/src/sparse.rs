//! Sparse Cholesky factorisation of symmetric systems of 6x6 blocks, one block row per pose.
//!
//! Left-looking, column by column, in a fixed order of operations: results are bit-identical on every machine.

use crate::ordering::minimum_degree;
use stillpoint_geometry::Vec6;

/// A 6x6 block, row by row.
pub(crate) type Block = [[f64; 6]; 6];

/// Sparsity pattern of a factor. Columns and rows are in elimination order.
pub(crate) struct Pattern {
    /// Position of each variable in the elimination order.
    pub(crate) position: Vec<u32>,
    pub(crate) order: Vec<u32>,
    start: Vec<usize>,
    /// Rows of the blocks of each column, ascending, the diagonal first.
    rows: Vec<u32>,
    left_start: Vec<usize>,
    /// Per row: the index in `rows` of its blocks left of the diagonal, and the end of their columns.
    left: Vec<(usize, usize)>,
}

impl Pattern {
    /// From the variables that share a block with each variable (symmetric, without itself).
    pub(crate) fn new(neighbours: Vec<Vec<u32>>) -> Self {
        let count = neighbours.len();
        let order = minimum_degree(neighbours.clone());
        let mut position = vec![0; count];
        for (p, v) in order.iter().enumerate() {
            position[*v as usize] = p as u32;
        }
        let (mut start, mut rows) = (vec![0], Vec::new());
        // Children in the elimination tree: columns whose first block below the diagonal is in this row.
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); count];
        let mut mark = vec![u32::MAX; count];
        for k in 0..count {
            let first = rows.len();
            rows.push(k as u32);
            mark[k] = k as u32;
            let own = neighbours[order[k] as usize]
                .iter()
                .map(|v| position[*v as usize]);
            let mut column: Vec<u32> = own.filter(|p| *p as usize > k).collect();
            for p in &column {
                mark[*p as usize] = k as u32;
            }
            for c in std::mem::take(&mut children[k]) {
                for row in &rows[start[c as usize] + 1..start[c as usize + 1]] {
                    if mark[*row as usize] != k as u32 {
                        mark[*row as usize] = k as u32;
                        column.push(*row);
                    }
                }
            }
            column.sort_unstable();
            if let Some(parent) = column.first() {
                children[*parent as usize].push(k as u32);
            }
            rows.extend(column);
            start.push(rows.len());
            debug_assert!(first == start[k]);
        }
        let (left_start, left) = by_row(&start, &rows);
        Self {
            position,
            order,
            start,
            rows,
            left_start,
            left,
        }
    }

    /// The blocks of the matrix itself, in the variables' own order; it cannot be factored in place.
    pub(crate) fn without_fill(neighbours: Vec<Vec<u32>>) -> Self {
        let count = neighbours.len() as u32;
        let (mut start, mut rows) = (vec![0], Vec::new());
        for (k, mut column) in (0..count).zip(neighbours) {
            column.retain(|v| *v > k);
            column.sort_unstable();
            rows.push(k);
            rows.extend(column);
            start.push(rows.len());
        }
        Self {
            position: (0..count).collect(),
            order: (0..count).collect(),
            start,
            rows,
            left_start: Vec::new(),
            left: Vec::new(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.order.len()
    }

    /// Number of blocks of the factor.
    pub(crate) fn blocks(&self) -> usize {
        self.rows.len()
    }

    /// Products of two blocks per factorisation.
    pub(crate) fn products(&self) -> u64 {
        let below = self.start.windows(2).map(|w| (w[1] - w[0] - 1) as u64);
        below.map(|n| n * (n + 3) / 2 + 1).sum()
    }

    /// The index of the first block of a column and the rows of all its blocks, the diagonal first.
    pub(crate) fn column(&self, k: usize) -> (usize, &[u32]) {
        (self.start[k], &self.rows[self.start[k]..self.start[k + 1]])
    }

    /// The index of the block of two variables, and whether it is stored transposed.
    pub(crate) fn find(&self, row: u32, column: u32) -> Option<(usize, bool)> {
        let (r, c) = (
            *self.position.get(row as usize)?,
            *self.position.get(column as usize)?,
        );
        let (first, rows) = self.column(r.min(c) as usize);
        let offset = rows.binary_search(&r.max(c)).ok()?;
        Some((first + offset, r < c))
    }

    /// Factors the matrix with blocks in the order of `rows`; `None` if it is not positive definite.
    pub(crate) fn factor(&self, mut values: Vec<Block>) -> Option<Factor<'_>> {
        let mut slot = vec![0_u32; self.count()];
        for k in 0..self.count() {
            let (first, rows) = self.column(k);
            for (offset, row) in rows.iter().enumerate() {
                slot[*row as usize] = offset as u32;
            }
            let (done, rest) = values.split_at_mut(first);
            let column = &mut rest[..rows.len()];
            for &(at, end) in &self.left[self.left_start[k]..self.left_start[k + 1]] {
                let across = transposed(&done[at]);
                for (row, block) in self.rows[at..end].iter().zip(&done[at..end]) {
                    subtract_product(&mut column[slot[*row as usize] as usize], block, &across);
                }
            }
            let (diagonal, below) = column.split_first_mut()?;
            cholesky(diagonal)?;
            for block in below {
                divide(block, diagonal);
            }
        }
        Some(Factor {
            pattern: self,
            values,
        })
    }
}

/// The blocks left of the diagonal, row by row.
fn by_row(start: &[usize], rows: &[u32]) -> (Vec<usize>, Vec<(usize, usize)>) {
    let count = start.len() - 1;
    let mut row_start = vec![0; count + 1];
    for k in 0..count {
        for row in &rows[start[k] + 1..start[k + 1]] {
            row_start[*row as usize + 1] += 1;
        }
    }
    for k in 0..count {
        row_start[k + 1] += row_start[k];
    }
    let mut next = row_start.clone();
    let mut left = vec![(0, 0); row_start[count]];
    for k in 0..count {
        for at in start[k] + 1..start[k + 1] {
            let place = &mut next[rows[at] as usize];
            left[*place] = (at, start[k + 1]);
            *place += 1;
        }
    }
    (row_start, left)
}

/// A lower triangular factor `L` with `L L^T = A`.
pub(crate) struct Factor<'a> {
    pattern: &'a Pattern,
    values: Vec<Block>,
}

impl Factor<'_> {
    /// Solves `A x = b`; both in the variables' own order.
    pub(crate) fn solve(&self, b: &[[f64; 6]]) -> Vec<Vec6> {
        let p = self.pattern;
        let mut x: Vec<[f64; 6]> = p.order.iter().map(|v| b[*v as usize]).collect();
        for k in 0..p.count() {
            let (first, rows) = p.column(k);
            let mut y = x[k];
            forward(&self.values[first], &mut y);
            x[k] = y;
            for (row, block) in rows.iter().zip(&self.values[first..]).skip(1) {
                let target = &mut x[*row as usize];
                for (t, l) in target.iter_mut().zip(block) {
                    *t -= dot(l, &y);
                }
            }
        }
        for k in (0..p.count()).rev() {
            let (first, rows) = p.column(k);
            let mut y = x[k];
            for (row, block) in rows.iter().zip(&self.values[first..]).skip(1) {
                for (l, s) in block.iter().zip(&x[*row as usize]) {
                    for (v, a) in y.iter_mut().zip(l) {
                        *v -= a * s;
                    }
                }
            }
            backward(&self.values[first], &mut y);
            x[k] = y;
        }
        let at = |v: usize| Vec6::from(x[p.position[v] as usize]);
        (0..p.count()).map(at).collect()
    }
}

#[inline]
fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    let mut sum = 0.0;
    for (x, y) in a.iter().zip(b) {
        sum += x * y;
    }
    sum
}

#[inline]
pub(crate) fn transposed(a: &Block) -> Block {
    std::array::from_fn(|r| std::array::from_fn(|c| a[c][r]))
}

/// `target -= a * b_transposed`, with the second factor transposed, so that whole rows are updated.
// Not inlined, so that the compiler knows that the arguments do not alias and vectorises the loop.
#[inline(never)]
fn subtract_product(target: &mut Block, a: &Block, across: &Block) {
    for (row, l) in target.iter_mut().zip(a) {
        let mut sum = *row;
        for (s, other) in l.iter().zip(across) {
            for (v, o) in sum.iter_mut().zip(other) {
                *v -= s * o;
            }
        }
        *row = sum;
    }
}

/// The Cholesky factor of a diagonal block, in its lower triangle; `None` if it is not positive definite.
pub(crate) fn cholesky(a: &mut Block) -> Option<()> {
    for j in 0..6 {
        let mut pivot = a[j][j];
        // In a singular matrix cancellation leaves rounding error of the entry's own size.
        let least = 1e-14 * pivot;
        for v in &a[j][..j] {
            pivot -= v * v;
        }
        if !(pivot > least && pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let root = pivot.sqrt();
        a[j][j] = root;
        let across = a[j];
        for row in &mut a[j + 1..] {
            let mut v = row[j];
            for (x, y) in row[..j].iter().zip(&across) {
                v -= x * y;
            }
            row[j] = v / root;
        }
    }
    Some(())
}

/// `block <- block * L^-T` for a lower triangular `L`.
fn divide(block: &mut Block, l: &Block) {
    for row in block {
        forward(l, row);
    }
}

/// Solves `L y = y` in place.
#[inline]
pub(crate) fn forward(l: &Block, y: &mut [f64; 6]) {
    for i in 0..6 {
        let mut v = y[i];
        for k in 0..i {
            v -= l[i][k] * y[k];
        }
        y[i] = v / l[i][i];
    }
}

/// Solves `L^T y = y` in place.
#[inline]
pub(crate) fn backward(l: &Block, y: &mut [f64; 6]) {
    for i in (0..6).rev() {
        let mut v = y[i];
        for k in i + 1..6 {
            v -= l[k][i] * y[k];
        }
        y[i] = v / l[i][i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Purpose, Rng, rng};
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    /// A random sparse positive definite system: its pattern, blocks, and dense matrix.
    fn system(count: usize, pairs: usize, random: &mut Rng) -> (Pattern, Vec<Block>, DMatrix<f64>) {
        let mut neighbours = vec![Vec::new(); count];
        let mut chosen = Vec::new();
        for _ in 0..pairs {
            let (a, b) = (random.below(count), random.below(count));
            if a != b && !neighbours[a].contains(&(b as u32)) {
                neighbours[a].push(b as u32);
                neighbours[b].push(a as u32);
                chosen.push((a, b));
            }
        }
        let pattern = Pattern::new(neighbours);
        let mut values = vec![[[0.0; 6]; 6]; pattern.blocks()];
        let mut dense = DMatrix::zeros(6 * count, 6 * count);
        for v in 0..count {
            let (at, _) = pattern.find(v as u32, v as u32).unwrap();
            for i in 0..6 {
                values[at][i][i] = 13.0 * count as f64;
                dense[(6 * v + i, 6 * v + i)] = values[at][i][i];
            }
        }
        for (a, b) in chosen {
            let block: Block =
                std::array::from_fn(|_| std::array::from_fn(|_| 2.0 * random.unit() - 1.0));
            let (at, swapped) = pattern.find(a as u32, b as u32).unwrap();
            values[at] = if swapped { transposed(&block) } else { block };
            for r in 0..6 {
                for c in 0..6 {
                    dense[(6 * a + r, 6 * b + c)] = block[r][c];
                    dense[(6 * b + c, 6 * a + r)] = block[r][c];
                }
            }
        }
        (pattern, values, dense)
    }

    proptest! {
        /// Compared with a dense factorisation by another library.
        #[test]
        fn sparse_solution_matches_the_dense_one(count in 1usize..25, per in 0usize..5, seed in any::<u64>()) {
            let random = &mut rng(seed, 0, Purpose(1000));
            let (pattern, values, dense) = system(count, per * count, random);
            let b: Vec<[f64; 6]> = (0..count).map(|_| std::array::from_fn(|_| random.unit() - 0.5)).collect();
            let flat = DVector::from_fn(6 * count, |i, _| b[i / 6][i % 6]);
            let expected = dense.cholesky().unwrap().solve(&flat);
            let x = pattern.factor(values).unwrap().solve(&b);
            for (i, e) in expected.iter().enumerate() {
                prop_assert!((x[i / 6][i % 6] - e).abs() < 1e-13, "{} {e}", x[i / 6][i % 6]);
            }
        }

        /// One negative eigenvalue suffices.
        #[test]
        fn indefinite_matrix_has_no_factor(count in 1usize..12, seed in any::<u64>()) {
            let random = &mut rng(seed, 0, Purpose(1000));
            let (pattern, mut values, _) = system(count, 2 * count, random);
            let v = random.below(count) as u32;
            let (at, _) = pattern.find(v, v).unwrap();
            values[at][3][3] *= -1.0;
            prop_assert!(pattern.factor(values.clone()).is_none());
            values[at][3][3] = f64::NAN;
            prop_assert!(pattern.factor(values).is_none());
        }
    }

    #[test]
    fn empty_system_is_solved() {
        let pattern = Pattern::new(Vec::new());
        assert!(pattern.factor(Vec::new()).unwrap().solve(&[]).is_empty());
    }
}
