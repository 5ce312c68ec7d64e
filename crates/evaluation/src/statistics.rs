//! Statistics of a set of errors.

/// Statistics of errors, in the unit of the errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Number of errors.
    pub count: usize,
    /// Root mean square.
    pub rmse: f64,
    /// Standard deviation about the mean (of the population, as in the TUM and evo tools).
    pub sd: f64,
    /// Mean.
    pub mean: f64,
    /// Median; of an even number the mean of the two in the middle.
    pub median: f64,
    /// Largest.
    pub max: f64,
}

impl Statistics {
    /// Statistics of a list of errors, `None` for an empty one.
    #[must_use]
    pub fn of(errors: &[f64]) -> Option<Self> {
        if errors.is_empty() {
            return None;
        }
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let mut sorted = errors.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let half = sorted.len() / 2;
        let median = if sorted.len() % 2 == 1 {
            sorted[half]
        } else {
            0.5 * (sorted[half - 1] + sorted[half])
        };
        Some(Self {
            count: errors.len(),
            rmse: (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
            sd: (errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / n).sqrt(),
            mean,
            median,
            max: sorted[sorted.len() - 1],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn statistics_match_known_values() {
        let s = Statistics::of(&[4.0, 0.0, 2.0, 2.0]).unwrap();
        assert_eq!((s.count, s.mean, s.median, s.max), (4, 2.0, 2.0, 4.0));
        assert!((s.rmse - 6f64.sqrt()).abs() < 1e-15 && (s.sd - 2f64.sqrt()).abs() < 1e-15);
        assert_eq!(Statistics::of(&[3.0, 1.0, 2.0]).unwrap().median, 2.0);
        assert_eq!(Statistics::of(&[]), None);
    }

    proptest! {
        #[test]
        fn mean_square_is_mean_squared_plus_variance(e in proptest::collection::vec(0.0..10.0f64, 1..50)) {
            let s = Statistics::of(&e).unwrap();
            prop_assert!((s.rmse * s.rmse - s.mean * s.mean - s.sd * s.sd).abs() < 1e-9);
            prop_assert!(s.median <= s.max && s.mean <= s.rmse + 1e-12 && s.rmse <= s.max + 1e-12);
        }
    }
}
