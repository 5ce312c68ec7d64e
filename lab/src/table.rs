//! Aligned Markdown tables, readable in a terminal, and common cells. `lab record` saves and `lab document` reproduces the tables printed
//! here.

pub(crate) use stillpoint::evaluation::{Align, Table};

/// Cell of a missing figure.
pub(crate) const ABSENT: &str = "-";

pub(crate) fn print(table: &Table) {
    print!("{}", table.to_markdown());
}

/// Median, minimum and maximum; NaN without values.
pub(crate) fn spread(values: impl IntoIterator<Item = f64>) -> [f64; 3] {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let at = |i: usize| sorted.get(i).copied().unwrap_or(f64::NAN);
    let n = sorted.len();
    let median = match n {
        0 => f64::NAN,
        _ if n % 2 == 1 => at(n / 2),
        _ => 0.5 * (at(n / 2 - 1) + at(n / 2)),
    };
    [median, at(0), at(n.max(1) - 1)]
}

/// A figure with the given number of decimals; NaN is absent.
pub(crate) fn figure(value: f64, digits: usize) -> String {
    if value.is_nan() {
        ABSENT.to_owned()
    } else {
        format!("{value:.digits$}")
    }
}

/// The median of values, and in brackets the range, unless both ends print alike.
pub(crate) fn median_and_range(values: impl IntoIterator<Item = f64>, digits: usize) -> String {
    let [median, least, greatest] = spread(values).map(|v| figure(v, digits));
    if least == greatest {
        median
    } else {
        format!("{median} ({least} to {greatest})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_show_median_and_range() {
        assert_eq!(spread([3.0, 1.0, 2.0, 10.0]), [2.5, 1.0, 10.0]);
        assert!(spread([]).iter().all(|v| v.is_nan()));
        assert_eq!(median_and_range([3.0, 1.0, 2.0], 1), "2.0 (1.0 to 3.0)");
        assert_eq!(median_and_range([1.01, 1.02], 1), "1.0");
        assert_eq!(median_and_range([], 1), ABSENT);
    }
}
