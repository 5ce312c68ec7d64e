//! Descriptor matching: best candidates in a search window, mutual best matches of two sets, and consistency of
//! rotations.

#[cfg(target_arch = "x86_64")]
use stillpoint_imaging::Simd;

use crate::{Descriptor, FeatureGrid};

/// A search window: a disc in the image and the accepted pyramid levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Column of the centre, px, in the coordinates of the grid.
    pub x: f32,
    /// Row of the centre, px.
    pub y: f32,
    /// Radius, px.
    pub radius: f32,
    /// Finest accepted level.
    pub min_level: u8,
    /// Coarsest accepted level.
    pub max_level: u8,
}

/// The best candidate, and the distance of the second best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BestTwo {
    /// Index of the best.
    pub index: u32,
    /// Its distance, bits.
    pub distance: u32,
    /// Distance of the second best, bits; `u32::MAX` if there is none.
    pub second_distance: u32,
    /// Level of the second best; 0 if there is none. A ratio test is meaningful only between candidates of one level.
    pub second_level: u8,
}

/// Keypoints to be searched.
#[derive(Clone, Copy, Debug)]
pub struct Searched<'a> {
    /// Grid of the positions.
    pub grid: &'a FeatureGrid,
    /// The positions from which `grid` was built.
    pub positions: &'a [[f32; 2]],
    /// Their descriptors.
    pub descriptors: &'a [Descriptor],
}

/// The best two of the accepted keypoints in `window`; ties go to the first visited. `None` if there is no candidate.
pub fn best_two(
    searched: &Searched<'_>,
    window: &Window,
    descriptor: &Descriptor,
    accept: impl FnMut(u32) -> bool,
) -> Option<BestTwo> {
    #[cfg(target_arch = "x86_64")]
    if Simd::Avx2.has_avx2() {
        return crate::avx2::best_two(searched, window, descriptor, accept);
    }
    best_two_portable(searched, window, descriptor, accept)
}

/// [`best_two`] for the instruction set of its caller, into which it is inlined.
#[inline(always)]
pub(crate) fn best_two_portable(
    searched: &Searched<'_>,
    window: &Window,
    descriptor: &Descriptor,
    mut accept: impl FnMut(u32) -> bool,
) -> Option<BestTwo> {
    let mut best: Option<(BestTwo, u8)> = None;
    let (positions, descriptors) = (searched.positions, searched.descriptors);
    searched
        .grid
        .for_each_with_level(positions, window, |index, level| {
            let Some(candidate) = descriptors.get(index as usize) else {
                return;
            };
            if !accept(index) {
                return;
            }
            let distance = descriptor.distance(candidate);
            match &mut best {
                Some((found, best_level)) if distance < found.distance => {
                    let second = (found.distance, *best_level);
                    *found = BestTwo {
                        index,
                        distance,
                        second_distance: second.0,
                        second_level: second.1,
                    };
                    *best_level = level;
                }
                Some((found, _)) if distance < found.second_distance => {
                    found.second_distance = distance;
                    found.second_level = level;
                }
                Some(_) => {}
                None => {
                    let found = BestTwo {
                        index,
                        distance,
                        second_distance: u32::MAX,
                        second_level: 0,
                    };
                    best = Some((found, level));
                }
            }
        });
    best.map(|(found, _)| found)
}

/// For each query the index of its match in `train`: mutually nearest (ties go to the lowest index), at most
/// `max_distance` bits apart, and nearer than `ratio` times the distance of the second nearest (1 or more disables this
/// test).
#[must_use]
pub fn match_brute_force(
    query: &[Descriptor],
    train: &[Descriptor],
    max_distance: u32,
    ratio: f32,
) -> Vec<Option<u32>> {
    #[cfg(target_arch = "x86_64")]
    if Simd::Avx2.has_avx2() {
        return crate::avx2::match_brute_force(query, train, max_distance, ratio);
    }
    match_brute_force_portable(query, train, max_distance, ratio)
}

/// [`match_brute_force`] for the instruction set of its caller, into which it is inlined.
#[inline(always)]
pub(crate) fn match_brute_force_portable(
    query: &[Descriptor],
    train: &[Descriptor],
    max_distance: u32,
    ratio: f32,
) -> Vec<Option<u32>> {
    // Nearest query of each train descriptor, as (distance, query).
    let mut back = vec![(u32::MAX, 0); train.len()];
    let mut forward = Vec::with_capacity(query.len());
    for (q, descriptor) in query.iter().enumerate() {
        let (mut best, mut second) = ((u32::MAX, 0), u32::MAX);
        for (t, candidate) in train.iter().enumerate() {
            let distance = descriptor.distance(candidate);
            if distance < best.0 {
                second = best.0;
                best = (distance, t as u32);
            } else if distance < second {
                second = distance;
            }
            if distance < back[t].0 {
                back[t] = (distance, q);
            }
        }
        forward.push((best, second));
    }
    let unique = |distance: u32, second: u32| {
        ratio >= 1.0 || second == u32::MAX || (distance as f32) < ratio * second as f32
    };
    forward
        .iter()
        .enumerate()
        .map(|(q, &((distance, t), second))| {
            let found = distance <= max_distance && distance != u32::MAX;
            (found && back[t as usize].1 == q && unique(distance, second)).then_some(t)
        })
        .collect()
}

/// Number of bins of a [`RotationHistogram`], of 12 degrees each, as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
const BINS: usize = 30;

/// Keeps the matches with consistent rotation: those in the three fullest of 30 bins of 12 degrees. The second and
/// third bin count only if they have at least a tenth of the first.
#[derive(Clone, Debug, Default)]
pub struct RotationHistogram<T> {
    items: Vec<(u8, T)>,
    counts: [u32; BINS],
}

impl<T: Copy> RotationHistogram<T> {
    /// An empty histogram.
    #[must_use]
    pub fn new() -> Self {
        Self {
            items: Vec::new(),
            counts: [0; BINS],
        }
    }

    /// Removes all items, keeping the memory.
    pub fn clear(&mut self) {
        self.items.clear();
        self.counts = [0; BINS];
    }

    /// Adds an item whose keypoints differ by this angle, rad, modulo a full turn. An angle that is not finite counts
    /// as 0.
    pub fn push(&mut self, angle_difference: f32, item: T) {
        let turns = angle_difference / std::f32::consts::TAU;
        let fraction = turns - turns.floor();
        // Bins are centred on multiples of 12 degrees, so that noise around 0 falls into one. The cast maps NaN to 0.
        let bin = (fraction * BINS as f32 + 0.5) as usize % BINS;
        self.items.push((bin as u8, item));
        self.counts[bin] += 1;
    }

    /// The items of the strongest bins, in order of insertion.
    pub fn kept(&self) -> impl Iterator<Item = T> + '_ {
        let strong = self.strongest();
        self.items
            .iter()
            .filter(move |(bin, _)| strong[usize::from(*bin)])
            .map(|(_, item)| *item)
    }

    /// The items of all other bins, in order of insertion.
    pub fn dropped(&self) -> impl Iterator<Item = T> + '_ {
        let strong = self.strongest();
        self.items
            .iter()
            .filter(move |(bin, _)| !strong[usize::from(*bin)])
            .map(|(_, item)| *item)
    }

    fn strongest(&self) -> [bool; BINS] {
        let mut order: [usize; BINS] = std::array::from_fn(|bin| bin);
        // Stable: of equally full bins the first ones win.
        order.sort_by_key(|&bin| u32::MAX - self.counts[bin]);
        let mut strong = [false; BINS];
        strong[order[0]] = true;
        for &bin in &order[1..3] {
            strong[bin] = 10 * self.counts[bin] >= self.counts[order[0]];
        }
        strong
    }
}
