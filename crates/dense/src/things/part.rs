//! The stored data of an object: points anchored to keyframes.

use super::upright::UprightBox;
use super::{Thing, carve};
use crate::floor::Floor;
use std::collections::BTreeMap;
use stillpoint_detection::ClassId;
use stillpoint_geometry::{Mat3, Vec3};
use stillpoint_map::{KeyframeId, MapView, SubmapId};

/// Maximum number of points kept per object: enough for 2 % at each end to be some.
pub(crate) const MOST_POINTS: usize = 384;
/// Number of horizontal sides of a box.
pub(crate) const MOST_SIDES: usize = 4;
const PER_METRE: f64 = 1000.0;

/// A surface point in the camera of a keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Point {
    pub(crate) keyframe: KeyframeId,
    pub(crate) at: [i16; 3],
}

impl Point {
    /// `None` beyond 32 m.
    pub(crate) fn new(keyframe: KeyframeId, p: &Vec3) -> Option<Self> {
        let at = p.map(|v| (v * PER_METRE).round());
        let fits = at.iter().all(|v| v.abs() <= 32_000.0);
        fits.then(|| Self {
            keyframe,
            at: at.map(|v| v as i16).into(),
        })
    }

    fn in_keyframe(self) -> Vec3 {
        Vec3::from(self.at.map(f64::from)) / PER_METRE
    }

    /// `None` if the map lacks its keyframe.
    pub(crate) fn world(self, view: &MapView) -> Option<Vec3> {
        let pose = view.world_from_keyframe(self.keyframe)?;
        Some(pose.transform(&self.in_keyframe()))
    }
}

/// The stored data of an object, independent of the map's poses.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Record {
    pub(crate) class: ClassId,
    /// Number of views in which it was detected.
    pub(crate) found: u32,
    /// Number of views in which it could have been detected.
    pub(crate) expected: u32,
    pub(crate) seen: [f64; 2],
    /// Maximum depth at which it was detected, m.
    pub(crate) farthest: f64,
    pub(crate) points: Vec<Point>,
    /// Centres of the unseen sides, where it is estimated to end.
    pub(crate) hidden: Vec<Point>,
}

impl Record {
    /// Share of the views with a detection, with two additional misses as a prior.
    pub(crate) fn confidence(&self) -> f64 {
        f64::from(self.found) / (f64::from(self.found.max(self.expected)) + 2.0)
    }

    /// The submap of most of its keyframes, and its points there, world; `None` if the map has none of them.
    pub(crate) fn place(&self, view: &MapView) -> Option<(SubmapId, Vec<Vec3>)> {
        let placed = |p: &Point| Some((view.submap_of(p.keyframe)?, p.world(view)?));
        let placed: Vec<(SubmapId, Vec3)> = self.points.iter().filter_map(placed).collect();
        let mut counts: BTreeMap<SubmapId, usize> = BTreeMap::new();
        for (submap, _) in &placed {
            *counts.entry(*submap).or_default() += 1;
        }
        // Ties take the last one.
        let submap = *counts.iter().max_by_key(|c| c.1)?.0;
        let own = placed.into_iter().filter(|p| p.0 == submap);
        Some((submap, own.map(|p| p.1).collect()))
    }

    /// Its box with the unseen parts, and its submap.
    pub(crate) fn bounds(&self, world: &World<'_>) -> Option<(SubmapId, UprightBox)> {
        let (submap, points) = self.place(world.view)?;
        let bounds = world.bounds(self.class, submap, &points)?;
        let own = |p: &&Point| world.view.submap_of(p.keyframe) == Some(submap);
        let hidden = self.hidden.iter().filter(own);
        let hidden: Vec<Vec3> = hidden.filter_map(|p| p.world(world.view)).collect();
        Some((submap, bounds.reaching(&hidden)))
    }

    pub(crate) fn thing(&self, world: &World<'_>) -> Option<Thing> {
        let (submap, bounds) = self.bounds(world)?;
        Some(Thing {
            class: self.class,
            bounds,
            room: None,
            confidence: self.confidence(),
            found: self.found,
            submap,
            first_seen: self.seen[0],
            last_seen: self.seen[1],
        })
    }

    /// Reduces the points to the maximum, evenly in space.
    pub(crate) fn thin(&mut self, view: &MapView) {
        if self.points.len() <= MOST_POINTS {
            return;
        }
        let world = |p: &Point| p.world(view).unwrap_or_else(Vec3::zeros);
        let places: Vec<Vec3> = self.points.iter().map(world).collect();
        let kept = carve::evenly(&places, MOST_POINTS);
        self.points = kept.into_iter().map(|i| self.points[i]).collect();
    }
}

/// Minimum height and longest horizontal side, m: smaller ones are fragments that do not locate an object of the class.
const SMALLEST: [(&str, [f64; 2]); 6] = [
    ("chair", [0.35, 0.1]),
    ("dining table", [0.35, 0.3]),
    ("couch", [0.3, 0.4]),
    ("bed", [0.2, 0.5]),
    ("bench", [0.3, 0.3]),
    ("refrigerator", [0.5, 0.3]),
];

pub(crate) fn can_be(class: ClassId, bounds: &UprightBox) -> bool {
    let size = bounds.size;
    let least = SMALLEST.iter().find(|s| s.0 == class.name());
    least.is_none_or(|(_, [high, long])| size.z >= *high && size.x.max(size.y) >= *long)
}

/// Frame and floors in which boxes are computed.
pub(crate) struct World<'a> {
    pub(crate) view: &'a MapView,
    pub(crate) levels: &'a BTreeMap<SubmapId, Floor>,
}

/// Classes that stand on the floor; their feet are mostly occluded, or too thin to be seen.
const ON_FLOOR: [&str; 9] = [
    "bench",
    "chair",
    "couch",
    "bed",
    "dining table",
    "toilet",
    "oven",
    "refrigerator",
    "suitcase",
];
pub(crate) fn stands(class: ClassId) -> bool {
    ON_FLOOR.contains(&class.name())
}

/// Maximum height of the lowest visible part of such an object, m.
const HIGHEST_FOOT: f64 = 0.9;

const STEP: f64 = 0.02;

/// The height of a table's top, which has most of its points; items on it are not part of it.
fn top(points: &[Vec3], level: &Mat3) -> f64 {
    let mut counts: BTreeMap<i64, usize> = BTreeMap::new();
    for p in points {
        let step = ((level * p).z / STEP).floor() as i64;
        // Noise spreads over the neighbours.
        (-1..=1).for_each(|d| *counts.entry(step + d).or_default() += 1);
    }
    let most = counts.iter().max_by_key(|c| c.1);
    most.map_or(f64::INFINITY, |(step, _)| (*step as f64 + 2.0) * STEP)
}

/// Thickness below a table's top that belongs to its board, m.
const BOARD: f64 = 0.1;
/// Side of the columns in which upright surfaces are detected, m.
const COLUMN: f64 = 0.1;

/// The points of a table's board. Columns with mostly other points are excluded: a wall or a chair beside it.
fn board(points: &[Vec3], level: &Mat3, top: f64) -> Vec<Vec3> {
    let column = |p: &Vec3| {
        let local = level * p;
        [local.x, local.y].map(|v| (v / COLUMN).floor() as i32)
    };
    let on = |p: &Vec3| (top - BOARD..=top).contains(&(level * p).z);
    let mut counts: BTreeMap<[i32; 2], [usize; 2]> = BTreeMap::new();
    for p in points {
        counts.entry(column(p)).or_default()[usize::from(on(p))] += 1;
    }
    let flat = |p: &Vec3| counts.get(&column(p)).is_some_and(|c| c[0] <= c[1]);
    let own = points.iter().filter(|p| on(p) && flat(p));
    own.copied().collect()
}

impl World<'_> {
    pub(crate) fn bounds(
        &self,
        class: ClassId,
        submap: SubmapId,
        points: &[Vec3],
    ) -> Option<UprightBox> {
        let floor = self.levels.get(&submap);
        // Without a floor, as if the camera had been held upright at first.
        let upright = Floor {
            up: -Vec3::y(),
            offset: 0.0,
        };
        let level = floor.unwrap_or(&upright).level_from_world();
        let top = (class.name() == "dining table").then(|| top(points, &level));
        let points = match top {
            Some(top) => board(points, &level, top),
            None => points.to_vec(),
        };
        let bounds = UprightBox::around(&points, &level)?;
        Some(match floor {
            Some(floor) if stands(class) => bounds.on_floor(floor, HIGHEST_FOOT),
            _ => bounds,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A desk of 1.6 x 0.8 m at a wall that was seen half a metre farther along.
    #[test]
    fn wall_beside_a_table_is_excluded() {
        let grid = |n: i32| (0..=n).map(|i| 0.04 * f64::from(i));
        let mut points = Vec::new();
        for x in grid(40) {
            points.extend(grid(20).map(|y| Vec3::new(x, y, 0.73)));
        }
        let desk = points.clone();
        for x in grid(12) {
            points.extend(grid(18).map(|z| Vec3::new(1.7 + x, 0.8, z)));
        }
        let levels = BTreeMap::from([(
            SubmapId(0),
            Floor {
                up: Vec3::z(),
                offset: 0.0,
            },
        )]);
        let view = MapView::default();
        let world = World {
            view: &view,
            levels: &levels,
        };
        let bounds = |class: &str, points: &[Vec3]| {
            let class = ClassId::from_name(class).unwrap();
            world.bounds(class, SubmapId(0), points).unwrap()
        };
        let (alone, with) = (
            bounds("dining table", &desk),
            bounds("dining table", &points),
        );
        assert!((alone.centre - with.centre).norm() < 0.03, "{with:?}");
        assert!((with.size.z - 0.73).abs() < 0.02, "{with:?}");
        // Control: for a couch the wall would be included.
        assert!(bounds("couch", &points).longest() > alone.longest() + 0.4);
    }

    #[test]
    fn table_leg_is_too_small_to_be_a_table() {
        let can = |class: &str, size: [f64; 3]| {
            let bounds = UprightBox {
                centre: Vec3::zeros(),
                size: Vec3::from(size),
                world_from_box: Mat3::identity(),
            };
            can_be(ClassId::from_name(class).unwrap(), &bounds)
        };
        assert!(!can("dining table", [0.07, 0.05, 0.19]));
        assert!(can("dining table", [0.07, 0.5, 0.74]));
        assert!(can("cup", [0.07, 0.05, 0.1]));
    }
}
