//! Objects that hide each other: whose surface it is that a box shows.

use super::ObjectId;
use super::depth::DepthMode;
use super::duplicates::SAME_DEPTH;
use super::measurement::Measurement;
use super::track::{Expected, Track};
use crate::BoundingBox;

/// A confirmed object before an update.
#[derive(Clone, Copy, Debug)]
struct Occupant {
    id: ObjectId,
    bounds: BoundingBox,
    /// Depth, m.
    z: f64,
}

/// Where the confirmed objects are expected.
#[derive(Clone, Debug)]
pub(super) struct Occlusion(Vec<Occupant>);

impl Occlusion {
    pub(super) fn new(tracks: &[Track], expected: &[Expected]) -> Self {
        let occupant = |(t, e): (&Track, &Expected)| {
            e.depth().map(|z| Occupant {
                id: t.id,
                bounds: e.bounds,
                z,
            })
        };
        let confirmed = tracks.iter().zip(expected).filter(|(t, _)| t.confirmed());
        Self(confirmed.filter_map(occupant).collect())
    }

    /// The surfaces in a detection's box that may be those of an object: without the ones of others that stand before it. None may be left, when
    /// others cover the middle of the box: then the detection says nothing about depth, rather than something wrong.
    pub(super) fn surfaces(
        &self,
        track: &Track,
        expected: &Expected,
        m: &Measurement,
    ) -> Vec<DepthMode> {
        let Some(own) = expected.depth() else {
            return m.modes.clone();
        };
        let theirs = |mode: &DepthMode| {
            self.0.iter().any(|o| {
                o.id != track.id
                    && o.z < own - SAME_DEPTH
                    && (o.z - mode.depth).abs() <= SAME_DEPTH
                    && o.bounds.iou(&m.detection.bounds) > 0.0
            })
        };
        m.modes
            .iter()
            .filter(|mode| !theirs(mode))
            .copied()
            .collect()
    }
}
