//! Assignment of detections to tracks.

use super::expected::Expected;
use super::kind::may_be_one;
use super::measurement::Measurement;
use super::occlusion::{Occlusion, Shown};
use super::track::Track;
use super::view::View;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_geometry::assign;
use stillpoint_imaging::CoarseDepth;

/// Integer units per unit of benefit: sums of integers below 2^53 are exact, so ties stay ties. Chosen: a millionth
/// tells no two detections apart.
const UNITS: f64 = 1e6;
/// Maximum tracks or detections of a group for optimal assignment, a number. Longer chains of overlapping objects are
/// meaningless boxes, e.g. of a detector with a wrong threshold; there the assignment is greedy. Chosen: the work grows
/// with the cube, a quarter of a million here.
const LARGEST_GROUP: usize = 64;

/// For each track the index of its detection and the measurement: the assignment of maximum total benefit (Kuhn 1955,
/// Munkres 1957) among the pairs that pass the gates. Surfaces of objects in front are removed from a box.
pub(super) fn associate(
    tracks: &[Track],
    view: &View,
    depth: &CoarseDepth,
    measurements: &[Measurement],
    share: f64,
) -> Vec<Option<(usize, Measurement)>> {
    if tracks.is_empty() || measurements.is_empty() {
        return vec![None; tracks.len()];
    }
    let expected: Vec<Expected> = tracks.iter().map(|t| t.expected(view)).collect();
    let occlusion = Occlusion::new(tracks, &expected);
    let around: Vec<Shown> = measurements
        .iter()
        .map(|m| occlusion.around(m, depth))
        .collect();
    let own = |i: usize, j: usize| around[j].seen_of(&tracks[i], &expected[i], &measurements[j]);
    let mut pairs = Vec::new();
    for (i, track) in tracks.iter().enumerate() {
        for (j, m) in measurements.iter().enumerate() {
            // Cheap test first: most pairs have different classes or positions.
            if !may_be_one(m.detection.class, track.class) || expected[i].is_far_from(m, share) {
                continue;
            }
            if let Some(fit) = track.fit(view, &expected[i], &own(i, j), share) {
                let doubt = around[j].doubt(&tracks[i], &expected[i]);
                // Any match is better than none.
                let benefit = ((1.0 + fit.benefit - doubt) * UNITS).max(1.0) as i64;
                pairs.push(Pair {
                    track: i,
                    detection: j,
                    benefit,
                });
            }
        }
    }
    let assigned = assign_by_group(&pairs, tracks.len(), measurements.len());
    let found = assigned.iter().enumerate();
    let measured = |i: usize, j: usize| {
        let mut m = own(i, j);
        m.middle = Shown::middle(&tracks[i], &expected[i], &m, depth, view);
        m
    };
    found.map(|(i, j)| j.map(|j| (j, measured(i, j)))).collect()
}

/// A track and a detection that may show the same object.
struct Pair {
    track: usize,
    detection: usize,
    benefit: i64,
}

/// Index of the detection of each track. Tracks and detections are independent unless connected by a chain of pairs, so
/// each group is solved separately: the effort grows with the cube of the largest group only.
fn assign_by_group(pairs: &[Pair], tracks: usize, detections: usize) -> Vec<Option<usize>> {
    let groups = groups(pairs, tracks, detections);
    let mut members: BTreeMap<usize, Group<'_>> = BTreeMap::new();
    for pair in pairs {
        let group = members.entry(groups[pair.track]).or_default();
        group.tracks.insert(pair.track);
        group.detections.insert(pair.detection);
        group.pairs.push(pair);
    }
    let mut assigned = vec![None; tracks];
    for group in members.values() {
        group.assign(&mut assigned);
    }
    assigned
}

#[derive(Default)]
struct Group<'a> {
    tracks: BTreeSet<usize>,
    detections: BTreeSet<usize>,
    pairs: Vec<&'a Pair>,
}

impl Group<'_> {
    fn assign(&self, assigned: &mut [Option<usize>]) {
        if self.tracks.len().max(self.detections.len()) > LARGEST_GROUP {
            return self.assign_best_first(assigned);
        }
        let place = |set: &BTreeSet<usize>| -> BTreeMap<usize, usize> {
            set.iter().enumerate().map(|(n, i)| (*i, n)).collect()
        };
        let (rows, columns) = (place(&self.tracks), place(&self.detections));
        let mut weights = none_at_all(rows.len(), columns.len());
        for pair in &self.pairs {
            weights[rows[&pair.track]][columns[&pair.detection]] = pair.benefit as f64;
        }
        let detections: Vec<usize> = self.detections.iter().copied().collect();
        for (track, column) in self.tracks.iter().zip(assign(&weights)) {
            assigned[*track] = column.and_then(|j| detections.get(j)).copied();
        }
    }
}

impl Group<'_> {
    fn assign_best_first(&self, assigned: &mut [Option<usize>]) {
        let mut order = self.pairs.clone();
        order.sort_by_key(|p| (Reverse(p.benefit), p.track, p.detection));
        let mut taken = BTreeSet::new();
        for pair in order {
            if assigned[pair.track].is_none() && taken.insert(pair.detection) {
                assigned[pair.track] = Some(pair.detection);
            }
        }
    }
}

/// Benefits without any pair. After the detections, each track has a column of its own for "no detection".
fn none_at_all(tracks: usize, detections: usize) -> Vec<Vec<f64>> {
    let mut weights = vec![vec![f64::NEG_INFINITY; detections + tracks]; tracks];
    for (i, row) in weights.iter_mut().enumerate() {
        row[detections + i] = 0.0;
    }
    weights
}

/// The group of each track: the smallest index of its members.
fn groups(pairs: &[Pair], tracks: usize, detections: usize) -> Vec<usize> {
    fn root(of: &mut [usize], mut i: usize) -> usize {
        while of[i] != i {
            of[i] = of[of[i]];
            i = of[i];
        }
        i
    }
    let mut of: Vec<usize> = (0..tracks + detections).collect();
    for pair in pairs {
        let (a, b) = (
            root(&mut of, pair.track),
            root(&mut of, tracks + pair.detection),
        );
        of[a.max(b)] = a.min(b);
    }
    (0..tracks).map(|i| root(&mut of, i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Solving by group gives the same sum as solving all at once.
        #[test]
        fn assignment_by_groups_is_optimal(numbers in prop::collection::vec((0..7_usize, 0..8_usize, 1..50_i64), 0..20)) {
            let mut of = BTreeMap::new();
            for (track, detection, benefit) in numbers {
                of.insert((track, detection), benefit);
            }
            let pair = |(&(track, detection), &benefit): (&(usize, usize), &i64)| Pair { track, detection, benefit };
            let pairs: Vec<Pair> = of.iter().map(pair).collect();
            let mut weights = none_at_all(7, 8);
            for p in &pairs {
                weights[p.track][p.detection] = p.benefit as f64;
            }
            let at_once = assign(&weights);
            let best: f64 = at_once.iter().enumerate().filter_map(|(i, j)| Some(weights[i][(*j)?])).sum();
            let found = assign_by_group(&pairs, 7, 8);
            let matched: Vec<(usize, usize)> = found.iter().enumerate().filter_map(|(i, j)| Some((i, (*j)?))).collect();
            prop_assert_eq!(matched.iter().map(|m| of[m]).sum::<i64>() as f64, best);
            let taken: BTreeSet<usize> = matched.iter().map(|m| m.1).collect();
            prop_assert_eq!(taken.len(), matched.len());
        }
    }
}
