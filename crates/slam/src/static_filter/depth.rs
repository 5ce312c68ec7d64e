//! Part D: the depth that separates an object in a box from the background: Algorithm 1 of the publication that preset
//! `paper` follows (doi:10.1007/s11554-024-01527-4).

use stillpoint_estimation::{Rng, ransac_iterations};

/// Probability of drawing the best pair at least once, as is usual (Hartley, Zisserman, "Multiple View Geometry", 2004,
/// section 4.7).
const CONFIDENCE: f64 = 0.99;
/// Minimum and maximum number of draws. Chosen: with ten, a lucky first draw does not end the search; 200 suffice where
/// 15 % support the best pair.
const ITERATIONS: (usize, usize) = (10, 200);
/// The depth (m) beyond which features in a box are background; `None` if there are too few depths, or all are equal.
///
/// Algorithm 1 of the published method: draw two features; each other one whose depth exceeds the mean of the three
/// supports them; the mean depth of the supporters is their threshold. The draw with most supporters wins, ties go to
/// the deeper one.
pub(super) fn threshold(depths: &[f64], mut rng: Rng) -> Option<f64> {
    if depths.len() < 3 {
        return None;
    }
    let mut best = (0_usize, 0.0_f64);
    let (mut drawn, mut needed) = (0, ITERATIONS.1);
    while drawn < needed {
        drawn += 1;
        let [i, j] = rng.distinct::<2>(depths.len())?;
        let pair = depths[i] + depths[j];
        let (mut count, mut sum) = (0_usize, 0.0);
        for (k, z) in depths.iter().enumerate() {
            if k != i && k != j && *z > (pair + z) / 3.0 {
                count += 1;
                sum += z;
            }
        }
        let mean = if count > 0 { sum / count as f64 } else { 0.0 };
        if (count, mean) > best {
            best = (count, mean);
            let share = count as f64 / depths.len() as f64;
            needed = ransac_iterations(CONFIDENCE, share, 2, ITERATIONS);
        }
    }
    (best.0 > 0).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_estimation::{Purpose, rng};

    fn stream(seed: u64) -> Rng {
        rng(seed, 0, Purpose::DEPTH)
    }

    #[test]
    fn threshold_separates_person_and_wall() {
        let person = (0..30).map(|i| 1.5 + 0.005 * f64::from(i % 7));
        let wall = (0..20).map(|i| 3.5 + 0.01 * f64::from(i % 5));
        let depths: Vec<f64> = person.chain(wall).collect();
        for seed in 0..50 {
            let t = threshold(&depths, stream(seed)).unwrap();
            assert!(t > 1.6 && t < 3.6, "{t}");
        }
    }

    #[test]
    fn single_mode_is_split() {
        let slope: Vec<f64> = (0..60).map(|i| 2.0 + 0.01 * f64::from(i)).collect();
        for seed in 0..50 {
            let t = threshold(&slope, stream(seed)).unwrap();
            assert!(t > 2.2 && t < 2.59, "{t}");
        }
    }

    #[test]
    fn too_few_or_equal_depths_are_not_split() {
        assert_eq!(threshold(&[1.0, 2.0], stream(0)), None);
        assert_eq!(threshold(&[1.5; 20], stream(0)), None);
        assert!(threshold(&[1.0, 2.0, 3.0], stream(0)).is_some());
    }

    /// The best of several draws lies near the top of the distribution of single draws.
    #[test]
    fn best_of_several_draws_is_kept() {
        let depths: Vec<f64> = (0..40).map(|i| 1.0 + 0.05 * f64::from(i)).collect();
        // For the two nearest: the mean of all others.
        let best = depths[2..].iter().sum::<f64>() / 38.0;
        let errors = (0..200).map(|s| threshold(&depths, stream(s)).unwrap() - best);
        let mut errors: Vec<f64> = errors.collect();
        errors.sort_by(f64::total_cmp);
        assert!(errors[0] > -1e-9);
        // A single draw has a median error of half a metre.
        let (median, most) = (errors[100], errors[190]);
        assert!(median < 0.25 && most < 0.45, "{median} {most}");
    }

    #[test]
    fn threshold_with_the_most_supporters_wins() {
        // The two nearest features have the most supporters: all others. With fewer supporters the threshold is deeper,
        // so a draw that misses the optimum ends deeper.
        let depths = [1.0, 1.01, 1.02, 1.03, 1.04, 3.0, 3.01, 3.02, 3.03, 3.04];
        let best: f64 = depths[2..].iter().sum::<f64>() / 8.0;
        let found: Vec<f64> = (0..300)
            .map(|s| threshold(&depths, stream(s)).unwrap())
            .collect();
        assert!(found.iter().all(|t| *t > best - 1e-12));
        assert!(found.iter().any(|t| (t - best).abs() < 1e-12));
    }
}
