//! What is known of a thing: points that hang on keyframes.

use super::upright::UprightBox;
use super::{Thing, carve};
use crate::floor::Floor;
use std::collections::BTreeMap;
use stillpoint_detection::ClassId;
use stillpoint_geometry::{Mat3, Vec3};
use stillpoint_map::{KeyframeId, MapView, SubmapId};

/// Points that are kept of a thing: enough for 2 % at each end to be some.
pub(crate) const MOST_POINTS: usize = 384;
/// Values per metre of a point.
const PER_METRE: f64 = 1000.0;

/// A point of a surface in the camera of a keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Point {
    pub(crate) keyframe: KeyframeId,
    /// mm.
    pub(crate) at: [i16; 3],
}

impl Point {
    /// None where it is more than 32 m away.
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

    /// None where the map does not have its keyframe.
    pub(crate) fn world(self, view: &MapView) -> Option<Vec3> {
        let pose = view.world_from_keyframe(self.keyframe)?;
        Some(pose.transform(&self.in_keyframe()))
    }
}

/// What is known of a thing, wherever the map has its keyframes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Record {
    pub(crate) class: ClassId,
    /// Looks in which it was found.
    pub(crate) found: u32,
    /// Looks in which it could have been found.
    pub(crate) expected: u32,
    /// Stamps of the first and the last look in which it was found, s.
    pub(crate) seen: [f64; 2],
    /// The largest depth at which it was found, m.
    pub(crate) farthest: f64,
    pub(crate) points: Vec<Point>,
}

impl Record {
    /// Share of the looks in which it was found, as after two more in which it was not.
    pub(crate) fn confidence(&self) -> f64 {
        f64::from(self.found) / (f64::from(self.found.max(self.expected)) + 2.0)
    }

    /// The submap of most of its keyframes, and its points there, world; none where the map has none of them.
    pub(crate) fn place(&self, view: &MapView) -> Option<(SubmapId, Vec<Vec3>)> {
        let placed = |p: &Point| Some((view.submap_of(p.keyframe)?, p.world(view)?));
        let placed: Vec<(SubmapId, Vec3)> = self.points.iter().filter_map(placed).collect();
        let mut counts: BTreeMap<SubmapId, usize> = BTreeMap::new();
        for (submap, _) in &placed {
            *counts.entry(*submap).or_default() += 1;
        }
        // Of equals the last, which is as good as any.
        let submap = *counts.iter().max_by_key(|c| c.1)?.0;
        let own = placed.into_iter().filter(|p| p.0 == submap);
        Some((submap, own.map(|p| p.1).collect()))
    }

    pub(crate) fn thing(&self, world: &World<'_>) -> Option<Thing> {
        let (submap, points) = self.place(world.view)?;
        Some(Thing {
            class: self.class,
            bounds: world.bounds(self.class, submap, &points)?,
            room: None,
            confidence: self.confidence(),
            found: self.found,
            submap,
            first_seen: self.seen[0],
            last_seen: self.seen[1],
        })
    }

    /// Lets points go where there are too many, evenly in space.
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

/// What boxes are drawn in.
pub(crate) struct World<'a> {
    pub(crate) view: &'a MapView,
    pub(crate) levels: &'a BTreeMap<SubmapId, Floor>,
}

/// Classes of things that stand on the floor: mostly their feet are hidden, or too thin to be seen.
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
/// Whether things of a class stand on the floor.
pub(crate) fn stands(class: ClassId) -> bool {
    ON_FLOOR.contains(&class.name())
}

/// They are seen from this height on, at most, m.
const HIGHEST_FOOT: f64 = 0.9;

/// Heights are counted in steps of this, m.
const STEP: f64 = 0.02;

/// The height of a table's top, which is where most of its points are: what lies on it is no part of it.
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

impl World<'_> {
    /// The box around the points of a thing.
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
        let below = |p: &&Vec3| top.is_none_or(|z| (level * *p).z <= z);
        let points: Vec<Vec3> = points.iter().filter(below).copied().collect();
        let bounds = UprightBox::around(&points, &level)?;
        Some(match floor {
            Some(floor) if stands(class) => bounds.on_floor(floor, HIGHEST_FOOT),
            _ => bounds,
        })
    }
}
