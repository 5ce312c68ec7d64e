//! Confidence intervals of differences: percentile bootstrap (Efron) over inputs and over the seeds of each input.
//!
//! Inputs are resampled too, because a difference should hold for other inputs of the kind.

use crate::table::spread;
use stillpoint::estimation::{Purpose, Rng, rng};

/// Bootstrap resamples: the ends of the interval are then accurate to about a tenth of its width.
pub(crate) const RESAMPLES: usize = 10_000;
/// Share of the resamples outside the interval.
pub(crate) const OUTSIDE: f64 = 0.05;
/// Fixed, for reproducible verdicts.
const SEED: u64 = 1;
/// Beyond the library's own purposes.
const DRAWS: Purpose = Purpose(1000);

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    pub(crate) value: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// How values are aggregated over seeds and inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sum {
    /// Ratios: median over seeds, geometric mean over inputs.
    Ratios,
    /// Differences of counts: means.
    Differences,
}

impl Sum {
    fn of_input(self, values: &[f64]) -> f64 {
        match self {
            Self::Ratios => spread(values.iter().copied())[0],
            Self::Differences => mean(values.iter().copied()),
        }
    }

    fn of_all(self, each: impl ExactSizeIterator<Item = f64>) -> f64 {
        match self {
            Self::Ratios => mean(each.map(f64::ln)).exp(),
            Self::Differences => mean(each),
        }
    }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    values.sum::<f64>() / n
}

/// `inputs`: a value per seed. A share `outside` of the resamples lies outside the interval.
pub(crate) fn estimate(inputs: &[Vec<f64>], sum: Sum, outside: f64) -> Estimate {
    let mut random = rng(SEED, 0, DRAWS);
    let mut drawn = Vec::new();
    let mut values: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            sum.of_all(inputs.iter().map(|_| {
                let seeds = &inputs[random.below(inputs.len())];
                redraw(&mut drawn, seeds, &mut random);
                sum.of_input(&drawn)
            }))
        })
        .collect();
    values.sort_by(f64::total_cmp);
    let last = RESAMPLES - 1;
    let at = |share: f64| values[((share * last as f64).round() as usize).min(last)];
    Estimate {
        value: sum.of_all(inputs.iter().map(|seeds| sum.of_input(seeds))),
        low: at(0.5 * outside),
        high: at(1.0 - 0.5 * outside),
    }
}

fn redraw(drawn: &mut Vec<f64>, values: &[f64], random: &mut Rng) {
    drawn.clear();
    drawn.extend(values.iter().map(|_| values[random.below(values.len())]));
}

/// Whether this many independent pairs agree by chance more rarely than `outside`.
pub(crate) fn enough(independent: usize, outside: f64) -> bool {
    0.5_f64.powi(independent as i32 - 1) <= outside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimate_is_the_mean_of_medians() {
        let inputs = [vec![1.0, 4.0, 100.0], vec![0.25, 9.0, 0.001]];
        let all = estimate(&inputs, Sum::Ratios, OUTSIDE);
        assert!((all.value - 1.0).abs() < 1e-12, "{all:?}");
        let means = estimate(&[vec![1.0, 3.0], vec![-1.0]], Sum::Differences, OUTSIDE);
        assert_eq!(means.value, 0.5);
    }

    #[test]
    fn equal_values_have_an_interval_of_zero_width() {
        let all = estimate(&[vec![1.0; 5], vec![1.0; 2]], Sum::Ratios, OUTSIDE);
        assert_eq!((all.value, all.low, all.high), (1.0, 1.0, 1.0));
    }

    /// 1.96 standard deviations of the mean to both sides.
    #[test]
    fn interval_width_matches_theory() {
        let mut random = rng(7, 0, DRAWS);
        let values: Vec<f64> = (0..400).map(|_| random.unit()).collect();
        let e = estimate(std::slice::from_ref(&values), Sum::Differences, OUTSIDE);
        let deviation = (1.0 / 12.0 / 400.0_f64).sqrt();
        let width = (e.high - e.low) / (2.0 * 1.96 * deviation);
        assert!((0.9..1.1).contains(&width), "{width}");
        assert!(e.low < e.value && e.value < e.high);
        assert_eq!(e, estimate(&[values], Sum::Differences, OUTSIDE));
    }

    #[test]
    fn inputs_that_disagree_widen_the_interval() {
        let e = estimate(
            &[vec![1.03; 9], vec![1.01; 9], vec![0.99; 9]],
            Sum::Ratios,
            OUTSIDE,
        );
        assert!(e.value > 1.0 && e.low < 1.0 && e.high > 1.02, "{e:?}");
    }

    #[test]
    fn too_few_seeds_are_inconclusive() {
        assert!(!enough(5, OUTSIDE) && enough(6, OUTSIDE));
        assert!(!enough(8, OUTSIDE / 10.0) && enough(9, OUTSIDE / 10.0));
        assert!(!enough(0, OUTSIDE) && !enough(1, OUTSIDE));
    }
}
