//! The assignment of the greatest sum.

/// For each row its column, by the greatest sum of values of one column per row and one row per column (Kuhn 1955; the form with potentials, of cubic
/// effort). All rows have the same length. Where there are more rows than columns some rows have none.
pub(super) fn assign(values: &[Vec<f64>]) -> Vec<Option<usize>> {
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

/// Pairs of column and row of the least sum, for at most as many rows as columns.
fn solve(rows: usize, columns: usize, cost: impl Fn(usize, usize) -> f64) -> Vec<(usize, usize)> {
    // Row and column 0 stand for none.
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

    /// The greatest sum by trying all.
    fn greatest(values: &[Vec<f64>], taken: &mut Vec<bool>) -> f64 {
        let Some((first, rest)) = values.split_first() else {
            return 0.0;
        };
        let mut best = if values.len() > taken.iter().filter(|t| !**t).count() {
            greatest(rest, taken)
        } else {
            f64::NEG_INFINITY
        };
        for j in 0..first.len() {
            if !taken[j] {
                taken[j] = true;
                best = best.max(first[j] + greatest(rest, taken));
                taken[j] = false;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn is_the_best_of_all(rows in 1..5_usize, columns in 1..5_usize, v in prop::collection::vec(0.0..1.0_f64, 16)) {
            let values: Vec<Vec<f64>> = (0..rows).map(|i| v[i * 4..i * 4 + columns].to_vec()).collect();
            let found = assign(&values);
            let sum: f64 = found.iter().enumerate().filter_map(|(i, j)| Some(values[i][(*j)?])).sum();
            prop_assert_eq!(found.iter().flatten().count(), rows.min(columns));
            prop_assert!((sum - greatest(&values, &mut vec![false; columns])).abs() < 1e-12);
        }
    }

    #[test]
    fn nothing_is_assigned_to_nothing() {
        assert!(assign(&[]).is_empty());
        assert_eq!(assign(&[vec![], vec![]]), [None, None]);
    }
}
