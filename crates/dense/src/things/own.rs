//! Which points are a thing's own.

use super::look::{Placed, Shown, Sighting};
use super::part::Point;
use std::collections::BTreeMap;
use stillpoint_geometry::Vec3;

/// The sighting that each point of a small image belongs to, counted from 1; 0 for none. Where boxes overlap it is that of the smallest one, since
/// things stand on tables and before shelves and not the other way round.
pub(crate) fn owners(placed: &Placed<'_>) -> Vec<u16> {
    let (grid, look) = (placed.grid, placed.look);
    let mut owners = vec![0; grid.columns * grid.rows];
    let area = |s: &Sighting| {
        let [x0, y0, x1, y1] = s.bounds;
        (x1 - x0) * (y1 - y0)
    };
    let mut order: Vec<usize> = (0..look.sightings.len().min(usize::from(u16::MAX))).collect();
    order.sort_by(|a, b| area(&look.sightings[*a]).total_cmp(&area(&look.sightings[*b])));
    for k in order {
        let sighting = &look.sightings[k];
        let [near, far] = sighting.depths.map(f64::from);
        for i in inside(placed, sighting) {
            let z = look.depth(i);
            if owners[i] == 0 && z > 0.0 && (near..=far).contains(&z) {
                owners[i] = k as u16 + 1;
            }
        }
    }
    owners
}

/// The points of the small image in the box of a sighting.
fn inside(placed: &Placed<'_>, sighting: &Sighting) -> impl Iterator<Item = usize> + use<> {
    let (grid, [x0, y0, x1, y1]) = (placed.grid, sighting.bounds);
    let (step, columns) = (grid.step as f32, grid.columns);
    let range = |from: f32, to: f32, end: usize| {
        let first = (from / step).ceil().max(0.0) as usize;
        // Negative where the box is beside the image.
        let after = ((to / step).floor() + 1.0).max(0.0) as usize;
        first.min(end)..after.min(end)
    };
    let (xs, ys) = (range(x0, x1, columns), range(y0, y1, grid.rows));
    ys.flat_map(move |y| xs.clone().map(move |x| y * columns + x))
}

/// A track in a look: the number of the look and of the sighting in it.
pub(crate) type Seen = (usize, usize);

/// Sides of the cells in which points are one, as a share of a thing's size, and their bounds, m.
const CELL: f64 = 1.0 / 24.0;
const CELLS: [f64; 2] = [0.005, 0.03];
/// Sightings that points are compared with: more say the same again.
const MOST_COMPARED: usize = 24;
/// A point is outside of a box when it is this far outside, px, ...
const MARGIN: f32 = 4.0;
/// ... and this share of the box's size: detected boxes jitter.
const MARGIN_SHARE: f32 = 0.06;
/// Share of the boxes that a point may be outside of.
const MOST_OUTSIDE: f64 = 0.25;

/// The points of a track's own surface: in its box and at its depth, and in nearly all of its boxes from wherever else they are seen. What is behind a
/// thing is beside it from elsewhere.
pub(crate) fn points(
    seen: &[Seen],
    looks: &[Placed<'_>],
    owners: &[Vec<u16>],
) -> Vec<(Point, Vec3)> {
    let cell = cell(seen, looks);
    let mut cells: BTreeMap<[i32; 3], (Point, Vec3)> = BTreeMap::new();
    for (l, s) in seen {
        let placed = &looks[*l];
        for i in inside(placed, &placed.look.sightings[*s]) {
            if usize::from(owners[*l][i]) != s + 1 {
                continue;
            }
            let kept = placed.in_camera(i).and_then(|p| placed.keep(&p));
            if let Some((point, p)) = kept {
                cells.entry(key(&p, cell)).or_insert((point, p));
            }
        }
    }
    let every = seen.len().div_ceil(MOST_COMPARED).max(1);
    let compared: Vec<&Seen> = seen.iter().step_by(every).collect();
    let own = |p: &Vec3| {
        let (mut within, mut outside) = (0_u32, 0_u32);
        for (l, s) in &compared {
            match is_in(&looks[*l], &looks[*l].look.sightings[*s], p) {
                Some(true) => within += 1,
                Some(false) => outside += 1,
                None => {}
            }
        }
        f64::from(outside) <= MOST_OUTSIDE * f64::from(within + outside)
    };
    cells.into_values().filter(|(_, p)| own(p)).collect()
}

/// Points that a sighting has to have to say anything.
const LEAST_POINTS: usize = 5;
/// How far the middle of what is seen of one thing moves from look to look, as a share of its longest side, and at least, m.
const WANDERS: f64 = 0.4;
const WANDERS_LEAST: f64 = 0.05;
/// Places of a thing that are remembered: parts of it come into sight and leave it.
const REMEMBERED: usize = 8;

/// Parts a track by place: where things of one kind lie side by side, trackers take one for the other now and then.
pub(crate) fn by_place(seen: &[Seen], looks: &[Placed<'_>], owners: &[Vec<u16>]) -> Vec<Vec<Seen>> {
    let mut parts: Vec<(Vec<Seen>, Vec<Vec3>)> = Vec::new();
    for at in seen {
        let Some((middle, longest)) = place(at, looks, &owners[at.0]) else {
            continue;
        };
        let apart = |places: &[Vec3]| {
            let recent = places.iter().rev().take(REMEMBERED);
            let distances = recent.map(|p| (p - middle).norm());
            distances.fold(f64::INFINITY, f64::min)
        };
        let nearest = (0..parts.len())
            .map(|k| (apart(&parts[k].1), k))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match nearest.filter(|n| n.0 < (WANDERS * longest).max(WANDERS_LEAST)) {
            Some((_, k)) => {
                parts[k].0.push(*at);
                parts[k].1.push(middle);
            }
            None => parts.push((vec![*at], vec![middle])),
        }
    }
    parts.into_iter().map(|p| p.0).collect()
}

/// The middle of what a sighting shows, world, and the longest side of its box, m.
fn place((l, s): &Seen, looks: &[Placed<'_>], owners: &[u16]) -> Option<(Vec3, f64)> {
    let placed = &looks[*l];
    let sighting = &placed.look.sightings[*s];
    let own = inside(placed, sighting).filter(|i| usize::from(owners[*i]) == s + 1);
    let points: Vec<Vec3> = own.filter_map(|i| placed.in_camera(i)).collect();
    if points.len() < LEAST_POINTS {
        return None;
    }
    let mut values = Vec::with_capacity(points.len());
    let mut median = |k: usize| {
        values.clear();
        values.extend(points.iter().map(|p| p[k]));
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let middle = Vec3::new(median(0), median(1), median(2));
    let [x0, y0, x1, y1] = sighting.bounds.map(f64::from);
    let longest = (x1 - x0).max(y1 - y0) / placed.grid.camera.fx * middle.z;
    Some((placed.world_from_camera.transform(&middle), longest))
}

/// Whether a point is in the box of a sighting; none where it is not seen.
fn is_in(placed: &Placed<'_>, sighting: &Sighting, p: &Vec3) -> Option<bool> {
    let (px, _) = placed.project(p)?;
    if placed.shows(p) == Shown::Nearer {
        return None;
    }
    let [x0, y0, x1, y1] = sighting.bounds;
    let (x, y) = (px.x as f32, px.y as f32);
    let margin = [x1 - x0, y1 - y0].map(|side| MARGIN + MARGIN_SHARE * side);
    let along = x >= x0 - margin[0] && x <= x1 + margin[0];
    Some(along && y >= y0 - margin[1] && y <= y1 + margin[1])
}

/// The side of cells for a thing of the size that its boxes have, m.
fn cell(seen: &[Seen], looks: &[Placed<'_>]) -> f64 {
    let size = |(l, s): &Seen| {
        let sighting = &looks[*l].look.sightings[*s];
        let [x0, y0, x1, y1] = sighting.bounds.map(f64::from);
        let z = 0.5 * f64::from(sighting.depths[0] + sighting.depths[1]);
        (x1 - x0).max(y1 - y0) / looks[*l].grid.camera.fx * z
    };
    let largest = seen.iter().map(size).fold(0.0, f64::max);
    (CELL * largest).clamp(CELLS[0], CELLS[1])
}

fn key(p: &Vec3, cell: f64) -> [i32; 3] {
    p.map(|v| (v / cell).floor() as i32).into()
}

/// At most so many of some points, one in each of cells that are as small as they can be for that.
pub(crate) fn evenly(points: &[Vec3], most: usize) -> Vec<usize> {
    let mut cell = CELLS[0];
    loop {
        let mut cells: BTreeMap<[i32; 3], usize> = BTreeMap::new();
        for (i, p) in points.iter().enumerate() {
            cells.entry(key(p, cell)).or_insert(i);
        }
        if cells.len() <= most {
            return cells.into_values().collect();
        }
        cell *= 1.25;
    }
}
