//! Carves an object's surface points out of its boxes from all sides.
//!
//! A box alone hardly limits depth: it also contains foreground and background. But a point of the object is in nearly all boxes that see
//! it, and the object's points reach the borders of all of them; other points leave a box when the camera moves, and fill it in part.

use super::assign::Sights;
use super::beyond::beyond;
use super::frames::{CELLS, Frames, MOST_COMPARED, cell};
use super::look::Shown;
use super::own::{Seen, inside};
use super::part::{Point, stands};
use super::scope::Scope;
use crate::floor::Floor;
use std::collections::BTreeMap;
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;

/// Constant part of the margin around a box within which points count as inside, px.
const MARGIN: f32 = 4.0;
/// Part of the margin proportional to the box's size: detected boxes jitter.
const MARGIN_SHARE: f32 = 0.06;
/// Maximum share of boxes that a point may be outside of.
const MOST_OUTSIDE: f64 = 0.25;
/// Minimum share of boxes that must contain a point.
const LEAST_WITHIN: f64 = 0.15;
/// Height below which points belong to the floor, m.
const SOLE: f64 = 0.05;
/// Distance in cells within which points are connected.
const LINK_CELLS: f64 = 2.5;
/// Distances in points of the reduced image, across and along the line of sight, within which points are connected: surfaces are seen at
/// angles up to 70 degrees.
const LINK_POINTS: [f64; 2] = [1.7, 2.5];
/// Weight of the filled share of a box relative to the fit of its borders.
const FILL: f64 = 0.25;
/// Minimum improvement of the fit by a further component.
const GAIN: f64 = 0.02;
/// Maximum distance of a further component from the chosen ones, as a share of their size.
const GAP: f64 = 0.4;

/// Maximum loss of fit at which the component at the tracker's depth is preferred.
const TRACKED: f64 = 0.05;

/// A surface point with its evidence from the compared boxes.
#[derive(Clone)]
pub(crate) struct Cell {
    point: Point,
    pub(crate) at: Vec3,
    depth: f64,
    ray: Vec3,
    /// Whether it is at the tracker's depth of the object.
    tracked: bool,
    /// In the compared detections, the number of places beyond the borders where the surface continues from here, and of places with known
    /// depth.
    beyond: [u32; 2],
    /// By compared detection, its pixels where visible: see [`super::look::Placed::extent`].
    pixels: Vec<Option<[f32; 4]>>,
}

#[cfg(test)]
impl Cell {
    /// A point with its pixel in one view.
    pub(crate) fn in_one_look(at: Vec3, pixel: [f32; 2]) -> Self {
        let [x, y] = pixel;
        Self {
            point: Point {
                keyframe: stillpoint_map::KeyframeId(0),
                at: [0; 3],
            },
            at,
            depth: at.z,
            ray: Vec3::z(),
            tracked: false,
            beyond: [0; 2],
            pixels: vec![Some([x, y, x, y])],
        }
    }

    /// Sets whether its surface continues beyond the borders.
    pub(crate) fn at_border(mut self, goes_on: bool) -> Self {
        self.beyond = [u32::from(goes_on), 1];
        self
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Carved {
    pub(crate) points: Vec<(Point, Vec3)>,
    /// Fit to the borders of the boxes, 0 to 1.
    pub(crate) fit: f64,
    /// Doubt that it is background, 0 to 1.
    pub(crate) doubt: f64,
}

pub(crate) struct Task<'a> {
    pub(crate) class: ClassId,
    pub(crate) seen: &'a [Seen],
    pub(crate) floor: Option<&'a Floor>,
    /// Whether a point is claimed by another object.
    pub(crate) taken: &'a dyn Fn(&Vec3) -> bool,
}

pub(crate) fn carve(task: &Task<'_>, sights: &Sights<'_>) -> Carved {
    let frames = Frames::new(task.seen, sights);
    let side = cell(task.seen, sights.looks);
    let mut cells = gather(task, sights, side);
    let floor = task.floor.filter(|_| stands(task.class));
    cells.retain_mut(|c| is_own(c, &frames, floor));
    let grid = sights.looks[task.seen[0].0].grid;
    let apart = grid.step as f64 / grid.camera.fx;
    let scope = Scope {
        class: task.class,
        up: task.floor.map(|f| f.up),
        boxes: &frames.boxes,
        sides: &|at| frames.sides(at),
    };
    let best = |some: &[usize]| {
        let pieces = pieces(&cells, some, side, apart);
        let pieces: Vec<Vec<usize>> = pieces.into_iter().map(|p| scope.cut(&cells, p)).collect();
        let own = choose(&cells, &pieces, &scope);
        let fit = fit(&cells, &own, &frames.boxes);
        (own, fit)
    };
    let all: Vec<usize> = (0..cells.len()).collect();
    let tracked: Vec<usize> = all.iter().copied().filter(|i| cells[*i].tracked).collect();
    let (all, tracked) = (best(&all), best(&tracked));
    let doubt = |best: &(Vec<usize>, f64)| scope.doubt(&cells, &best.0);
    let better = tracked.1 - doubt(&tracked) + TRACKED > all.1 - doubt(&all);
    let (mut own, fit) = if better { tracked } else { all };
    own.sort_unstable();
    let doubt = scope.doubt(&cells, &own);
    let points = own.into_iter().map(|i| (cells[i].point, cells[i].at));
    Carved {
        points: points.collect(),
        fit,
        doubt,
    }
}

/// All points in the boxes that do not belong to a smaller one.
fn gather(task: &Task<'_>, sights: &Sights<'_>, side: f64) -> Vec<Cell> {
    let mut cells: BTreeMap<[i32; 3], Cell> = BTreeMap::new();
    for (l, s) in task.seen {
        let placed = &sights.looks[*l];
        for i in inside(placed, &placed.look.sightings[*s]) {
            let owner = usize::from(sights.owners[*l][i]);
            if owner != 0 && owner != s + 1 {
                continue;
            }
            let Some(p) = placed.in_camera(i) else {
                continue;
            };
            let Some((point, at)) = placed.keep(&p) else {
                continue;
            };
            if task.floor.is_some_and(|f| f.height(&at).abs() < SOLE) || (task.taken)(&at) {
                continue;
            }
            let cell = || Cell {
                point,
                at,
                depth: p.z,
                ray: (at - placed.world_from_camera.translation).normalize(),
                tracked: false,
                beyond: [0; 2],
                pixels: Vec::new(),
            };
            let cell = cells.entry(key(&at, side)).or_insert_with(cell);
            cell.tracked |= owner == s + 1;
        }
    }
    cells.into_values().collect()
}

/// Whether a point is in nearly all boxes from which it is visible.
fn is_own(cell: &mut Cell, frames: &Frames<'_>, floor: Option<&Floor>) -> bool {
    let (mut within, mut outside) = (0_u32, 0_u32);
    cell.pixels.clear();
    for (l, s) in &frames.compared {
        let placed = &frames.sights.looks[*l];
        let sight = placed.project(&cell.at);
        let shown = placed.shows(&cell.at);
        let pixel = sight.map(|(px, _)| [px.x as f32, px.y as f32]);
        cell.pixels.push(placed.extent(&cell.at, floor));
        let (Some(at), false) = (pixel, shown == Shown::Nearer) else {
            continue;
        };
        if let (Some((px, z)), Shown::Point) = (sight, shown) {
            let more = beyond(placed, &placed.look.sightings[*s].bounds, px, z);
            (0..2).for_each(|k| cell.beyond[k] += more[k]);
        }
        let [x0, y0, x1, y1] = placed.look.sightings[*s].bounds;
        let margin = [x1 - x0, y1 - y0].map(|side| MARGIN + MARGIN_SHARE * side);
        let owner = sight
            .and_then(|(px, _)| placed.grid.nearest(px))
            .map_or(0, |i| usize::from(frames.sights.owners[*l][i]));
        let along = at[0] >= x0 - margin[0] && at[0] <= x1 + margin[0];
        let inside = along && at[1] >= y0 - margin[1] && at[1] <= y1 + margin[1];
        if inside && (owner == 0 || owner == s + 1) {
            within += 1;
        } else {
            outside += 1;
        }
    }
    let often = f64::from(within) >= LEAST_WITHIN * frames.compared.len() as f64;
    often && f64::from(outside) <= MOST_OUTSIDE * f64::from(within + outside)
}

fn pieces(cells: &[Cell], some: &[usize], side: f64, apart: f64) -> Vec<Vec<usize>> {
    let mut buckets: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    let reach = |c: &Cell, k: usize| (LINK_CELLS * side).max(LINK_POINTS[k] * apart * c.depth);
    let reaches = some.iter().map(|i| reach(&cells[*i], 1));
    let widest = reaches.fold(side, f64::max);
    for i in some.iter().copied() {
        let bucket = key(&cells[i].at, widest);
        buckets.entry(bucket).or_default().push(i);
    }
    let mut piece = vec![usize::MAX; cells.len()];
    let mut pieces: Vec<Vec<usize>> = Vec::new();
    for first in some.iter().copied() {
        if piece[first] != usize::MAX {
            continue;
        }
        piece[first] = pieces.len();
        let mut members = vec![first];
        let mut next = 0;
        while let Some(i) = members.get(next).copied() {
            next += 1;
            let [x, y, z] = key(&cells[i].at, widest);
            for k in 0..27 {
                let near = [x + k / 9 - 1, y + k / 3 % 3 - 1, z + k % 3 - 1];
                for j in buckets.get(&near).into_iter().flatten() {
                    if piece[*j] != usize::MAX {
                        continue;
                    }
                    let gap = cells[*j].at - cells[i].at;
                    let along = gap.dot(&cells[i].ray);
                    let across = (gap - along * cells[i].ray).norm();
                    if across < reach(&cells[i], 0) && along.abs() < reach(&cells[i], 1) {
                        piece[*j] = pieces.len();
                        members.push(*j);
                    }
                }
            }
        }
        pieces.push(members);
    }
    pieces
}

/// The component that fills the boxes best, with others that improve the fit without exceeding the maximum size.
fn choose(cells: &[Cell], pieces: &[Vec<usize>], scope: &Scope<'_>) -> Vec<usize> {
    let boxes = scope.boxes;
    let worth = |p: &Vec<usize>| {
        fit(cells, p, boxes) + FILL * fill(cells, p, boxes) - scope.doubt(cells, p)
    };
    let mut order: Vec<(f64, usize)> = pieces.iter().map(worth).zip(0..).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut order = order.into_iter().map(|o| o.1);
    let Some(first) = order.next() else {
        return Vec::new();
    };
    let mut chosen = pieces[first].clone();
    let mut best = fit(cells, &chosen, boxes);
    for k in order {
        if !is_near(cells, &chosen, &pieces[k]) {
            continue;
        }
        let more: Vec<usize> = chosen.iter().chain(&pieces[k]).copied().collect();
        if !scope.holds(cells, &more) {
            continue;
        }
        let with = fit(cells, &more, boxes);
        if with > best + GAIN {
            (chosen, best) = (more, with);
        }
    }
    chosen
}

/// Whether the gap between the boxes around two components is below a share of the first's size.
fn is_near(cells: &[Cell], first: &[usize], second: &[usize]) -> bool {
    let around = |members: &[usize]| {
        let far = Vec3::repeat(f64::INFINITY);
        members.iter().fold((far, -far), |(low, high), i| {
            (low.inf(&cells[*i].at), high.sup(&cells[*i].at))
        })
    };
    let (a, b) = (around(first), around(second));
    let gap = (a.0 - b.1).sup(&(b.0 - a.1)).sup(&Vec3::zeros());
    gap.norm() < GAP * (a.1 - a.0).max()
}

/// Fit of points to the boxes: the mean intersection over union of each box with that around the visible points.
pub(crate) fn fit(cells: &[Cell], members: &[usize], boxes: &[Option<[f32; 4]>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for (k, b) in boxes.iter().enumerate() {
        let Some(b) = b else {
            continue;
        };
        let pixels = members.iter().filter_map(|i| cells[*i].pixels[k]);
        sum += overlap(around(pixels), b);
        count += 1;
    }
    sum / f64::from(count.max(1))
}

pub(crate) fn around(pixels: impl Iterator<Item = [f32; 4]>) -> [f32; 4] {
    let far = f32::INFINITY;
    pixels.fold([far, far, -far, -far], |a, p| {
        [
            a[0].min(p[0]),
            a[1].min(p[1]),
            a[2].max(p[2]),
            a[3].max(p[3]),
        ]
    })
}

/// Tolerance of box borders, px: detected ones jitter, and points of the reduced image are some pixels apart.
const SLACK: f32 = 6.0;

/// Intersection over union of the box around pixels with a detected one, with tolerance at each border; 0 for an inverted one.
pub(crate) fn overlap(around: [f32; 4], b: &[f32; 4]) -> f64 {
    if around[0] > around[2] {
        return 0.0;
    }
    let nearer = |k: usize| around[k] + (b[k] - around[k]).clamp(-SLACK, SLACK);
    let a = [0, 1, 2, 3].map(nearer);
    let area = |b: &[f32; 4]| (b[2] - b[0]).max(0.0) * (b[3] - b[1]).max(0.0);
    let both = [
        a[0].max(b[0]),
        a[1].max(b[1]),
        a[2].min(b[2]),
        a[3].min(b[3]),
    ];
    let either = area(&a) + area(b) - area(&both);
    if either <= 0.0 {
        return 0.0;
    }
    f64::from(area(&both) / either)
}

/// The share of places beyond the borders, next to some points, where their surface continues.
pub(crate) fn goes_on(cells: &[Cell], members: &[usize]) -> f64 {
    let sum = members.iter().fold([0, 0], |sum: [u32; 2], i| {
        let [on, known] = cells[*i].beyond;
        [sum[0] + on, sum[1] + known]
    });
    f64::from(sum[0]) / f64::from(sum[1].max(1))
}

fn fill(cells: &[Cell], members: &[usize], boxes: &[Option<[f32; 4]>]) -> f64 {
    let count = |i: usize| cells[i].pixels.iter().flatten().count();
    let own: usize = members.iter().map(|i| count(*i)).sum();
    let all: usize = (0..cells.len()).map(count).sum();
    debug_assert!(boxes.len() <= MOST_COMPARED);
    own as f64 / all.max(1) as f64
}

fn key(p: &Vec3, cell: f64) -> [i32; 3] {
    p.map(|v| (v / cell).floor() as i32).into()
}

/// At most `most` of some points, one per cell, with the smallest sufficient cells.
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
