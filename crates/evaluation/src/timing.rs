//! Statistics of run times. Samples come from outside: nothing here reads a clock.

use crate::report::Table;

/// Statistics of samples, in their unit (milliseconds in this project's tables).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stats {
    /// Number of samples.
    pub n: usize,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
    /// Mean.
    pub mean: f64,
}

impl Stats {
    /// Statistics of the finite samples; all zero if there are none. Percentiles are interpolated linearly.
    #[must_use]
    pub fn of(samples: &[f64]) -> Self {
        let mut s: Vec<f64> = samples.iter().copied().filter(|x| x.is_finite()).collect();
        if s.is_empty() {
            return Self::default();
        }
        s.sort_unstable_by(f64::total_cmp);
        Self {
            n: s.len(),
            median: quantile(&s, 0.5),
            p95: quantile(&s, 0.95),
            p99: quantile(&s, 0.99),
            max: s[s.len() - 1],
            mean: s.iter().sum::<f64>() / s.len() as f64,
        }
    }
}

/// The `q` quantile (0 to 1) of ascending, non-empty samples.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let low = at.floor() as usize;
    let high = (low + 1).min(sorted.len() - 1);
    sorted[low] + (sorted[high] - sorted[low]) * (at - low as f64)
}

/// The table of stages that a run prints, in ms: `stage n median p95 p99 max`.
#[must_use]
pub fn table<'a>(stages: impl IntoIterator<Item = (&'a str, Stats)>) -> Table {
    let mut table = Table::new(["stage (ms)", "n", "median", "p95", "p99", "max"]);
    for (name, s) in stages {
        let ms = |x: f64| format!("{x:.2}");
        table.row([
            name.to_owned(),
            s.n.to_string(),
            ms(s.median),
            ms(s.p95),
            ms(s.p99),
            ms(s.max),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_interpolate() {
        let samples: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        let s = Stats::of(&samples);
        assert_eq!(
            (s.n, s.median, s.p95, s.p99, s.max, s.mean),
            (101, 50.0, 95.0, 99.0, 100.0, 50.0)
        );
        assert_eq!(Stats::of(&[1.0, 2.0]).median, 1.5);
        assert_eq!(Stats::of(&[f64::NAN]), Stats::default());
    }

    #[test]
    fn table_has_a_row_per_stage() {
        let text = table([("extract", Stats::of(&[1.0, 3.0]))]).to_text();
        assert!(
            text.ends_with("extract       2    2.00  2.90  2.98  3.00\n"),
            "{text}"
        );
    }
}
