//! Linear assignment with maximum sum.

/// Column assigned to each row so that the sum of values is maximal, with at most one column per row and one row per
/// column: shortest augmenting paths with potentials (Kuhn 1955, Munkres 1957; the cubic form of Jonker and Volgenant,
/// A shortest augmenting path algorithm for dense and sparse linear assignment problems, Computing 38, 1987). All rows
/// must have the same length. With more rows than columns, some rows stay unassigned.
///
/// Ties are deterministic: rows are processed in order, and of equally short paths the one to the lower column wins.
/// Whole numbers below 2^53, sums included, are exact. Values must be finite; a row whose values are not gets no
/// column.
#[must_use]
pub fn assign(values: &[Vec<f64>]) -> Vec<Option<usize>> {
    let (rows, columns) = (values.len(), values.first().map_or(0, Vec::len));
    let mut assigned = vec![None; rows];
    if rows <= columns {
        for (column, row) in solve(rows, columns, |i, j| -values[i][j]) {
            assigned[row] = Some(column);
        }
    } else if columns > 0 {
        for (row, column) in solve(columns, rows, |i, j| -values[j][i]) {
            assigned[row] = Some(column);
        }
    }
    assigned
}

/// Pairs (column, row) with the minimum sum of costs; needs at most as many rows as columns.
fn solve(rows: usize, columns: usize, cost: impl Fn(usize, usize) -> f64) -> Vec<(usize, usize)> {
    // Index 0 of rows and columns means "none".
    let mut row_potential = vec![0.0; rows + 1];
    let mut column_potential = vec![0.0; columns + 1];
    let mut row_of = vec![0; columns + 1];
    for row in 1..=rows {
        let mut back = vec![0; columns + 1];
        let mut slack = vec![f64::INFINITY; columns + 1];
        let mut used = vec![false; columns + 1];
        row_of[0] = row;
        let mut at = 0;
        while row_of[at] != 0 {
            used[at] = true;
            let i = row_of[at];
            let (mut step, mut next) = (f64::INFINITY, 0);
            for j in 1..=columns {
                if used[j] {
                    continue;
                }
                let reduced = cost(i - 1, j - 1) - row_potential[i] - column_potential[j];
                if reduced < slack[j] {
                    (slack[j], back[j]) = (reduced, at);
                }
                if slack[j] < step {
                    (step, next) = (slack[j], j);
                }
            }
            if next == 0 {
                at = 0;
                break;
            }
            for j in 0..=columns {
                if used[j] {
                    row_potential[row_of[j]] += step;
                    column_potential[j] -= step;
                } else {
                    slack[j] -= step;
                }
            }
            at = next;
        }
        while at != 0 {
            row_of[at] = row_of[back[at]];
            at = back[at];
        }
    }
    (1..=columns)
        .filter(|&j| row_of[j] != 0)
        .map(|j| (j - 1, row_of[j] - 1))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all_sums(values: &[Vec<f64>], taken: &mut Vec<bool>) -> Vec<f64> {
        let Some((first, rest)) = values.split_first() else {
            return vec![0.0];
        };
        let mut sums = if values.len() > taken.iter().filter(|t| !**t).count() {
            all_sums(rest, taken)
        } else {
            Vec::new()
        };
        for j in 0..first.len() {
            if !taken[j] {
                taken[j] = true;
                sums.extend(all_sums(rest, taken).into_iter().map(|sum| first[j] + sum));
                taken[j] = false;
            }
        }
        sums
    }

    fn greatest(values: &[Vec<f64>]) -> f64 {
        let columns = values.first().map_or(0, Vec::len);
        let sums = all_sums(values, &mut vec![false; columns]);
        sums.into_iter().fold(f64::NEG_INFINITY, f64::max)
    }

    fn sum(values: &[Vec<f64>], found: &[Option<usize>]) -> f64 {
        let of = |(i, j): (usize, &Option<usize>)| Some(values[i][(*j)?]);
        found.iter().enumerate().filter_map(of).sum()
    }

    /// A `rows` x `columns` matrix from a list of at least 16 numbers.
    fn matrix<T: Copy + Into<f64>>(rows: usize, columns: usize, numbers: &[T]) -> Vec<Vec<f64>> {
        let row = |i: usize| numbers[i * 4..i * 4 + columns].iter();
        (0..rows)
            .map(|i| row(i).map(|v| (*v).into()).collect())
            .collect()
    }

    proptest! {
        #[test]
        fn assignment_is_optimal(rows in 1..5_usize, columns in 1..5_usize, v in prop::collection::vec(0.0..1.0_f64, 16)) {
            let values = matrix(rows, columns, &v);
            let found = assign(&values);
            prop_assert_eq!(found.iter().flatten().count(), rows.min(columns));
            prop_assert!((sum(&values, &found) - greatest(&values)).abs() < 1e-12);
        }

        /// Whole numbers, many of them equal, some below all sums of the others.
        #[test]
        fn integer_values_are_assigned_exactly(rows in 1..5_usize, columns in 1..5_usize, v in prop::collection::vec(prop_oneof![-4..4_i32, Just(-1_000_000_000)], 16)) {
            let values = matrix(rows, columns, &v);
            prop_assert_eq!(sum(&values, &assign(&values)), greatest(&values));
        }

        /// With a unique optimum the order of rows and columns does not matter.
        #[test]
        fn unique_optimum_is_independent_of_order(
            v in prop::collection::vec(0..1000_i32, 16),
            row_order in Just([0, 1, 2, 3_usize]).prop_shuffle(),
            column_order in Just([0, 1, 2, 3_usize]).prop_shuffle(),
        ) {
            let values = matrix(4, 4, &v);
            let best = greatest(&values);
            let sums = all_sums(&values, &mut vec![false; 4]);
            prop_assume!(sums.iter().filter(|sum| **sum == best).count() == 1);
            let shuffled: Vec<Vec<f64>> = row_order.iter().map(|i| column_order.iter().map(|j| values[*i][*j]).collect()).collect();
            let (found, of_shuffled) = (assign(&values), assign(&shuffled));
            for (row, column) in of_shuffled.iter().enumerate() {
                prop_assert_eq!(found[row_order[row]], column.map(|j| column_order[j]));
            }
        }

        #[test]
        fn ties_are_resolved_by_index(rows in 1..9_usize, columns in 1..9_usize, value in -5..5_i32) {
            let found = assign(&vec![vec![f64::from(value); columns]; rows]);
            let expected: Vec<Option<usize>> = (0..rows).map(|i| (i < columns).then_some(i)).collect();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn transposed_assignment_has_the_same_sum(rows in 1..5_usize, columns in 1..5_usize, v in prop::collection::vec(-9..9_i32, 16)) {
            let values = matrix(rows, columns, &v);
            let turned: Vec<Vec<f64>> = (0..columns).map(|j| (0..rows).map(|i| values[i][j]).collect()).collect();
            prop_assert_eq!(sum(&turned, &assign(&turned)), sum(&values, &assign(&values)));
        }
    }

    #[test]
    fn empty_input_gives_no_assignment() {
        assert!(assign(&[]).is_empty());
        assert_eq!(assign(&[vec![], vec![]]), [None, None]);
    }

    #[test]
    fn non_finite_values_are_not_assigned() {
        let values = [vec![f64::NAN, f64::NEG_INFINITY], vec![1.0, 2.0]];
        assert_eq!(assign(&values), [None, Some(1)]);
    }
}
