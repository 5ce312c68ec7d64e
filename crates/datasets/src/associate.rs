//! Association of depth and colour images.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Maximum stamp difference of a pair, s, as in the TUM tools.
pub const DEFAULT_MAX_DT: f64 = 0.02;

/// Pairs `(i, j)` of indices with `|a[i] - b[j]| < max_dt`, one to one, closest first (greedy, as in the TUM RGB-D benchmark), in ascending
/// order of `i`. Ties take the lower index. Both lists must ascend.
#[must_use]
pub fn associate(a: &[f64], b: &[f64], max_dt: f64) -> Vec<(usize, usize)> {
    let mut row = Row::of(a, b);
    // The closest two remaining stamps are always adjacent: anything between them would be closer to one of the two. So a list of
    // neighbours suffices, however many stamps are within `max_dt` of each other.
    let mut open: BinaryHeap<Reverse<Neighbours>> = (1..row.items.len())
        .filter_map(|right| row.neighbours(right - 1, right, max_dt))
        .map(Reverse)
        .collect();
    let mut pairs = Vec::new();
    while let Some(Reverse(closest)) = open.pop() {
        if row.taken[closest.left] || row.taken[closest.right] {
            continue;
        }
        pairs.push(closest.pair);
        if let Some((left, right)) = row.take(closest.left, closest.right) {
            open.extend(row.neighbours(left, right, max_dt).map(Reverse));
        }
    }
    pairs.sort_unstable();
    pairs
}

/// The merged stamps of both lists, from which pairs are removed.
struct Row {
    /// Whether it is from the second list, its index there, and its stamp, s.
    items: Vec<(bool, usize, f64)>,
    /// Remaining predecessor and successor of each; the number of items for none.
    before: Vec<usize>,
    behind: Vec<usize>,
    taken: Vec<bool>,
}

/// Two adjacent stamps from different lists. Ordered by the sequence in which pairs are taken.
#[derive(Debug)]
struct Neighbours {
    dt: f64,
    pair: (usize, usize),
    left: usize,
    right: usize,
}

impl Row {
    fn of(a: &[f64], b: &[f64]) -> Self {
        let list = |second: bool, stamps: &[f64]| -> Vec<(bool, usize, f64)> {
            let numbered = stamps.iter().enumerate();
            numbered.map(|(i, t)| (second, i, *t)).collect()
        };
        let mut items = list(false, a);
        items.extend(list(true, b));
        // Both lists ascend, so this merges them.
        items.sort_by(|x, y| x.2.total_cmp(&y.2));
        let n = items.len();
        Self {
            before: (0..n).map(|i| i.checked_sub(1).unwrap_or(n)).collect(),
            behind: (1..=n).collect(),
            taken: vec![false; n],
            items,
        }
    }

    /// Two neighbours, if they may form a pair.
    fn neighbours(&self, left: usize, right: usize, max_dt: f64) -> Option<Neighbours> {
        let (x, y) = (self.items[left], self.items[right]);
        let pair = match (x.0, y.0) {
            (false, true) => (x.1, y.1),
            (true, false) => (y.1, x.1),
            _ => return None,
        };
        let dt = (x.2 - y.2).abs();
        (dt < max_dt).then_some(Neighbours {
            dt,
            pair,
            left,
            right,
        })
    }

    /// Removes two neighbours, and returns the indices that become adjacent.
    fn take(&mut self, left: usize, right: usize) -> Option<(usize, usize)> {
        (self.taken[left], self.taken[right]) = (true, true);
        let (before, behind) = (self.before[left], self.behind[right]);
        if let Some(of_behind) = self.before.get_mut(behind) {
            *of_behind = before;
        }
        if let Some(of_before) = self.behind.get_mut(before) {
            *of_before = behind;
        }
        let n = self.items.len();
        (before < n && behind < n).then_some((before, behind))
    }
}

impl Ord for Neighbours {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_distance = self.dt.total_cmp(&other.dt);
        by_distance.then(self.pair.cmp(&other.pair))
    }
}

impl PartialOrd for Neighbours {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Neighbours {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Neighbours {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, by exhaustive search.
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
        fn association_equals_brute_force(a in stamps(), b in stamps(), max_dt in 0.0..0.05f64) {
            prop_assert_eq!(associate(&a, &b, max_dt), brute_force(&a, &b, max_dt));
        }
    }

    #[test]
    fn closest_pair_wins_and_leaves_the_other_alone() {
        assert_eq!(associate(&[0.0, 0.015], &[0.012], 0.02), [(1, 0)]);
        assert_eq!(associate(&[1.0], &[1.02], 0.02), []);
    }

    /// Listing all pairs within the limit would take 10^9 steps.
    #[test]
    fn many_close_stamps_are_associated_quickly() {
        let n = 30_000;
        let a: Vec<f64> = (0..n).map(|i| f64::from(i) * 1e-7).collect();
        let b: Vec<f64> = a.iter().map(|t| t + 3e-8).collect();
        let pairs = associate(&a, &b, 0.02);
        assert!(pairs.len() == n as usize && pairs.iter().all(|(i, j)| i == j));
    }
}
