//! Assigns the points of a view to its detections, and splits tracks by place.

use super::look::{Placed, Sighting};
use stillpoint_geometry::Vec3;

/// The detection that owns each point of a reduced image, counted from 1; 0 for none. Where boxes overlap, the smallest one owns it, since
/// objects are on tables and before shelves rather than the other way round.
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

/// The points of the reduced image in the box of a detection.
pub(crate) fn inside(
    placed: &Placed<'_>,
    sighting: &Sighting,
) -> impl Iterator<Item = usize> + use<> {
    let (grid, [x0, y0, x1, y1]) = (placed.grid, sighting.bounds);
    let (step, columns) = (grid.step as f32, grid.columns);
    let range = |from: f32, to: f32, end: usize| {
        let first = (from / step).ceil().max(0.0) as usize;
        // Negative if the box is beside the image.
        let after = ((to / step).floor() + 1.0).max(0.0) as usize;
        first.min(end)..after.min(end)
    };
    let (xs, ys) = (range(x0, x1, columns), range(y0, y1, grid.rows));
    ys.flat_map(move |y| xs.clone().map(move |x| y * columns + x))
}

/// The part of a detection's box with depth: cameras measure none along some image borders, and moving people are left out. `None` if it is
/// almost nothing.
pub(crate) fn measured(placed: &Placed<'_>, sighting: &Sighting) -> Option<[f32; 4]> {
    let (grid, step) = (placed.grid, placed.grid.step as f32);
    let far = f32::INFINITY;
    let (mut around, mut count) = ([far, far, -far, -far], 0);
    for i in inside(placed, sighting).filter(|i| placed.look.depth(*i) > 0.0) {
        let px = grid.pixel(i);
        let (x, y) = (px.x as f32, px.y as f32);
        around = [
            around[0].min(x - step),
            around[1].min(y - step),
            around[2].max(x + step),
            around[3].max(y + step),
        ];
        count += 1;
    }
    let [x0, y0, x1, y1] = sighting.bounds;
    let [a, b, c, d] = around;
    (count >= LEAST_POINTS).then(|| [x0.max(a), y0.max(b), x1.min(c), y1.min(d)])
}

/// A detection: the indices of its view and within the view.
pub(crate) type Seen = (usize, usize);

/// Minimum number of points of a usable detection.
const LEAST_POINTS: usize = 5;
/// Maximum motion of an object's visible centre between views, as a share of its longest side, and its minimum, m.
const WANDERS: f64 = 0.4;
const WANDERS_LEAST: f64 = 0.05;
/// Number of places remembered per track: parts of an object become visible and occluded.
const REMEMBERED: usize = 8;

/// Splits a track by place: trackers sometimes confuse adjacent objects of one class.
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

/// The centre of a detection's points, world, and the longest side of its box, m.
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
