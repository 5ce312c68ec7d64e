//! Depth-connected regions, over which evidence is spread.

use super::cells::Cells;
use super::diagonals::{Diagonals, Weights};

/// Bound of a cell's log odds, so that years of evidence can be overturned in a few frames. Chosen: two observations
/// through a place (`SEEN_THROUGH`).
pub(super) const LIMIT: f32 = 8.0;
/// Share of its neighbours' mean that a cell takes over. Chosen below 1, with which the sweeps converge.
const COUPLING: f32 = 0.9;
/// Number of forward and backward sweeps, chosen: enough to cross a person.
const SWEEPS: usize = 3;

/// Share of the neighbours' sum that is taken over by a cell with these joined neighbours.
fn share(bits: u8) -> f32 {
    match bits.count_ones() {
        0 => 0.0,
        n => COUPLING / n as f32,
    }
}

/// Whether the depths of two neighbouring cells, m, belong to one surface.
pub(super) fn joined(a: f32, b: f32) -> bool {
    a > 0.0 && b > 0.0 && (a - b).abs() < 0.02 + 0.025 * a.min(b)
}

/// Connections between neighbouring cells.
#[derive(Default)]
pub(super) struct Links {
    /// By cell: bit 0 right, 1 below, 2 left, 3 above.
    bits: Vec<u8>,
    layout: Diagonals,
    weights: Weights,
}

/// Buffers for spreading, by slots: the cells' own values and the spread ones.
#[derive(Default)]
pub(super) struct Slots {
    own: Vec<f32>,
    values: Vec<f32>,
}

impl Links {
    /// Joins neighbours without a depth step.
    #[cfg(test)]
    pub(super) fn new(cells: &Cells, depth: &[f32]) -> Self {
        let mut links = Self::default();
        links.rebuild(cells, depth);
        links
    }

    pub(super) fn rebuild(&mut self, cells: &Cells, depth: &[f32]) {
        let (w, h) = (cells.width, cells.height);
        let bits = &mut self.bits;
        bits.clear();
        bits.resize(w * h, 0);
        for y in 0..h {
            for x in 0..w {
                let i = y * w + x;
                if x + 1 < w && joined(depth[i], depth[i + 1]) {
                    bits[i] |= 1;
                    bits[i + 1] |= 4;
                }
                if y + 1 < h && joined(depth[i], depth[i + w]) {
                    bits[i] |= 2;
                    bits[i + w] |= 8;
                }
            }
        }
        let layout = Diagonals::new(w, h);
        let weights = &mut self.weights;
        weights.reset(&layout);
        let weight = |bits: u8, bit: u8| f32::from(bits >> bit & 1);
        for (&bits, slot) in self.bits.iter().zip(layout.of_rows()) {
            weights.right[slot] = weight(bits, 0);
            weights.below[slot] = weight(bits, 1);
            weights.left[slot] = weight(bits, 2);
            weights.above[slot] = weight(bits, 3);
            weights.share[slot] = share(bits);
        }
        self.layout = layout;
    }

    /// Spreads each cell's value over its region: solves `x_i = clamp(own_i + COUPLING * mean of joined neighbours
    /// x_j)` by symmetric Gauss-Seidel sweeps.
    pub(super) fn spread(&self, own: &[f32], slots: &mut Slots, out: &mut Vec<f32>) {
        for slots in [&mut slots.own, &mut slots.values] {
            slots.clear();
            slots.resize(self.layout.slots(), 0.0);
        }
        for (own, slot) in own.iter().zip(self.layout.of_rows()) {
            slots.own[slot] = *own;
            slots.values[slot] = own.clamp(-LIMIT, LIMIT);
        }
        for _ in 0..SWEEPS {
            self.layout
                .sweep(&self.weights, &slots.own, &mut slots.values, LIMIT);
        }
        out.clear();
        out.reserve(own.len());
        out.extend(self.layout.of_rows().map(|slot| slots.values[slot]));
    }

    /// Labels the connected regions of chosen cells from 1, in the order of their first cells; 0 for all others.
    pub(super) fn regions(
        &self,
        cells: &Cells,
        chosen: impl Fn(usize) -> bool,
        open: &mut Vec<usize>,
        labels: &mut Vec<u16>,
    ) {
        let w = cells.width;
        labels.clear();
        labels.resize(self.bits.len(), 0);
        open.clear();
        let mut next = 0_u16;
        for start in 0..labels.len() {
            if labels[start] != 0 || !chosen(start) {
                continue;
            }
            next = next.saturating_add(1);
            labels[start] = next;
            open.push(start);
            while let Some(i) = open.pop() {
                let joined = |bit: u8| self.bits[i] & bit != 0;
                let neighbours = [
                    joined(1).then_some(i + 1),
                    joined(2).then_some(i + w),
                    joined(4).then(|| i - 1),
                    joined(8).then(|| i - w),
                ];
                for j in neighbours.into_iter().flatten() {
                    if labels[j] == 0 && chosen(j) {
                        labels[j] = next;
                        open.push(j);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::DepthNoise;
    use stillpoint_geometry::Camera;

    const W: usize = 24;
    const H: usize = 18;

    fn cells() -> Cells {
        let (w, h) = (8 * W as u32, 8 * H as u32);
        Cells::new(
            &Camera::pinhole(w, h, [160.0, 160.0, 95.5, 71.5]),
            DepthNoise::default(),
        )
    }

    fn image(depth: impl Fn(usize, usize) -> f32) -> Vec<f32> {
        (0..W * H).map(|i| depth(i % W, i / W)).collect()
    }

    fn spread(depth: &[f32], own: &[f32]) -> Vec<f32> {
        spread_by(&Links::new(&cells(), depth), own)
    }

    fn spread_by(links: &Links, own: &[f32]) -> Vec<f32> {
        let mut values = Vec::new();
        links.spread(own, &mut Slots::default(), &mut values);
        values
    }

    fn regions(links: &Links, chosen: impl Fn(usize) -> bool) -> Vec<u16> {
        let mut labels = Vec::new();
        links.regions(&cells(), chosen, &mut Vec::new(), &mut labels);
        labels
    }

    /// Deterministic numbers from -1 to 1.
    fn noise(seed: u64) -> impl Fn(usize) -> f32 {
        move |i| {
            let mut x = (i as u64 + 1 + 1000 * seed).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            x = (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            (x >> 40) as f32 / (1 << 23) as f32 - 1.0
        }
    }

    /// A person of 6 x 12 cells at 1.5 m in front of a wall at 3 m.
    fn person(x: usize, y: usize) -> bool {
        (8..14).contains(&x) && (4..16).contains(&y)
    }

    fn room() -> Vec<f32> {
        image(|x, y| if person(x, y) { 1.5 } else { 3.0 })
    }

    #[test]
    fn regions_are_connected_selected_cells() {
        let (cells, depth) = (cells(), room());
        let links = Links::new(&cells, &depth);
        let near = depth.iter().copied().fold(f32::INFINITY, f32::min);
        let of_person = |i: usize| depth[i] < near + 0.1;
        let labels = regions(&links, of_person);
        for (i, label) in labels.iter().enumerate() {
            assert_eq!(*label != 0, of_person(i));
        }
        assert!(regions(&links, |_| false).iter().all(|l| *l == 0));
        // With all cells chosen, depth steps still separate regions.
        let all = regions(&links, |_| true);
        let first = (0..all.len()).find(|i| of_person(*i)).unwrap();
        let wall = (0..all.len()).find(|i| !of_person(*i)).unwrap();
        assert_ne!(all[first], all[wall]);
    }

    /// Diagonal sweeps equal row-by-row sweeps bit for bit.
    #[test]
    fn diagonal_sweeps_equal_row_by_row_sweeps() {
        let cells = cells();
        for seed in 0..4 {
            let (d, e) = (noise(seed), noise(seed + 50));
            let depth = image(|x, y| match d(y * W + x) {
                hole if hole > 0.9 => 0.0,
                noise => 2.0 + 0.5 * d(y / 5 * W + x / 4) + 0.04 * noise,
            });
            let own = image(|x, y| 9.0 * e(y * W + x));
            let links = Links::new(&cells, &depth);
            let mut expected: Vec<f32> = own.iter().map(|v| v.clamp(-LIMIT, LIMIT)).collect();
            for i in (0..2 * SWEEPS).flat_map(|s| (0..W * H).map(move |i| (s % 2, i))) {
                let i = if i.0 == 0 { i.1 } else { W * H - 1 - i.1 };
                let joined = |bit: u8, to: usize| {
                    let is = links.bits[i] & bit != 0;
                    if is { expected[to] } else { 0.0 }
                };
                let sum = joined(1, i + 1) + joined(2, i + W);
                let sum = sum + joined(4, i.wrapping_sub(1)) + joined(8, i.wrapping_sub(W));
                let share = share(links.bits[i]);
                expected[i] = (own[i] + share * sum).clamp(-LIMIT, LIMIT);
            }
            let found = spread_by(&links, &own);
            assert!(
                found
                    .iter()
                    .zip(&expected)
                    .all(|(f, e)| f.to_bits() == e.to_bits())
            );
            // Ensures that values did spread.
            assert!(found.iter().zip(&own).filter(|(f, o)| f != o).count() > W * H / 2);
        }
    }

    #[test]
    fn evidence_does_not_cross_depth_steps() {
        let values = spread(&room(), &image(|x, y| f32::from(u8::from(person(x, y)))));
        for (i, v) in values.iter().enumerate() {
            if person(i % W, i / W) {
                assert!(*v > 1.0, "cell {i}: {v}");
            } else {
                assert!(v.abs() < f32::EPSILON, "cell {i}: {v}");
            }
        }
        // On a single wall the same values do spread.
        let flat = spread(
            &image(|_, _| 1.5),
            &image(|x, y| f32::from(u8::from(person(x, y)))),
        );
        assert!(flat.iter().all(|v| *v > 0.0));
    }

    #[test]
    fn slopes_are_connected_and_holes_are_not() {
        // A table that recedes 2 % per cell stays connected.
        let table = image(|_, y| 1.0 + 0.02 * y as f32);
        let own = image(|x, y| f32::from(u8::from(x == 0 && y == 0)) * 8.0);
        assert!(spread(&table, &own)[(H - 1) * W] > 0.0);
        let holes = image(|x, _| if x == 3 { 0.0 } else { 2.0 });
        let values = spread(&holes, &image(|x, _| if x <= 3 { 1.0 } else { 0.0 }));
        for (i, v) in values.iter().enumerate() {
            match i % W {
                0..3 => assert!(*v > 1.0),
                3 => assert!((v - 1.0).abs() < f32::EPSILON),
                _ => assert!(v.abs() < f32::EPSILON),
            }
        }
    }

    #[test]
    fn row_end_is_not_linked_to_the_next_row() {
        let depth = image(|x, y| match (x, y) {
            (x, 0) if x == W - 1 => 1.0,
            (0, 1) => 1.0,
            _ => 0.0,
        });
        let values = spread(&depth, &image(|_, y| if y == 0 { 2.0 } else { 0.0 }));
        assert!((values[W - 1] - 2.0).abs() < f32::EPSILON);
        assert!(values[W].abs() < f32::EPSILON);
    }

    #[test]
    fn region_takes_the_sign_of_its_evidence() {
        // One cell in five has evidence, some of it slightly wrong.
        let own = image(
            |x, y| match (person(x, y), (y * W + x) % 5, (y * W + x) % 45) {
                (true, _, 20) => -0.5,
                (true, 0, _) => 2.0,
                _ => 0.0,
            },
        );
        assert!(own.iter().any(|v| *v < 0.0));
        let moving = spread(&room(), &own);
        let still: Vec<f32> = own.iter().map(|v| -v).collect();
        let still = spread(&room(), &still);
        for i in 0..W * H {
            if person(i % W, i / W) {
                assert!(moving[i] > 0.0 && still[i] < 0.0, "cell {i}: {}", moving[i]);
            }
            assert!((moving[i] + still[i]).abs() < f32::EPSILON);
        }
    }

    #[test]
    fn spread_values_are_bounded_and_monotone() {
        for seed in 0..20 {
            let (d, e, f) = (noise(seed), noise(seed + 100), noise(seed + 200));
            let depth = image(|x, y| {
                // Patches of several cells, with holes.
                let step = d((y / 4) * W + x / 5);
                if d(y * W + x) > 0.9 { 0.0 } else { 2.0 + step }
            });
            let own = image(|x, y| 30.0 * e(y * W + x));
            let more = image(|x, y| own[y * W + x] + 5.0 * f(y * W + x).max(0.0));
            let (low, high) = (spread(&depth, &own), spread(&depth, &more));
            for (low, high) in low.iter().zip(&high) {
                assert!(low.abs() <= LIMIT && high.abs() <= LIMIT);
                assert!(low <= high);
            }
        }
    }
}
