//! Objects that hide each other: whose surface it is that a box shows.

use super::ObjectId;
use super::depth::DepthMode;
use super::duplicates::SAME_DEPTH;
use super::measurement::Measurement;
use super::track::{Expected, Track};
use crate::BoundingBox;

/// A side is cut by somebody who covers this share of it.
const COVERED: f64 = 0.5;

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

    /// Those whose boxes meet that of a detection: no others hide anything of what it shows.
    pub(super) fn around(&self, m: &Measurement) -> Self {
        let b = &m.detection.bounds;
        let meets = |o: &&Occupant| {
            let o = &o.bounds;
            o.x0 < b.x1 && b.x0 < o.x1 && o.y0 < b.y1 && b.y0 < o.y1
        };
        Self(self.0.iter().filter(meets).copied().collect())
    }

    /// The detection as one of this track: without the surfaces of others who stand before it, and with the sides that they cut.
    pub(super) fn seen_of(
        &self,
        track: &Track,
        expected: &Expected,
        m: &Measurement,
    ) -> Measurement {
        Measurement {
            modes: self.surfaces(track, expected, m),
            cut: self.cuts(track, expected, m),
            detection: m.detection,
            sides: m.sides,
        }
    }

    /// Which sides of a detection are not those of the thing: what is at the border of the image goes on beyond it, and so does what ends in the box of somebody who
    /// stands before it.
    fn cuts(&self, track: &Track, expected: &Expected, m: &Measurement) -> [bool; 4] {
        let mut cut = m.cut;
        let Some(own) = expected.depth() else {
            return cut;
        };
        let b = m.detection.bounds;
        let before = |o: &&Occupant| o.id != track.id && o.z < own - SAME_DEPTH;
        for o in self.0.iter().filter(before) {
            let across = covered([b.y0, b.y1], [o.bounds.y0, o.bounds.y1]) >= COVERED;
            let along = covered([b.x0, b.x1], [o.bounds.x0, o.bounds.x1]) >= COVERED;
            let inside = |x: f64, from: f64, to: f64| x > from && x < to;
            cut[0] |= across && inside(b.x0, o.bounds.x0, o.bounds.x1);
            cut[2] |= across && inside(b.x1, o.bounds.x0, o.bounds.x1);
            cut[1] |= along && inside(b.y0, o.bounds.y0, o.bounds.y1);
            cut[3] |= along && inside(b.y1, o.bounds.y0, o.bounds.y1);
        }
        cut
    }

    /// The surfaces in a detection's box that may be those of an object: without the ones of others that stand before it. None may be left, when
    /// others cover the middle of the box: then the detection says nothing about depth, rather than something wrong.
    fn surfaces(&self, track: &Track, expected: &Expected, m: &Measurement) -> Vec<DepthMode> {
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

/// Share of a range that another covers.
fn covered([from, to]: [f64; 2], [start, end]: [f64; 2]) -> f64 {
    (to.min(end) - from.max(start)).max(0.0) / (to - from).max(1.0)
}
