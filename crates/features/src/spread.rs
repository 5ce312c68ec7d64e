//! Even spatial distribution of corners.
//!
//! A quadtree over the image is split until it has as many leaves as corners are wanted; each leaf contributes its
//! strongest corner, as in ORB-SLAM2 (Mur-Artal, Tardos 2017). Corners are sorted by the Morton code of their position,
//! so a node is a range of the sorted array and splitting moves nothing.

use crate::fast::Corner;

/// Depth of the tree below a root: leaves down to 1/128 of the image's height. Two bits for each of seven levels and
/// two for the root ([`MAX_ROOTS`]) make a key of 16 bits.
const DEPTH: u32 = 7;
/// Maximum number of roots side by side, so that nodes are nearly square. With more than four the keys would need more
/// than 16 bits.
const MAX_ROOTS: usize = 4;

#[derive(Clone, Copy, Debug)]
struct Node {
    begin: u32,
    end: u32,
}

impl Node {
    fn len(self) -> u32 {
        self.end - self.begin
    }
}

/// Selects corners, with its buffers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Spread {
    /// (Morton key, index of the corner), sorted.
    keys: Vec<(u16, u32)>,
    scratch: Vec<(u16, u32)>,
    nodes: Vec<Node>,
    next: Vec<Node>,
}

impl Spread {
    /// Appends about `quota` (up to two more, fewer if corners are few or clustered) of `corners`, spread evenly over
    /// an image of this size.
    pub(crate) fn choose(
        &mut self,
        corners: &[Corner],
        size: (usize, usize),
        quota: usize,
        out: &mut Vec<Corner>,
    ) {
        if quota == 0 || corners.is_empty() {
            return;
        }
        let roots = ((size.0 + size.1 / 2) / size.1.max(1)).clamp(1, MAX_ROOTS);
        self.sort(corners, size, roots);
        self.split(roots, quota);
        for node in &self.nodes {
            let range = &self.keys[node.begin as usize..node.end as usize];
            let mut best = corners[range[0].1 as usize];
            for &(_, index) in &range[1..] {
                let corner = corners[index as usize];
                if corner.score > best.score {
                    best = corner;
                }
            }
            out.push(best);
        }
    }

    /// Sorts stably by key.
    fn sort(&mut self, corners: &[Corner], size: (usize, usize), roots: usize) {
        // Fine cells across and down in 1/65536 of a cell per pixel.
        let step_x = (((roots as u64) << (DEPTH + 16)) / size.0 as u64) as u32;
        let step_y = ((1_u64 << (DEPTH + 16)) / size.1 as u64) as u32;
        self.keys.clear();
        self.keys
            .extend(corners.iter().enumerate().map(|(index, corner)| {
                let x = ((u64::from(corner.x) * u64::from(step_x)) >> 16) as u32;
                let y = ((u64::from(corner.y) * u64::from(step_y)) >> 16) as u32;
                let root = x >> DEPTH;
                let mask = (1 << DEPTH) - 1;
                let key = (root << (2 * DEPTH)) | spaced(x & mask) | (spaced(y & mask) << 1);
                (key as u16, index as u32)
            }));
        self.scratch.clear();
        self.scratch.resize(self.keys.len(), (0, 0));
        for shift in [0, 8] {
            let mut starts = [0_u32; 257];
            for (key, _) in &self.keys {
                starts[usize::from(key >> shift & 255) + 1] += 1;
            }
            for i in 1..257 {
                starts[i] += starts[i - 1];
            }
            for &entry in &self.keys {
                let slot = &mut starts[usize::from(entry.0 >> shift & 255)];
                self.scratch[*slot as usize] = entry;
                *slot += 1;
            }
            std::mem::swap(&mut self.keys, &mut self.scratch);
        }
    }

    /// Splits breadth first until there are `quota` nodes; at the last depth, the fullest nodes first.
    fn split(&mut self, roots: usize, quota: usize) {
        self.nodes.clear();
        let mut begin = 0;
        for root in 0..roots as u32 {
            let end = self
                .keys
                .partition_point(|(key, _)| u32::from(*key) >> (2 * DEPTH) <= root);
            if end > begin {
                self.nodes.push(Node {
                    begin: begin as u32,
                    end: end as u32,
                });
            }
            begin = end;
        }
        for depth in 1..=DEPTH {
            if self.nodes.len() >= quota {
                return;
            }
            let shift = 2 * (DEPTH - depth);
            let splittable = self.nodes.iter().filter(|node| node.len() > 1).count();
            if splittable == 0 {
                return;
            }
            if self.nodes.len() + 3 * splittable > quota {
                // A total order: ranges of different nodes differ in `begin`.
                self.nodes
                    .sort_unstable_by_key(|node| (u32::MAX - node.len(), node.begin));
            }
            self.next.clear();
            for (done, node) in self.nodes.iter().enumerate() {
                let waiting = self.nodes.len() - done;
                if node.len() > 1 && self.next.len() + waiting < quota {
                    push_children(&self.keys, *node, shift, &mut self.next);
                } else {
                    self.next.push(*node);
                }
            }
            std::mem::swap(&mut self.nodes, &mut self.next);
        }
    }
}

/// Pushes the up to four parts of `node` that differ in the two bits above `shift`.
fn push_children(keys: &[(u16, u32)], node: Node, shift: u32, out: &mut Vec<Node>) {
    let mut begin = node.begin;
    let end = node.end as usize;
    while begin < node.end {
        let rest = &keys[begin as usize..end];
        let quadrant = rest[0].0 >> shift;
        let count = rest.partition_point(|(key, _)| key >> shift == quadrant) as u32;
        out.push(Node {
            begin,
            end: begin + count,
        });
        begin += count;
    }
}

/// The low eight bits of `value`, each followed by a zero bit.
fn spaced(value: u32) -> u32 {
    let value = (value | value << 4) & 0x0f0f;
    let value = (value | value << 2) & 0x3333;
    (value | value << 1) & 0x5555
}
