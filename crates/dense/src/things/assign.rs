//! Assigns detections to objects by their visible surfaces.
//!
//! Trackers confuse similar objects, such as books. So tracks are only the initial groups: each is carved into a surface, every detection
//! goes to the surface of its class that explains its box best, and the rest is carved again.

use super::carve::{Carved, Task, around, carve, evenly, overlap};
use super::claims::{Claimant, Claims};
use super::look::Placed;
use super::own::Seen;
use super::part::{World, stands};
use crate::floor::Floor;
use std::collections::BTreeMap;
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;
use stillpoint_map::SubmapId;

#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) submap: SubmapId,
    pub(crate) class: ClassId,
    pub(crate) seen: Vec<Seen>,
    pub(crate) carved: Carved,
}

/// Number of reassignments: the second one corrects errors of the first.
const ROUNDS: usize = 2;
/// Number of surface points that are compared with boxes.
const POINTS: usize = 160;
/// Minimum fit of a surface to its own boxes for it to explain others.
const LEAST_FIT: f64 = 0.4;
/// Minimum overlap of a box with the visible part of a surface that explains it.
const LEAST_OVERLAP: f64 = 0.4;
/// Weight of a surface's fit to its own boxes relative to the overlap, when several surfaces explain a box.
const TRUST: f64 = 0.2;

/// The views, and the owners of their points.
pub(crate) struct Sights<'a> {
    pub(crate) looks: &'a [Placed<'a>],
    pub(crate) owners: &'a [Vec<u16>],
    pub(crate) measured: &'a [Vec<Option<[f32; 4]>>],
}

pub(crate) fn assign(
    groups: Vec<(SubmapId, Vec<Seen>)>,
    sights: &Sights<'_>,
    world: &World<'_>,
) -> Vec<Group> {
    let mut carved: Vec<Group> = groups
        .into_iter()
        .filter_map(|(submap, seen)| group(submap, seen, &|_| false, sights, world))
        .collect();
    for _ in 0..ROUNDS {
        // The stable sort keeps ties in the order of first detection.
        carved.sort_by_key(|g| std::cmp::Reverse(g.seen.len()));
        let parts = again(&carved, sights, world);
        let claims = Claims::new(&carved);
        carved = parts
            .into_iter()
            .filter_map(|(by, seen)| {
                group(by.submap, seen, &|p| claims.taken(p, &by), sights, world)
            })
            .collect();
    }
    carved
}

/// A group with its carved surface, without points claimed by others; `None` without detections.
fn group(
    submap: SubmapId,
    seen: Vec<Seen>,
    taken: &dyn Fn(&Vec3) -> bool,
    sights: &Sights<'_>,
    world: &World<'_>,
) -> Option<Group> {
    let mut votes: BTreeMap<ClassId, f64> = BTreeMap::new();
    for (l, s) in &seen {
        let sighting = &sights.looks[*l].look.sightings[*s];
        *votes.entry(sighting.class).or_default() += f64::from(sighting.score);
    }
    let class = *votes.iter().max_by(|a, b| a.1.total_cmp(b.1))?.0;
    let task = Task {
        class,
        seen: &seen,
        floor: world.levels.get(&submap),
        taken,
    };
    let carved = carve(&task, sights);
    Some(Group {
        submap,
        class,
        seen,
        carved,
    })
}

/// The detections that each surface explains, and those of each group without an explanation, with their previous classification.
fn again(groups: &[Group], sights: &Sights<'_>, world: &World<'_>) -> Vec<(Claimant, Vec<Seen>)> {
    let surfaces: Vec<Vec<Vec3>> = groups
        .iter()
        .map(|g| {
            let all: Vec<Vec3> = g.carved.points.iter().map(|p| p.1).collect();
            evenly(&all, POINTS).into_iter().map(|i| all[i]).collect()
        })
        .collect();
    let mut explained: Vec<BTreeMap<usize, (f64, usize)>> = vec![BTreeMap::new(); groups.len()];
    let mut left: Vec<Vec<Seen>> = vec![Vec::new(); groups.len()];
    for (own, group) in groups.iter().enumerate() {
        let floor = world.levels.get(&group.submap);
        for (l, s) in &group.seen {
            let placed = &sights.looks[*l];
            let class = placed.look.sightings[*s].class;
            let Some(bounds) = sights.measured[*l][*s] else {
                left[own].push((*l, *s));
                continue;
            };
            let floor = floor.filter(|_| stands(class));
            let mut best: Option<(f64, usize)> = None;
            for (k, g) in groups.iter().enumerate() {
                if g.class != class || g.submap != group.submap || g.carved.fit < LEAST_FIT {
                    continue;
                }
                let met = meets(&surfaces[k], placed, &bounds, floor);
                let worth = met + TRUST * g.carved.fit;
                if met >= LEAST_OVERLAP && best.is_none_or(|b| worth > b.0) {
                    best = Some((worth, k));
                }
            }
            // At most one box per view belongs to an object.
            match best {
                Some((worth, k)) => match explained[k].insert(*l, (worth, *s)) {
                    Some(before) if before.0 >= worth => {
                        explained[k].insert(*l, before);
                        left[own].push((*l, *s));
                    }
                    Some(before) => left[own].push((*l, before.1)),
                    None => {}
                },
                None => left[own].push((*l, *s)),
            }
        }
    }
    let mut parts = Vec::new();
    for (k, group) in groups.iter().enumerate() {
        let seen = explained[k].iter().map(|(l, (_, s))| (*l, *s)).collect();
        left[k].sort_unstable();
        let claimant = Claimant::of(group);
        let unexplained = Claimant {
            fit: 0.0,
            ..claimant
        };
        let left = std::mem::take(&mut left[k]);
        for (claimant, seen) in [(claimant, seen), (unexplained, left)] {
            if !seen.is_empty() {
                parts.push((claimant, seen));
            }
        }
    }
    parts
}

/// Overlap of a box with the visible part of a surface, including its feet if it stands on a floor.
fn meets(surface: &[Vec3], placed: &Placed<'_>, bounds: &[f32; 4], floor: Option<&Floor>) -> f64 {
    let extents = surface.iter().filter_map(|p| placed.extent(p, floor));
    overlap(around(extents), bounds)
}
