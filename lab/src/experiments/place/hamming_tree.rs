//! An incremental index without a vocabulary: a Hamming binary search tree after Schlegel and Grisetti, "HBST: a Hamming distance embedding
//! binary search tree for feature-based visual place recognition", RA-L 2018, implemented from the paper. Inner nodes test one bit; a full
//! leaf is split by the most balanced bit. A descriptor is compared only with those in its leaf, and votes for each keyframe with a match.

use super::method::{Method, best};
use stillpoint::features::Descriptor;

/// A leaf with more descriptors than this is split.
const LEAF: usize = 100;
/// Maximum deviation from one half of the share of descriptors with a bit set for which a leaf may be split by it.
const BALANCE: f64 = 0.1;

#[derive(Clone)]
enum Node {
    Inner { bit: u8, children: [u32; 2] },
    Leaf(Vec<(Descriptor, u32)>),
}

pub(crate) struct HammingTree {
    /// Maximum Hamming distance of matching descriptors.
    distance: u32,
    nodes: Vec<Node>,
}

fn bit(descriptor: &Descriptor, bit: u8) -> usize {
    (descriptor.0[usize::from(bit / 64)] >> (bit % 64) & 1) as usize
}

impl HammingTree {
    pub(crate) fn new(distance: u32) -> Self {
        Self {
            distance,
            nodes: vec![Node::Leaf(Vec::new())],
        }
    }

    fn leaf(&self, descriptor: &Descriptor) -> usize {
        let mut at = 0;
        while let Node::Inner { bit: b, children } = &self.nodes[at] {
            at = children[bit(descriptor, *b)] as usize;
        }
        at
    }

    fn split(&mut self, at: usize) {
        let Node::Leaf(entries) = &mut self.nodes[at] else {
            return;
        };
        // Bits tested above are equal in all entries, so they are never chosen.
        let off_balance = |b: u8| {
            let ones = entries.iter().filter(|(d, _)| bit(d, b) == 1).count();
            (ones as f64 / entries.len() as f64 - 0.5).abs()
        };
        let offs: Vec<f64> = (0..=255).map(off_balance).collect();
        let chosen =
            (0..=255_u8).min_by(|a, b| offs[usize::from(*a)].total_cmp(&offs[usize::from(*b)]));
        let Some(chosen) = chosen.filter(|b| offs[usize::from(*b)] < BALANCE) else {
            return;
        };
        let entries = std::mem::take(entries);
        let (ones, zeros) = entries.into_iter().partition(|(d, _)| bit(d, chosen) == 1);
        let first = self.nodes.len() as u32;
        self.nodes.extend([Node::Leaf(zeros), Node::Leaf(ones)]);
        self.nodes[at] = Node::Inner {
            bit: chosen,
            children: [first, first + 1],
        };
    }

    fn votes(&self, descriptors: &[Descriptor], admit: &dyn Fn(usize) -> bool) -> Vec<u32> {
        let mut votes = Vec::new();
        let mut voted: Vec<usize> = Vec::new();
        for (number, descriptor) in descriptors.iter().enumerate() {
            let Node::Leaf(entries) = &self.nodes[self.leaf(descriptor)] else {
                continue;
            };
            for (other, key) in entries {
                if descriptor.distance(other) > self.distance || !admit(*key as usize) {
                    continue;
                }
                let key = *key as usize;
                if voted.len() <= key {
                    voted.resize(key + 1, usize::MAX);
                    votes.resize(key + 1, 0);
                }
                // Each descriptor votes once per keyframe.
                if voted[key] != number {
                    voted[key] = number;
                    votes[key] += 1;
                }
            }
        }
        votes
    }
}

impl Method for HammingTree {
    fn name(&self) -> String {
        format!("Hamming tree, {} bits", self.distance)
    }

    fn clear(&mut self) {
        self.nodes = vec![Node::Leaf(Vec::new())];
    }

    fn insert(&mut self, key: usize, descriptors: &[Descriptor]) {
        for descriptor in descriptors {
            let at = self.leaf(descriptor);
            if let Node::Leaf(entries) = &mut self.nodes[at] {
                entries.push((*descriptor, key as u32));
                if entries.len() > LEAF {
                    self.split(at);
                }
            }
        }
    }

    fn query(
        &self,
        descriptors: &[Descriptor],
        admit: &dyn Fn(usize) -> bool,
        limit: usize,
    ) -> Vec<(usize, f64)> {
        let votes = self.votes(descriptors, admit);
        let share = |v: u32| f64::from(v) / descriptors.len().max(1) as f64;
        best(votes.into_iter().map(share).enumerate().collect(), limit)
    }

    fn bytes(&self) -> usize {
        let leaf = |node: &Node| match node {
            Node::Leaf(entries) => entries.capacity() * size_of::<(Descriptor, u32)>(),
            Node::Inner { .. } => 0,
        };
        let leaves: usize = self.nodes.iter().map(leaf).sum();
        leaves + self.nodes.capacity() * size_of::<Node>()
    }
}
