//! Resamples the distances of a volume, and averages two volumes.

use super::{Steps, for_each_between};
use crate::block::{Block, Blocks, FULL, Key, SIDE, VOXELS};
use crate::volume::Volume;
use crate::voxels::MOST_WEIGHT;
use crate::window::{MARGIN, WIDE, Window, wide};
use stillpoint_geometry::Se3;

/// Distance below which voxels of both grids coincide, in voxels: the other neighbours need not be known then.
const SAME: f64 = 1e-6;

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

/// A point between voxels: the lower voxel index along each axis, and the fraction to the next.
struct Place {
    low: [usize; 3],
    part: [f64; 3],
}

/// Resamples a volume at the voxels of an empty one.
pub(super) fn resample(from: &Volume, to: &mut Volume, to_from: &Se3) {
    let there = Steps::new(from.voxel, to.voxel, to_from);
    let back = Steps::new(to.voxel, from.voxel, &to_from.inverse());
    let scale = from.truncation / to.truncation;
    let mut window = Window::new();
    for (key, _) in from.blocks.sorted() {
        let first = key.xyz().map(|k| f64::from(k) * SIDE as f64);
        let Some(reach) = there.reach(first) else {
            continue;
        };
        window.fill(from, key, 0);
        let blocks = reach.map(|at| at.map(|v| v.div_euclid(SIDE as i32)));
        for_each_between(blocks, |[x, y, z]| {
            let base = [x, y, z].map(|k| k * SIDE as i32);
            let mut number = to.blocks.find(Key::new(x, y, z));
            for_each_between(within(base, reach), |at| {
                let Some(place) = Place::of(back.at(at.map(f64::from)), key) else {
                    return;
                };
                let Some(voxel) = sample(&window, &place, scale) else {
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

/// The indices of a block's voxels that lie within a box.
fn within(base: [i32; 3], [least, most]: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
    let last = base.map(|v| v + SIDE as i32 - 1);
    [
        std::array::from_fn(|k| base[k].max(least[k])),
        std::array::from_fn(|k| last[k].min(most[k])),
    ]
}

/// Removes blocks that hold only free space, as in fusion.
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
    /// From a point in voxels; `None` if its lower voxel is in another block.
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

    /// The index of a corner in a window, and its interpolation weight.
    fn corner(&self, corner: usize) -> (usize, f64) {
        let step = |k: usize| corner >> k & 1;
        let share = |k: usize| {
            if step(k) == 1 {
                self.part[k]
            } else {
                1.0 - self.part[k]
            }
        };
        let at = std::array::from_fn(|k| MARGIN + self.low[k] + step(k));
        (wide(at), share(0) * share(1) * share(2))
    }
}

/// Samples a window at a point, with distances rescaled to another truncation. The nearest voxel decides between surface, free space and
/// unknown.
fn sample(window: &Window, place: &Place, scale: f64) -> Option<Voxel> {
    let corners: [(usize, f64); 8] = std::array::from_fn(|k| place.corner(k));
    // Ties take the last one.
    let nearest = corners.iter().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
    if !window.measured[nearest] {
        return window.empty[nearest].then_some(EMPTY);
    }
    let shared = || corners.iter().copied().filter(|c| c.1 > 0.0);
    let value = |i: usize| f64::from(window.distance[i]);
    let full = f64::from(FULL);
    let whole = shared().all(|(i, _)| window.measured[i]);
    let distance = if whole {
        shared().map(|(i, share)| value(i) * share).sum::<f64>()
    } else {
        along_axes(window, place)?.clamp(-full, full)
    };
    let measured = || shared().filter(|(i, _)| window.measured[*i]);
    // Free in all of them means free at any truncation.
    let free = measured().all(|(i, _)| window.distance[i] == EMPTY.distance);
    let scaled = if free { full } else { distance * scale };
    if scaled > full {
        return Some(EMPTY);
    }
    let all = measured().map(|c| c.1).sum::<f64>();
    let weight = measured().map(|(i, share)| f64::from(window.weight[i]) * share);
    let alike = measured().filter(|(i, _)| (value(*i) < 0.0) == (distance < 0.0));
    let seen = alike.max_by(|a, b| a.1.total_cmp(&b.1));
    let seen = seen.map_or(0, |(i, _)| window.colour[i] >> 24);
    let colours = measured().map(|(i, share)| (window.colour[i], share));
    (scaled >= -full).then(|| Voxel {
        distance: scaled.round_ties_even() as i16,
        weight: (weight.sum::<f64>() / all).round_ties_even().max(1.0) as u16,
        colour: mixed(colours) | seen << 24,
    })
}

/// Extrapolates the distance at a point where some surrounding voxels are unmeasured: from the nearest voxel along each axis, with the
/// slope to the next or from the previous voxel.
fn along_axes(window: &Window, place: &Place) -> Option<f64> {
    let near = place.part.map(|part| usize::from(part >= 0.5));
    let at = wide(std::array::from_fn(|k| MARGIN + place.low[k] + near[k]));
    let value = |i: usize| f64::from(window.distance[i]);
    let mut sum = value(at);
    for (k, step) in [1, WIDE, WIDE * WIDE].into_iter().enumerate() {
        let way = place.part[k] - near[k] as f64;
        if way == 0.0 {
            continue;
        }
        let (up, down) = (at + step, at - step);
        let (ahead, behind) = if way > 0.0 { (up, down) } else { (down, up) };
        sum += way.abs()
            * match (window.measured[ahead], window.measured[behind]) {
                (true, _) => value(ahead) - value(at),
                (_, true) => value(at) - value(behind),
                _ => return None,
            };
    }
    Some(sum)
}

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

/// Combines a voxel of two maps. Free space of one does not remove a surface of the other, as it is unknown which map is newer.
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
