//! Objects that hide each other: whose surface it is that a box shows.

use super::ObjectId;
use super::depth::DepthMode;
use super::duplicates::SAME_DEPTH;
use super::measurement::Measurement;
use super::track::Track;
use super::view::View;
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
    pub(super) fn new(tracks: &[Track], view: &View) -> Self {
        let occupant = |t: &Track| {
            t.depth(view).map(|z| Occupant {
                id: t.id,
                bounds: t.bounds(view),
                z,
            })
        };
        Self(
            tracks
                .iter()
                .filter(|t| t.confirmed())
                .filter_map(occupant)
                .collect(),
        )
    }

    /// The surfaces in a detection's box that may be those of an object: without the ones of others that stand before it. None may be left, when
    /// others cover the middle of the box: then the detection says nothing about depth, rather than something wrong.
    pub(super) fn surfaces(&self, track: &Track, view: &View, m: &Measurement) -> Vec<DepthMode> {
        let Some(own) = track.depth(view) else {
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
