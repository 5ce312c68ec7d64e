//! Memory and re-identification of objects out of sight.

use super::ObjectId;
use super::common::LOOKS;
use super::duplicates::SAME_DEPTH;
use super::kind::liveliness;
use super::rigidity::Rigidity;
use super::spatial::WALK;
use super::track::{Body, Track};
use crate::ClassId;
use stillpoint_geometry::Vec3;

/// Time for which an object out of sight is remembered, s: about as long as people stay behind others or outside of the
/// view (section 14 of docs/algorithm.md).
const REMEMBERED: f64 = 5.0;
/// Distance for re-identification at once, m: a step (0.7 m, 1.4 m/s at two a second), and the error of both positions
/// while others hide a part. Measured: 0.9 is no different.
pub(super) const NEAR: f64 = 0.8;
/// Distance equivalent of each second out of sight, when objects are compared, m. Measured: without it MOTA of
/// simulated people is 0.005 less.
const AGE: f64 = 0.2;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lost {
    id: ObjectId,
    class: ClassId,
    position: Vec3,
    velocity: Vec3,
    last_seen: f64,
    /// Whether it was certainly an object.
    sure: bool,
    rigidity: Rigidity,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Memory(Vec<Lost>);

impl Memory {
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Remembers a track that ends. Tracks without depth, and unreported ones, are not.
    pub(super) fn keep(&mut self, track: &Track) {
        self.0.extend(Lost::of(track));
    }

    pub(super) fn age(&mut self, stamp: f64) {
        self.0.retain(|l| stamp - l.last_seen <= REMEMBERED);
    }

    /// Gives confirmed new tracks the ids of the nearest objects that are out of sight, or missing in the newest
    /// detections, if near enough. Reported tracks without such an object are new objects. The track that had the id
    /// before ends.
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
        // By ascending distance, so that two people returning together are not exchanged.
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

    /// Whether a track is a thing at this object's position: it has probably been static in between.
    fn is_where(&self, track: &Track) -> bool {
        let thing = liveliness(self.class) < 1.0;
        matches!(&track.body, Body::Spatial(s) if thing && (s.position() - self.position).norm() <= SAME_DEPTH)
    }

    /// Distance of a track from this object, m, plus a penalty for time; `None` if it cannot be the object.
    fn distance(&self, track: &Track) -> Option<f64> {
        let Body::Spatial(s) = &track.body else {
            return None;
        };
        let position = s.position();
        let gap = track.born - self.last_seen;
        let reach = NEAR + WALK * gap.clamp(0.0, 1.0);
        // Old or extrapolated position: people stop and turn round as often as not.
        let ahead = self.position + self.velocity * gap.clamp(0.0, 1.0);
        let d = (position - self.position)
            .norm()
            .min((position - ahead).norm());
        let possible = self.class == track.class && gap > 0.0 && d <= reach;
        possible.then_some(d + AGE * gap)
    }
}
