//! Distances of one volume at the voxels of another, and the mean of two.

use super::{Steps, for_each_between};
use crate::block::{Block, Blocks, FULL, Key, SIDE, VOXELS};
use crate::volume::Volume;
use crate::voxels::MOST_WEIGHT;
use stillpoint_geometry::Se3;

/// Voxels that lie this near to one of the other grid lie on it, in voxels: the others around it need not be known.
const SAME: f64 = 1e-6;
/// Voxels along a side of a block with the first ones of those behind.
const WIDE: usize = SIDE + 1;

/// A voxel as it was sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Voxel {
    distance: i16,
    weight: u16,
    colour: u32,
}

/// Seen through, and never near a surface.
const EMPTY: Voxel = Voxel {
    distance: FULL as i16,
    weight: 0,
    colour: 0,
};

/// A block and the first voxels of those behind it.
struct Window([Voxel; WIDE * WIDE * WIDE]);

/// A place between voxels of a window: the one before it along each axis, and the way to the next one.
struct Place {
    low: [usize; 3],
    part: [f64; 3],
}

/// Samples a volume at the voxels of one that holds nothing yet.
pub(super) fn resample(from: &Volume, to: &mut Volume, to_from: &Se3) {
    let there = Steps::new(from.voxel, to.voxel, to_from);
    let back = Steps::new(to.voxel, from.voxel, &to_from.inverse());
    let scale = from.truncation / to.truncation;
    let mut window = Window([Voxel::default(); WIDE * WIDE * WIDE]);
    for (key, _) in from.blocks.sorted() {
        let first = key.xyz().map(|k| f64::from(k) * SIDE as f64);
        let Some(reach) = there.reach(first) else {
            continue;
        };
        window.fill(&from.blocks, key);
        let blocks = reach.map(|at| at.map(|v| v.div_euclid(SIDE as i32)));
        for_each_between(blocks, |[x, y, z]| {
            let base = [x, y, z].map(|k| k * SIDE as i32);
            let mut number = to.blocks.find(Key::new(x, y, z));
            for_each_between(within(base, reach), |at| {
                let Some(place) = Place::of(back.at(at.map(f64::from)), key) else {
                    return;
                };
                let Some(voxel) = window.sample(&place, scale) else {
                    return;
                };
                let number =
                    *number.get_or_insert_with(|| to.blocks.find_or_make(Key::new(x, y, z)));
                let at: [usize; 3] = std::array::from_fn(|k| (at[k] - base[k]) as usize);
                set(to.blocks.get_mut(number), index(at), voxel);
            });
        });
    }
    give_back(&mut to.blocks);
}

/// The numbers of a block's voxels that are between others too.
fn within(base: [i32; 3], [least, most]: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
    let last = base.map(|v| v + SIDE as i32 - 1);
    [
        std::array::from_fn(|k| base[k].max(least[k])),
        std::array::from_fn(|k| last[k].min(most[k])),
    ]
}

/// What was made for free space alone is given back, as when frames are fused.
fn give_back(blocks: &mut Blocks) {
    for (_, number) in blocks.sorted() {
        if blocks.get(number).weight.iter().all(|w| *w == 0) {
            blocks.remove(number);
        }
    }
}

fn index([x, y, z]: [usize; 3]) -> usize {
    (z * SIDE + y) * SIDE + x
}

fn set(block: &mut Block, i: usize, voxel: Voxel) {
    block.distance[i] = voxel.distance;
    block.weight[i] = voxel.weight;
    block.colour[i] = voxel.colour;
}

fn get(block: &Block, i: usize) -> Voxel {
    Voxel {
        distance: block.distance[i],
        weight: block.weight[i],
        colour: block.colour[i],
    }
}

impl Place {
    /// Of a point, in voxels; none where it begins in another block.
    fn of(at: [f64; 3], key: Key) -> Option<Self> {
        let near = at.map(|v| v.round_ties_even());
        let at: [f64; 3] = std::array::from_fn(|k| {
            let same = (at[k] - near[k]).abs() < SAME;
            if same { near[k] } else { at[k] }
        });
        let low = at.map(f64::floor);
        let first = key.xyz().map(|k| f64::from(k) * SIDE as f64);
        let inside = (0..3).all(|k| low[k] >= first[k] && low[k] < first[k] + SIDE as f64);
        inside.then(|| Self {
            low: std::array::from_fn(|k| (low[k] - first[k]) as usize),
            part: std::array::from_fn(|k| at[k] - low[k]),
        })
    }

    /// The number of a corner in a window, and its share of the place.
    fn corner(&self, corner: usize) -> (usize, f64) {
        let step = |k: usize| corner >> k & 1;
        let share = |k: usize| {
            if step(k) == 1 {
                self.part[k]
            } else {
                1.0 - self.part[k]
            }
        };
        let [x, y, z] = std::array::from_fn(|k| self.low[k] + step(k));
        ((z * WIDE + y) * WIDE + x, share(0) * share(1) * share(2))
    }
}

impl Window {
    fn fill(&mut self, blocks: &Blocks, key: Key) {
        let around: [Option<&Block>; 8] = std::array::from_fn(|n| {
            let [x, y, z] = [n, n >> 1, n >> 2].map(|b| (b & 1) as i32);
            blocks.at(key.moved(x, y, z))
        });
        for (i, voxel) in self.0.iter_mut().enumerate() {
            let at = [i % WIDE, i / WIDE % WIDE, i / WIDE / WIDE];
            let [x, y, z] = at.map(|v| v / SIDE);
            let block = around[z << 2 | y << 1 | x];
            *voxel = block.map_or(Voxel::default(), |b| get(b, index(at.map(|v| v % SIDE))));
        }
    }

    /// What is known of a place, with distances in units of another truncation; nothing where one of the voxels that have a share of it was never near a
    /// surface, but for free space, which is that of the nearest one.
    fn sample(&self, place: &Place, scale: f64) -> Option<Voxel> {
        let corners: [(usize, f64); 8] = std::array::from_fn(|k| place.corner(k));
        let corners = corners.map(|(i, share)| (self.0[i], share));
        let shared = || corners.iter().filter(|c| c.1 > 0.0);
        if shared().any(|c| c.0.weight == 0) {
            // Of equals the last one.
            let nearest = corners.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            return nearest.map(|c| c.0).filter(|v| *v == EMPTY);
        }
        let mean = |value: &dyn Fn(&Voxel) -> f64| shared().map(|(v, s)| value(v) * s).sum::<f64>();
        let distance = mean(&|v| f64::from(v.distance));
        let full = f64::from(FULL);
        // What is free in all of them is free at any truncation.
        let free = shared().all(|c| c.0.distance == EMPTY.distance);
        let scaled = if free { full } else { distance * scale };
        if scaled > full {
            return Some(EMPTY);
        }
        let inside = distance < 0.0;
        let alike = shared().filter(|c| (c.0.distance < 0) == inside);
        let seen = alike.map(|c| c.0.colour >> 24).min().unwrap_or(0);
        (scaled >= -full).then(|| Voxel {
            distance: scaled.round_ties_even() as i16,
            weight: mean(&|v| f64::from(v.weight)).round_ties_even().max(1.0) as u16,
            colour: mixed(shared().map(|(v, share)| (v.colour, *share))) | seen << 24,
        })
    }
}

/// The mean of the colours that are some, red, green and blue.
fn mixed(colours: impl Iterator<Item = (u32, f64)>) -> u32 {
    let (mut sum, mut all) = ([0.0; 3], 0.0);
    for (colour, share) in colours.filter(|c| c.0 & 0xff_ffff != 0) {
        for (k, s) in sum.iter_mut().enumerate() {
            *s += share * f64::from(colour >> (8 * k) & 255);
        }
        all += share;
    }
    if all == 0.0 {
        return 0;
    }
    let channel = |k: usize| ((sum[k] / all).round_ties_even() as u32) << (8 * k);
    channel(0) | channel(1) | channel(2)
}

/// Averages a volume with another one of the same voxels, by weights.
pub(super) fn average(to: &mut Volume, other: &Volume) {
    for (key, number) in other.blocks.sorted() {
        let from = other.blocks.get(number);
        let number = to.blocks.find_or_make(key);
        let block = to.blocks.get_mut(number);
        for i in 0..VOXELS {
            let voxel = joined(get(block, i), get(from, i));
            set(block, i, voxel);
        }
    }
}

/// What two maps know of a voxel. Free space of one takes no surface from the other: who knows which of them is the newer one.
fn joined(a: Voxel, b: Voxel) -> Voxel {
    if b.weight == 0 {
        return if a == Voxel::default() { b } else { a };
    }
    if a.weight == 0 {
        return b;
    }
    let weights = [a, b].map(|v| f64::from(v.weight));
    let total = weights[0] + weights[1];
    let sum = f64::from(a.distance) * weights[0] + f64::from(b.distance) * weights[1];
    let seen = (a.colour >> 24) + (b.colour >> 24);
    let colours = [(a.colour, weights[0]), (b.colour, weights[1])];
    Voxel {
        distance: (sum / total).round_ties_even() as i16,
        weight: total.min(f64::from(MOST_WEIGHT)) as u16,
        colour: mixed(colours.into_iter()) | seen.min(255) << 24,
    }
}
