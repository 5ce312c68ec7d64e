//! Merges tracks of the same object.

use super::part::{Point, Record, World};
use super::rest::is_rest;
use super::upright::UprightBox;
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;
use stillpoint_map::SubmapId;

/// Observations of an object by one or more tracks, or by an earlier run.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    /// Sum of the scores by class; the largest one decides.
    pub(crate) votes: BTreeMap<ClassId, f64>,
    /// Indices of the views in which it was detected.
    pub(crate) looks: BTreeSet<usize>,
    /// Indices of the views in which it is visible, detected or not.
    pub(crate) shown: BTreeSet<usize>,
    pub(crate) known: Vec<Record>,
    /// The map files that it was in: objects of one file are never merged.
    pub(crate) files: BTreeSet<u8>,
    pub(crate) submap: SubmapId,
    pub(crate) points: Vec<(Point, Vec3)>,
    pub(crate) bounds: UprightBox,
    pub(crate) seen: [f64; 2],
    /// Maximum depth at which it was detected, m.
    pub(crate) farthest: f64,
}

/// Uncertainty of boxes, m.
const MARGIN: f64 = 0.05;
/// Share of one object's points in the box of the other from which both are merged.
const SHARE: f64 = 0.5;
/// That share for different class names.
const SHARE_BY_OTHER_NAME: f64 = 0.75;
/// Number of common detections from which two tracks are different objects.
const TOGETHER: usize = 3;
/// Maximum distance of the centres of small objects for merging, as a share of their longest side: revisited objects are off by the drift
/// of the poses.
const NEAR: f64 = 0.5;

/// Likeness of a detached part of an object.
const REST: f64 = 0.5;

impl Part {
    pub(crate) fn class(&self) -> ClassId {
        let best = self.votes.iter().max_by(|a, b| {
            // Ties take the smaller id.
            a.1.total_cmp(b.1).then(b.0.0.cmp(&a.0.0))
        });
        best.map_or(ClassId(u8::MAX), |v| *v.0)
    }

    /// Number of views with a detection, earlier runs included.
    pub(crate) fn found(&self) -> u32 {
        self.looks.len() as u32 + self.known.iter().map(|r| r.found).sum::<u32>()
    }

    fn share_in(&self, other: &UprightBox) -> f64 {
        let inside = |p: &&(Point, Vec3)| other.contains(&p.1, MARGIN);
        self.points.iter().filter(inside).count() as f64 / self.points.len().max(1) as f64
    }

    /// Likeness of another part: 0 if it is not the same object.
    fn likeness(&self, other: &Self) -> f64 {
        let together = self.looks.intersection(&other.looks).count();
        let told_apart = self.files.intersection(&other.files).next().is_some();
        if self.submap != other.submap || together >= TOGETHER || told_apart {
            return 0.0;
        }
        let apart = (self.bounds.centre - other.bounds.centre).norm();
        let (a, b) = (self.bounds.longest(), other.bounds.longest());
        if apart > 0.5 * (a + b) + MARGIN {
            return 0.0;
        }
        let share = self
            .share_in(&other.bounds)
            .max(other.share_in(&self.bounds));
        let both = self
            .share_in(&other.bounds)
            .min(other.share_in(&self.bounds));
        let same = self.class() == other.class();
        let near = same && apart < NEAR * a.min(b);
        match (same, near) {
            (true, _) if share >= SHARE => 1.0 + share,
            (true, true) => 1.0,
            (true, false) if is_rest(self, other) => REST,
            // A cup is in the box of the table and is not the table: both must contain each other.
            (false, _) if both >= SHARE_BY_OTHER_NAME => both,
            _ => 0.0,
        }
    }

    fn absorb(&mut self, other: Self, world: &World<'_>) {
        for (class, vote) in other.votes {
            *self.votes.entry(class).or_default() += vote;
        }
        self.looks.extend(other.looks);
        self.shown.extend(other.shown);
        self.known.extend(other.known);
        self.files.extend(other.files);
        self.points.extend(other.points);
        self.seen = [
            self.seen[0].min(other.seen[0]),
            self.seen[1].max(other.seen[1]),
        ];
        self.farthest = self.farthest.max(other.farthest);
        let points: Vec<Vec3> = self.points.iter().map(|p| p.1).collect();
        if let Some(bounds) = world.bounds(self.class(), self.submap, &points) {
            self.bounds = bounds;
        }
    }
}

pub(crate) fn merge(mut parts: Vec<Part>, world: &World<'_>) -> Vec<Part> {
    // The stable sort keeps ties in the order of first detection.
    parts.sort_by_key(|p| std::cmp::Reverse(p.found()));
    loop {
        let mut things: Vec<Part> = Vec::new();
        let before = parts.len();
        for part in parts {
            let likeness: Vec<f64> = things.iter().map(|t| t.likeness(&part)).collect();
            let best = (0..things.len()).max_by(|a, b| {
                let order = likeness[*a].total_cmp(&likeness[*b]);
                order.then(b.cmp(a))
            });
            match best.filter(|b| likeness[*b] > 0.0) {
                Some(best) => things[best].absorb(part, world),
                None => things.push(part),
            }
        }
        if things.len() == before {
            return things;
        }
        // Grown objects may match others.
        parts = things;
    }
}
