//! Objects that are out of sight, and who of them is back.

use super::ObjectId;
use super::common::LOOKS;
use super::duplicates::SAME_DEPTH;
use super::kind::liveliness;
use super::rigidity::Rigidity;
use super::spatial::WALK;
use super::track::{Body, Track};
use crate::ClassId;
use stillpoint_geometry::Vec3;

/// Time for which an object out of sight is remembered, s: about as long as people stay behind others or outside of the view (section 14 of docs/algorithm.md).
const REMEMBERED: f64 = 5.0;
/// Distance within which an object is the same one at once, m: a step (0.7 m, 1.4 m/s at two a second), and the error of both positions while others hide a part. Measured: 0.9 is no different.
pub(super) const NEAR: f64 = 0.8;
/// Distance that each second out of sight counts for when objects are compared, m. Measured: without it MOTA of simulated people is 0.005 less.
const AGE: f64 = 0.2;

/// An object that is out of sight.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lost {
    id: ObjectId,
    class: ClassId,
    position: Vec3,
    velocity: Vec3,
    last_seen: f64,
    /// Whether it was sure to be one.
    sure: bool,
    rigidity: Rigidity,
}

/// Those that are out of sight.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Memory(Vec<Lost>);

impl Memory {
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Remembers a track that ends. Those without depth, and those that never were reported, are not known again.
    pub(super) fn keep(&mut self, track: &Track) {
        self.0.extend(Lost::of(track));
    }

    /// Forgets those that have been away for too long.
    pub(super) fn age(&mut self, stamp: f64) {
        self.0.retain(|l| stamp - l.last_seen <= REMEMBERED);
    }

    /// Gives tracks that were seen twice the numbers of the objects that they continue: of those that are out of sight, or were not in the newest
    /// detections, and near enough, the nearest. What is sure to be an object and continues none is a new one. The track that had the number before ends.
    pub(super) fn recognise(&mut self, tracks: &mut Vec<Track>) {
        let mut known: Vec<Lost> = self.0.clone();
        let missed = tracks.iter().filter(|t| t.misses > LOOKS);
        known.extend(missed.filter_map(Lost::of));
        let mut pairs: Vec<(f64, usize, ObjectId)> = Vec::new();
        for (n, track) in tracks.iter_mut().enumerate() {
            if !track.known && track.confirmed() && track.misses == 0 {
                let near = known.iter();
                pairs.extend(near.filter_map(|l| Some((l.distance(track)?, n, l.id))));
                track.known = track.reported();
            }
        }
        // The nearest pair first: two who come back at once are not exchanged.
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut given = vec![false; tracks.len()];
        for (_, n, id) in pairs {
            let Some(place) = known.iter().position(|l| l.id == id).filter(|_| !given[n]) else {
                continue;
            };
            given[n] = true;
            let lost = known.swap_remove(place);
            self.0.retain(|l| l.id != id);
            if let Some(old) = tracks.iter_mut().find(|t| t.id == id) {
                old.replaced = true;
            }
            if lost.is_where(&tracks[n]) {
                tracks[n].rigidity = lost.rigidity;
            }
            tracks[n].return_as(id, lost.sure);
        }
        tracks.retain(|t| !t.replaced);
        tracks.sort_by_key(|t| t.id);
    }
}

impl Lost {
    fn of(track: &Track) -> Option<Self> {
        let Body::Spatial(s) = &track.body else {
            return None;
        };
        track.reported().then(|| Self {
            id: track.id,
            class: track.class,
            position: track.seen_at.unwrap_or_else(|| s.position()),
            velocity: s.velocity(),
            last_seen: track.last_seen,
            sure: track.votes.sure(),
            rigidity: track.rigidity.clone(),
        })
    }

    /// Whether a track is of a thing that stands where this one was: it has been still all the time, as far as that was known.
    fn is_where(&self, track: &Track) -> bool {
        let thing = liveliness(self.class) < 1.0;
        matches!(&track.body, Body::Spatial(s) if thing && (s.position() - self.position).norm() <= SAME_DEPTH)
    }

    /// How far a track is from being this object, m; `None` when it is not. Time counts as distance: of two it is the one that was seen last.
    fn distance(&self, track: &Track) -> Option<f64> {
        let Body::Spatial(s) = &track.body else {
            return None;
        };
        let position = s.position();
        let gap = track.born - self.last_seen;
        let reach = NEAR + WALK * gap.clamp(0.0, 1.0);
        // Where it was, or where it was going: people stop and turn round as often as not.
        let ahead = self.position + self.velocity * gap.clamp(0.0, 1.0);
        let d = (position - self.position)
            .norm()
            .min((position - ahead).norm());
        let possible = self.class == track.class && gap > 0.0 && d <= reach;
        possible.then_some(d + AGE * gap)
    }
}
