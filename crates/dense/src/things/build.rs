//! Builds the objects of a map from the collected views.

use super::ThingMap;
use super::absent::{presence, shown};
use super::assign::{Group, Sights, assign};
use super::bearings::{Standing, standing};
use super::ends::complete;
use super::gather::Things;
use super::ground::ground;
use super::level;
use super::look::Placed;
use super::merge::{Part, merge};
use super::own::{Seen, by_place, measured, owners};
use super::part::{MOST_SIDES, Point, Record, World, can_be};
use super::upright::UprightBox;
use crate::floor::Floor;
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;
use stillpoint_map::{MapView, SubmapId};

/// Minimum number of views with a detection of a track.
const LEAST_LOOKS: usize = 2;
/// Minimum fit of an object's surface to its boxes: otherwise the surface belongs to something before or behind it.
const LEAST_FIT: f64 = 0.5;
/// Maximum doubt that a surface is background: reached when it continues in six of ten places beyond the borders of its boxes.
const MOST_DOUBT: f64 = 0.3;

/// The objects at the poses of a map version.
pub(crate) fn build(things: &Things, view: &MapView) -> ThingMap {
    let looks: Vec<Placed<'_>> = things
        .looks
        .iter()
        .filter_map(|look| Placed::new(look, &things.grid, view))
        .collect();
    if looks.is_empty() {
        return things.known.clone();
    }
    let levels = levels(things, &looks);
    let world = World {
        view,
        levels: &levels,
    };
    let mut parts = known(&things.known, 0, &world);
    let (found, left) = tracks(&looks, &world);
    parts.extend(found);
    let by_boxes = by_boxes(&left, &parts, &looks, &world);
    parts.extend(by_boxes);
    for part in &mut parts {
        part.shown = shown(part, &looks);
    }
    let merged = merge(parts, &world);
    let mut records: Vec<Record> = untouched(&things.known, &world);
    for part in merged {
        let presence = presence(&part, &looks);
        if !presence.gone {
            let hidden = hidden(&part, &looks, &world);
            records.push(Record {
                hidden,
                ..record(part, presence.missed, view)
            });
        }
    }
    let ground = ground(&things.known.ground, &looks, &levels, view);
    ThingMap {
        records,
        levels,
        ground,
    }
}

/// Merges the objects of two joined maps; detections of common objects are added. `map` is the joined map, in which the keyframe ids of the
/// second are raised by `added`.
pub(crate) fn join(first: &ThingMap, second: &ThingMap, added: u32, map: &MapView) -> ThingMap {
    let second = shifted(second, added);
    // Joined submaps use the floor of the first; others keep theirs unless a correction moved them.
    let mut levels = second.levels.clone();
    levels.extend(first.levels.clone());
    levels.retain(|submap, _| map.submaps().iter().any(|s| s.0 == *submap));
    let world = World {
        view: map,
        levels: &levels,
    };
    let mut parts = known(first, 0, &world);
    parts.extend(known(&second, 1, &world));
    let mut records = untouched(first, &world);
    records.extend(untouched(&second, &world));
    let merged = merge(parts, &world);
    records.extend(merged.into_iter().map(|part| Record {
        hidden: hidden(&part, &[], &world),
        ..record(part, 0, map)
    }));
    let spots = [&first.ground[..], &second.ground].concat();
    let ground = ground(&spots, &[], &levels, map);
    ThingMap {
        records,
        levels,
        ground,
    }
}

/// A copy with raised ids of keyframes, and of the submaps named after them.
fn shifted(map: &ThingMap, added: u32) -> ThingMap {
    let mut map = map.clone();
    let points = map.records.iter_mut().flat_map(|r| &mut r.points);
    let spots = map.ground.iter_mut().map(|s| &mut s.at);
    for point in points.chain(spots) {
        point.keyframe.0 += added;
    }
    let levels = map.levels.into_iter();
    map.levels = levels.map(|(s, f)| (SubmapId(s.0 + added), f)).collect();
    map
}

/// The floor of every submap: the lower of the known one and that of this run, which may be a table top where no floor was visible.
fn levels(things: &Things, looks: &[Placed<'_>]) -> BTreeMap<SubmapId, Floor> {
    let mut levels = things.known.levels.clone();
    let submaps: BTreeSet<SubmapId> = looks.iter().map(|l| l.submap).collect();
    for submap in submaps {
        let own: Vec<&Placed<'_>> = looks.iter().filter(|l| l.submap == submap).collect();
        let Some(found) = level::floor(&own, &things.config.about_up) else {
            continue;
        };
        let found = level::below_tables(found, &own);
        let eye = own[0].world_from_camera.translation;
        let lower = levels
            .get(&submap)
            .is_none_or(|f| f.height(&eye) < found.height(&eye));
        if lower {
            levels.insert(submap, found);
        }
    }
    levels
}

/// Objects of earlier runs, as far as the map has their keyframes.
fn known(map: &ThingMap, file: u8, world: &World<'_>) -> Vec<Part> {
    let part = |record: &Record| {
        let (submap, points) = record.place(world.view)?;
        let bounds = world.bounds(record.class, submap, &points)?;
        let own = |p: &&Point| world.view.submap_of(p.keyframe) == Some(submap);
        let kept = record.points.iter().filter(own).copied();
        Some(Part {
            votes: BTreeMap::from([(record.class, f64::from(record.found))]),
            looks: BTreeSet::new(),
            shown: BTreeSet::new(),
            known: vec![record.clone()],
            files: BTreeSet::from([file]),
            submap,
            points: kept.zip(points).collect(),
            bounds,
            seen: record.seen,
            farthest: record.farthest,
        })
    };
    map.records.iter().filter_map(part).collect()
}

fn untouched(map: &ThingMap, world: &World<'_>) -> Vec<Record> {
    let lost = |r: &&Record| {
        let place = r.place(world.view);
        place
            .and_then(|(submap, points)| world.bounds(r.class, submap, &points))
            .is_none()
    };
    map.records.iter().filter(lost).cloned().collect()
}

type Track = (SubmapId, Vec<Seen>);

/// Objects from the tracks of this run, and for each track the detections that no surface explains.
fn tracks(looks: &[Placed<'_>], world: &World<'_>) -> (Vec<Part>, Vec<Track>) {
    let owners: Vec<Vec<u16>> = looks.iter().map(owners).collect();
    let mut seen: BTreeMap<(SubmapId, u32, u32), Vec<Seen>> = BTreeMap::new();
    for (l, placed) in looks.iter().enumerate() {
        for (s, sighting) in placed.look.sightings.iter().enumerate() {
            if sighting.counts {
                let key = (placed.submap, sighting.track, sighting.run);
                seen.entry(key).or_default().push((l, s));
            }
        }
    }
    let parted = seen.iter().flat_map(|((submap, _, _), seen)| {
        let places = by_place(seen, looks, &owners);
        places.into_iter().map(move |seen| (*submap, seen))
    });
    let measured_in = |l: &Placed<'_>| l.look.sightings.iter().map(|s| measured(l, s)).collect();
    let measured: Vec<Vec<Option<[f32; 4]>>> = looks.iter().map(measured_in).collect();
    let sights = Sights {
        looks,
        owners: &owners,
        measured: &measured,
    };
    let groups = assign(parted.collect(), &sights, world);
    let mut explained: BTreeSet<Seen> = BTreeSet::new();
    let mut parts = Vec::new();
    for group in groups {
        let sightings = group.seen.clone();
        if let Some(part) = part(group, looks, world) {
            // A fragment of a chair does not locate it.
            if can_be(part.class(), &part.bounds) {
                explained.extend(sightings);
            }
            parts.push(part);
        }
    }
    let rest = seen.into_iter().map(|((submap, _, _), mut seen)| {
        seen.retain(|s| !explained.contains(s));
        (submap, seen)
    });
    (parts, rest.collect())
}

/// Locates objects that no surface explains by their boxes, unless another known object of the class is there.
fn by_boxes(
    tracks: &[Track],
    known: &[Part],
    looks: &[Placed<'_>],
    world: &World<'_>,
) -> Vec<Part> {
    let one = |(submap, seen): &Track| {
        let floor = world.levels.get(submap)?;
        let votes = votes(seen, looks);
        let class = *votes.iter().max_by(|a, b| a.1.total_cmp(b.1))?.0;
        let Standing {
            points,
            seen,
            farthest,
        } = standing(class, seen, looks, floor)?;
        let places: Vec<Vec3> = points.iter().map(|p| p.1).collect();
        let bounds = world.bounds(class, *submap, &places)?;
        // An object found there by its surface at least as often takes precedence; otherwise both are merged.
        let is_known = known.iter().any(|p| {
            let apart = (p.bounds.centre - bounds.centre).norm();
            let reach = p.bounds.size.xy().max().max(bounds.size.xy().max());
            let same = p.submap == *submap && p.class() == class && can_be(class, &p.bounds);
            same && apart < reach && p.found() as usize >= seen.len()
        });
        (!is_known).then(|| Part {
            votes,
            looks: seen.iter().map(|s| s.0).collect(),
            shown: BTreeSet::new(),
            known: Vec::new(),
            files: BTreeSet::new(),
            submap: *submap,
            points,
            bounds,
            seen: stamps(&seen, looks),
            farthest,
        })
    };
    tracks.iter().filter_map(one).collect()
}

/// Converts a group of detections to an object; `None` if its surface does not locate it.
fn part(group: Group, looks: &[Placed<'_>], world: &World<'_>) -> Option<Part> {
    let Group {
        submap,
        seen,
        carved,
        ..
    } = group;
    if seen.len() < LEAST_LOOKS || carved.fit < LEAST_FIT || carved.doubt > MOST_DOUBT {
        return None;
    }
    let places: Vec<Vec3> = carved.points.iter().map(|p| p.1).collect();
    let bounds = world.bounds(group.class, submap, &places)?;
    let depths = seen
        .iter()
        .map(|(l, s)| looks[*l].look.sightings[*s].depths[1]);
    Some(Part {
        votes: votes(&seen, looks),
        looks: seen.iter().map(|s| s.0).collect(),
        shown: BTreeSet::new(),
        known: Vec::new(),
        files: BTreeSet::new(),
        submap,
        points: carved.points,
        bounds,
        seen: stamps(&seen, looks),
        farthest: depths.map(f64::from).fold(0.0, f64::max),
    })
}

fn votes(seen: &[Seen], looks: &[Placed<'_>]) -> BTreeMap<ClassId, f64> {
    let mut votes = BTreeMap::new();
    for (l, s) in seen {
        let sighting = &looks[*l].look.sightings[*s];
        *votes.entry(sighting.class).or_default() += f64::from(sighting.score);
    }
    votes
}

fn stamps(seen: &[Seen], looks: &[Placed<'_>]) -> [f64; 2] {
    let stamp = |at: Option<&Seen>| at.map_or(0.0, |(l, _)| looks[*l].look.stamp);
    [stamp(seen.first()), stamp(seen.last())]
}

/// Centres of unseen sides, where the object is estimated to end. An earlier run may have seen its end, which limits it.
fn hidden(part: &Part, looks: &[Placed<'_>], world: &World<'_>) -> Vec<Point> {
    let Some(look) = part.looks.first().map(|l| &looks[*l]) else {
        let known = part.known.iter().flat_map(|r| &r.hidden);
        return known.take(MOST_SIDES).copied().collect();
    };
    let own: Vec<&Placed<'_>> = looks.iter().filter(|l| l.submap == part.submap).collect();
    let known = part.known.iter().filter_map(|r| r.bounds(world));
    let known: Vec<UprightBox> = known.map(|b| b.1).collect();
    let mut hidden = Vec::new();
    for side in complete(part.class(), &part.bounds, &known, &own) {
        hidden.extend(look.keep_world(&side));
    }
    hidden
}

fn record(part: Part, missed: u32, view: &MapView) -> Record {
    let class = part.class();
    // An object without detections in this run is stored unchanged, except for the missed views.
    if let ([known], true) = (&part.known[..], part.looks.is_empty()) {
        let mut known = known.clone();
        known.expected += missed;
        return known;
    }
    let before = part.known.iter();
    let mut record = Record {
        class,
        found: part.found(),
        expected: part.looks.len() as u32
            + missed
            + before.map(|r| r.expected.max(r.found)).sum::<u32>(),
        seen: part.seen,
        farthest: part.farthest,
        points: part.points.iter().map(|p| p.0).collect(),
        hidden: Vec::new(),
    };
    record.thin(view);
    record
}
