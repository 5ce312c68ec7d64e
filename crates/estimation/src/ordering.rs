//! Elimination order for sparse Cholesky factorisation.

use std::collections::BTreeSet;

/// The elimination order (variable at each position) by approximate minimum degree (Amestoy, Davis, Duff, "An
/// approximate minimum degree ordering algorithm", SIAM J. Matrix Anal. Appl. 17(4), 1996), on the quotient graph,
/// without supervariables. Ties go to the lower number.
///
/// `neighbours[v]` lists the variables that share a nonzero with `v`, symmetric, without `v`.
pub(crate) fn minimum_degree(neighbours: Vec<Vec<u32>>) -> Vec<u32> {
    let count = neighbours.len();
    let mut graph = Quotient::new(neighbours);
    let mut order = Vec::with_capacity(count);
    while let Some((_, pivot)) = graph.queue.pop_first() {
        graph.eliminate(pivot);
        order.push(pivot);
    }
    order
}

/// The remaining graph. An eliminated variable becomes an element: a clique of the variables that it connected.
struct Quotient {
    /// Per variable: variables with a shared original entry not covered by an element.
    variables: Vec<Vec<u32>>,
    elements: Vec<Vec<u32>>,
    /// Per element: its variables. Emptied when another element contains them all.
    members: Vec<Vec<u32>>,
    degree: Vec<u32>,
    queue: BTreeSet<(u32, u32)>,
    /// Marks of the current step: `mark[v] == step`.
    mark: Vec<u32>,
    /// Per element: number of its variables outside the new one, and the step of that count.
    outside: Vec<(u32, u32)>,
}

impl Quotient {
    fn new(variables: Vec<Vec<u32>>) -> Self {
        let count = variables.len();
        let degree: Vec<u32> = variables.iter().map(|n| n.len() as u32).collect();
        Self {
            queue: degree
                .iter()
                .enumerate()
                .map(|(v, d)| (*d, v as u32))
                .collect(),
            variables,
            elements: vec![Vec::new(); count],
            members: vec![Vec::new(); count],
            degree,
            mark: vec![u32::MAX; count],
            outside: vec![(0, u32::MAX); count],
        }
    }

    fn eliminate(&mut self, pivot: u32) {
        let clique = self.absorb(pivot);
        self.count_outside(pivot, &clique);
        let left = self.queue.len() as u32;
        for &v in &clique {
            let degree = self.update(pivot, v, clique.len() as u32).min(left - 1);
            let old = std::mem::replace(&mut self.degree[v as usize], degree);
            self.queue.remove(&(old, v));
            self.queue.insert((degree, v));
        }
        self.members[pivot as usize] = clique;
    }

    /// The variables that the pivot connects: its neighbours and those in its elements, which it replaces.
    fn absorb(&mut self, pivot: u32) -> Vec<u32> {
        self.mark[pivot as usize] = pivot;
        let mut clique = std::mem::take(&mut self.variables[pivot as usize]);
        for &v in &clique {
            self.mark[v as usize] = pivot;
        }
        for e in std::mem::take(&mut self.elements[pivot as usize]) {
            for v in std::mem::take(&mut self.members[e as usize]) {
                if self.mark[v as usize] != pivot {
                    self.mark[v as usize] = pivot;
                    clique.push(v);
                }
            }
        }
        clique
    }

    /// For each element that meets the clique, counts its variables outside.
    fn count_outside(&mut self, pivot: u32, clique: &[u32]) {
        for &v in clique {
            for &e in &self.elements[v as usize] {
                let size = self.members[e as usize].len() as u32;
                let (outside, step) = &mut self.outside[e as usize];
                if *step != pivot {
                    (*outside, *step) = (size, pivot);
                }
                *outside = outside.saturating_sub(1);
            }
        }
    }

    /// Replaces the elements of `v` by the new one and returns an upper bound of its degree.
    fn update(&mut self, pivot: u32, v: u32, clique: u32) -> u32 {
        let mark = &self.mark;
        let direct = &mut self.variables[v as usize];
        direct.retain(|u| mark[*u as usize] != pivot);
        let mut degree = direct.len() as u32 + clique - 1;
        let (outside, members) = (&self.outside, &self.members);
        self.elements[v as usize].retain(|e| {
            // Drops absorbed elements, which are empty, and those covered by the new one.
            let beyond = outside[*e as usize].0;
            let keep = !members[*e as usize].is_empty() && beyond > 0;
            degree += if keep { beyond } else { 0 };
            keep
        });
        self.elements[v as usize].push(pivot);
        degree
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Purpose, rng};
    use proptest::prelude::*;

    fn symmetric(count: usize, pairs: &[(u32, u32)]) -> Vec<Vec<u32>> {
        let mut neighbours = vec![Vec::new(); count];
        for (a, b) in pairs.iter().filter(|(a, b)| a != b) {
            neighbours[*a as usize].push(*b);
            neighbours[*b as usize].push(*a);
        }
        for n in &mut neighbours {
            n.sort_unstable();
            n.dedup();
        }
        neighbours
    }

    /// Entries below the diagonal of the factor, by naive elimination.
    fn fill(count: usize, neighbours: &[Vec<u32>], order: &[u32]) -> usize {
        let mut left: Vec<BTreeSet<u32>> = neighbours
            .iter()
            .map(|n| n.iter().copied().collect())
            .collect();
        assert_eq!(order.len(), count);
        let mut sum = 0;
        for &p in order {
            let clique: Vec<u32> = std::mem::take(&mut left[p as usize]).into_iter().collect();
            sum += clique.len();
            for &a in &clique {
                left[a as usize].remove(&p);
                left[a as usize].extend(clique.iter().filter(|b| **b != a));
            }
        }
        sum
    }

    proptest! {
        /// Every variable once, and never much more fill than with the exact degree.
        #[test]
        fn minimum_degree_order_is_a_permutation(count in 1usize..60, seed in any::<u64>(), per in 0usize..4) {
            let random = &mut rng(seed, 0, Purpose(1000));
            let pairs: Vec<_> = (0..per * count)
                .map(|_| (random.below(count) as u32, random.below(count) as u32))
                .collect();
            let neighbours = symmetric(count, &pairs);
            let mut order = minimum_degree(neighbours.clone());
            let ours = fill(count, &neighbours, &order);
            let natural: Vec<u32> = (0..count as u32).collect();
            prop_assert!(ours <= fill(count, &neighbours, &natural));
            order.sort_unstable();
            prop_assert_eq!(order, natural);
        }
    }

    /// A star eliminated from its centre fills in; chains and stars have orders without fill.
    #[test]
    fn trees_have_no_fill() {
        let star = symmetric(50, &(1..50).map(|i| (0, i)).collect::<Vec<_>>());
        assert_eq!(fill(50, &star, &minimum_degree(star.clone())), 49);
        let chain = symmetric(50, &(1..50).map(|i| (i - 1, i)).collect::<Vec<_>>());
        assert_eq!(fill(50, &chain, &minimum_degree(chain.clone())), 49);
        assert!(fill(50, &star, &(0..50).collect::<Vec<_>>()) == 49 * 50 / 2);
    }
}
