//! Which tracks are one thing.

use super::part::{Point, Record, World};
use super::rest::is_rest;
use super::upright::UprightBox;
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;
use stillpoint_map::SubmapId;

/// What one or more tracks, or an earlier run, saw of a thing.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    /// Sum of the scores by class: it is of the class with the largest one.
    pub(crate) votes: BTreeMap<ClassId, f64>,
    /// Numbers of the looks in which it was found.
    pub(crate) looks: BTreeSet<usize>,
    /// Numbers of those that show it, whether or not it was found.
    pub(crate) shown: BTreeSet<usize>,
    /// What an earlier run knew, as it stands in the map file.
    pub(crate) known: Vec<Record>,
    /// The map files that it was in: what one file tells apart stays apart.
    pub(crate) files: BTreeSet<u8>,
    pub(crate) submap: SubmapId,
    pub(crate) points: Vec<(Point, Vec3)>,
    pub(crate) bounds: UprightBox,
    /// Stamps of the first and the last look, s.
    pub(crate) seen: [f64; 2],
    /// The largest depth at which it was found, m.
    pub(crate) farthest: f64,
}

/// Boxes are this uncertain, m.
const MARGIN: f64 = 0.05;
/// Share of the points of one thing in the box of the other one from which they are one thing.
const SHARE: f64 = 0.5;
/// The same where a detector called them by different names.
const SHARE_BY_OTHER_NAME: f64 = 0.75;
/// Two tracks that were found in so many looks together are two things.
const TOGETHER: usize = 3;
/// Of small things, middles this near are one, as a share of their longest side: what is seen again after a walk is off by what the poses are.
const NEAR: f64 = 0.5;

/// How surely another piece of a thing is of it.
const REST: f64 = 0.5;

impl Part {
    /// Votes of the class that it is of.
    pub(crate) fn class(&self) -> ClassId {
        let best = self.votes.iter().max_by(|a, b| {
            // Of equals the smaller number.
            a.1.total_cmp(b.1).then(b.0.0.cmp(&a.0.0))
        });
        best.map_or(ClassId(u8::MAX), |v| *v.0)
    }

    /// Looks in which it was found, with those of earlier runs.
    pub(crate) fn found(&self) -> u32 {
        self.looks.len() as u32 + self.known.iter().map(|r| r.found).sum::<u32>()
    }

    fn share_in(&self, other: &UprightBox) -> f64 {
        let inside = |p: &&(Point, Vec3)| other.contains(&p.1, MARGIN);
        self.points.iter().filter(inside).count() as f64 / self.points.len().max(1) as f64
    }

    /// How surely another part is the same thing: 0 where it is not.
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
            // A cup is in the box of the table and is no table: both have to be in each other.
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

/// Puts together what is one thing; those that were found most often come first.
pub(crate) fn merge(mut parts: Vec<Part>, world: &World<'_>) -> Vec<Part> {
    // Stable: of equals the one that was seen first.
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
        // What has grown may be one with another by now.
        parts = things;
    }
}
