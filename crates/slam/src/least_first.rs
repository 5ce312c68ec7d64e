//! Queue entries for shortest paths in a graph (Dijkstra): a [`BinaryHeap`](std::collections::BinaryHeap) returns the
//! least cost first.

use std::cmp::Ordering;

/// A node, the cost of the path to it, and a value for that path. The order is reversed: the least cost is the
/// greatest; ties go to the least node.
pub(crate) struct Reached<N, V = ()> {
    pub(crate) cost: f64,
    pub(crate) node: N,
    pub(crate) value: V,
}

impl<N: Ord, V> Ord for Reached<N, V> {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_cost = other.cost.total_cmp(&self.cost);
        by_cost.then_with(|| other.node.cmp(&self.node))
    }
}
impl<N: Ord, V> PartialOrd for Reached<N, V> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<N: Ord, V> PartialEq for Reached<N, V> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl<N: Ord, V> Eq for Reached<N, V> {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BinaryHeap;

    #[test]
    fn queue_orders_by_cost_then_by_node() {
        let reached = |(cost, node)| Reached {
            cost,
            node,
            value: (),
        };
        let mut queue: BinaryHeap<Reached<u32>> =
            [(2.0, 1), (1.0, 5), (1.0, 3), (3.0, 0)].map(reached).into();
        let order: Vec<u32> = std::iter::from_fn(|| queue.pop()).map(|r| r.node).collect();
        assert_eq!(order, [3, 5, 1, 0]);
    }
}
