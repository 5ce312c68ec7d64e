//! Which sightings are of one thing: those whose boxes are where its surface is in sight.
//!
//! Trackers take one book for the next. So their tracks are a beginning only: each is carved into a surface, every sighting goes to the surface of its class
//! that explains its box best, and what is left is carved again.

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

/// Sightings of what may be one thing.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) submap: SubmapId,
    pub(crate) class: ClassId,
    pub(crate) seen: Vec<Seen>,
    pub(crate) carved: Carved,
}

/// How often sightings are assigned anew: the second time mends what the first one could not know.
const ROUNDS: usize = 2;
/// Points of a surface that are looked at.
const POINTS: usize = 160;
/// Surfaces that meet the borders of their own boxes less explain no others.
const LEAST_FIT: f64 = 0.4;
/// A box that overlaps less with what is in sight of a surface is not explained by it.
const LEAST_OVERLAP: f64 = 0.4;
/// Of surfaces that explain a box alike, the one that explains the others better: what this counts beside the overlap.
const TRUST: f64 = 0.2;

/// Looks, and whose points are whose in them.
pub(crate) struct Sights<'a> {
    pub(crate) looks: &'a [Placed<'a>],
    pub(crate) owners: &'a [Vec<u16>],
    /// Of every sighting the part of its box in which there is depth.
    pub(crate) measured: &'a [Vec<Option<[f32; 4]>>],
}

/// Carves groups of sightings and assigns these anew.
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
        // Stable: of equals the one that was seen first.
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

/// A group with its surface, without the points that are taken; none of no sightings.
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

/// The sightings of each surface, and those of each group that none explains; with what they were taken for so far.
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
            // Of two boxes in a look, one is of the thing.
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

/// How well what is in sight of a surface meets a box; with its feet where it stands on a floor.
fn meets(surface: &[Vec3], placed: &Placed<'_>, bounds: &[f32; 4], floor: Option<&Floor>) -> f64 {
    let extents = surface.iter().filter_map(|p| placed.extent(p, floor));
    overlap(around(extents), bounds)
}
