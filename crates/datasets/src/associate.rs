//! Which depth image belongs to which colour image.

/// Largest difference between the stamps of a pair, s, as in the TUM tools.
pub const DEFAULT_MAX_DT: f64 = 0.02;

/// Pairs `(i, j)` of indices with `|a[i] - b[j]| < max_dt`, one to one, the closest pairs first (greedy, as the TUM
/// RGB-D benchmark's association does), in ascending order of `i`. Equal differences are decided by the lower
/// index. Both lists must ascend.
#[must_use]
pub fn associate(a: &[f64], b: &[f64], max_dt: f64) -> Vec<(usize, usize)> {
    // The window is a little wider than the condition, so that rounding of its limits cannot lose a pair.
    let reach = max_dt + 1e-6;
    let mut candidates = Vec::new();
    let mut low = 0;
    for (i, &stamp) in a.iter().enumerate() {
        // Both lists ascend, so what lies too early for this stamp does so for all later ones.
        while low < b.len() && b[low] < stamp - reach {
            low += 1;
        }
        for (j, &other) in b.iter().enumerate().skip(low) {
            if other > stamp + reach {
                break;
            }
            let dt = (stamp - other).abs();
            if dt < max_dt {
                candidates.push((dt, i, j));
            }
        }
    }
    candidates.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let (mut used_a, mut used_b) = (vec![false; a.len()], vec![false; b.len()]);
    let mut pairs = Vec::new();
    for (_, i, j) in candidates {
        if !used_a[i] && !used_b[j] {
            (used_a[i], used_b[j]) = (true, true);
            pairs.push((i, j));
        }
    }
    pairs.sort_unstable();
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, without any window.
    fn brute_force(a: &[f64], b: &[f64], max_dt: f64) -> Vec<(usize, usize)> {
        let mut all: Vec<(f64, usize, usize)> = (0..a.len())
            .flat_map(|i| (0..b.len()).map(move |j| (i, j)))
            .map(|(i, j)| ((a[i] - b[j]).abs(), i, j))
            .filter(|c| c.0 < max_dt)
            .collect();
        all.sort_by(|x, y| x.partial_cmp(y).unwrap());
        let mut pairs: Vec<(usize, usize)> = Vec::new();
        for (_, i, j) in all {
            if pairs.iter().all(|p| p.0 != i && p.1 != j) {
                pairs.push((i, j));
            }
        }
        pairs.sort_unstable();
        pairs
    }

    fn stamps() -> impl Strategy<Value = Vec<f64>> {
        // Whole milliseconds make ties frequent.
        proptest::collection::btree_set(0u32..800, 0..40)
            .prop_map(|s| s.into_iter().map(|t| f64::from(t) * 1e-3).collect())
    }

    proptest! {
        #[test]
        fn equals_brute_force(a in stamps(), b in stamps(), max_dt in 0.0..0.05f64) {
            prop_assert_eq!(associate(&a, &b, max_dt), brute_force(&a, &b, max_dt));
        }
    }

    #[test]
    fn closest_pair_wins_and_leaves_the_other_alone() {
        assert_eq!(associate(&[0.0, 0.015], &[0.012], 0.02), [(1, 0)]);
        assert_eq!(associate(&[1.0], &[1.02], 0.02), []);
    }
}
