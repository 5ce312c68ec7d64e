//! Occlusion between objects: attribution of the surfaces in a box.

use super::ObjectId;
use super::common::{HALF, MUCH, PART};
use super::depth::{DepthMode, modes};
use super::duplicates::SAME_DEPTH;
use super::expected::Expected;
use super::kind::liveliness;
use super::measurement::{Measurement, Plumb};
use super::profile::{Profile, middle_column};
use super::track::Track;
use super::view::View;
use crate::BoundingBox;
use stillpoint_geometry::Vec2;
use stillpoint_imaging::CoarseDepth;

/// Minimum visible share of a person in the person's own box, regardless of occluders. Measured: 0.05 is alike.
const SHOWN: f64 = 0.1;
/// Upper part of a box in which a person's middle is measured, a share: legs swing (section 14 of docs/algorithm.md).
const TRUNK: f64 = 0.6;

#[derive(Clone, Copy, Debug)]
struct Occupant {
    id: ObjectId,
    bounds: BoundingBox,
    /// Depth and its standard deviation, m.
    z: [f64; 2],
    reported: bool,
}

impl Occupant {
    fn of(track: &Track, expected: &Expected) -> Option<Self> {
        Some(Self {
            id: track.id,
            bounds: expected.bounds,
            z: [expected.depth()?, expected.depth_sigma],
            reported: track.reported(),
        })
    }

    /// Depth range of its surface, m.
    fn range(&self) -> [f64; 2] {
        let [z, sigma] = self.z;
        let reach = SAME_DEPTH + sigma.min(SAME_DEPTH);
        [z - reach, z + reach]
    }

    fn covers(&self, b: &BoundingBox) -> bool {
        let (x, y) = (
            [self.bounds.x0, self.bounds.x1],
            [self.bounds.y0, self.bounds.y1],
        );
        covered([b.x0, b.x1], x) * covered([b.y0, b.y1], y) >= PART
    }

    /// The larger part of a box beside it.
    fn beside(&self, b: &BoundingBox) -> BoundingBox {
        let left = BoundingBox {
            x1: b.x1.min(self.bounds.x0),
            ..*b
        };
        let right = BoundingBox {
            x0: b.x0.max(self.bounds.x1),
            ..*b
        };
        if left.width() >= right.width() {
            left
        } else {
            right
        }
    }

    fn before(&self, z: f64) -> bool {
        self.z[0] < z - SAME_DEPTH
    }
}

#[derive(Clone, Debug)]
pub(super) struct Occlusion(Vec<Occupant>);

impl Occlusion {
    pub(super) fn new(tracks: &[Track], expected: &[Expected]) -> Self {
        let confirmed = tracks.iter().zip(expected).filter(|(t, _)| t.confirmed());
        Self(confirmed.filter_map(|(t, e)| Occupant::of(t, e)).collect())
    }

    /// Content of a detection's box, and objects with overlapping boxes, the only possible occluders.
    pub(super) fn around(&self, m: &Measurement, depth: &CoarseDepth) -> Shown {
        let b = &m.detection.bounds;
        let meets = |o: &&Occupant| {
            let o = &o.bounds;
            o.x0 < b.x1 && b.x0 < o.x1 && o.y0 < b.y1 && b.y0 < o.y1
        };
        let occupants: Vec<Occupant> = self.0.iter().filter(meets).copied().collect();
        let lively = liveliness(m.detection.class) >= 1.0 && !m.modes.is_empty();
        let contested = lively && occupants.iter().filter(|o| o.reported).count() >= 2;
        Shown {
            profile: contested.then(|| Profile::new(depth, b)),
            occupants,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Shown {
    /// Confirmed objects predicted there.
    occupants: Vec<Occupant>,
    /// For a person's box that may contain several of them.
    profile: Option<Profile>,
}

impl Shown {
    /// Evidence of the depths in the box and beside it against this track: a box shows its own object, and ends where
    /// the object ends.
    pub(super) fn doubt(&self, track: &Track, expected: &Expected) -> f64 {
        let (Some(profile), Some(own)) = (&self.profile, Occupant::of(track, expected)) else {
            return 0.0;
        };
        let missing = (1.0 - profile.share(own.range()) / SHOWN).max(0.0);
        let goes_on = (profile.goes_on(own.range()) / MUCH).min(1.0);
        missing + goes_on
    }

    /// The vertical line through the middle of a person's visible surface; `None` unless the whole width is visible.
    /// The sides of a box follow the arms, the middle of the surface follows the trunk.
    pub(super) fn middle(
        track: &Track,
        expected: &Expected,
        m: &Measurement,
        depth: &CoarseDepth,
        view: &View,
    ) -> Option<Plumb> {
        if m.cut[0] || m.cut[2] || liveliness(track.class) < 1.0 {
            return None;
        }
        let b = m.detection.bounds;
        let upper = BoundingBox {
            y1: b.y0 + TRUNK * b.height(),
            ..b
        };
        let row = b.centre()[1];
        let lean = view.lean(Vec2::from(b.centre()));
        let range = Occupant::of(track, expected)?.range();
        let column = middle_column(depth, &upper, range, (row, lean))?;
        let through = view.camera.undistort(Vec2::new(column, row));
        Some(Plumb { through, lean })
    }

    /// The detection as a measurement of this track: without surfaces of occluders, and with sides cut by them.
    pub(super) fn seen_of(
        &self,
        track: &Track,
        expected: &Expected,
        m: &Measurement,
    ) -> Measurement {
        Measurement {
            modes: self.surfaces(track, expected, m),
            cut: self.cuts(track, expected, m),
            at_border: m.at_border,
            detection: m.detection,
            sides: m.sides,
            middle: None,
        }
    }

    /// The detection as a measurement of a new object: without its nearest surfaces if they belong to reported objects
    /// that cover a part of it, and are not visible in the rest. The box of a person emerging from behind another also
    /// shows the other; a second box of a reported person leaves hardly any rest.
    pub(super) fn seen_of_new(&self, m: &Measurement, depth: &CoarseDepth) -> Measurement {
        let b = &m.detection.bounds;
        let covering = |o: &&Occupant| o.reported && o.covers(b);
        let covering: Vec<&Occupant> = self.occupants.iter().filter(covering).collect();
        let rest = covering.iter().fold(*b, |rest, o| o.beside(&rest));
        if covering.is_empty() || rest.width() < MUCH * b.width() {
            return m.clone();
        }
        let own = modes(depth, &rest);
        if own.is_empty() {
            return m.clone();
        }
        let theirs = |mode: &DepthMode| {
            let seen = own
                .iter()
                .any(|o| (o.depth - mode.depth).abs() <= SAME_DEPTH);
            let at = |o: &&Occupant| (o.range()[0]..=o.range()[1]).contains(&mode.depth);
            !seen && covering.iter().any(at)
        };
        let shown: Vec<DepthMode> = m
            .modes
            .iter()
            .skip_while(|mode| theirs(mode))
            .copied()
            .collect();
        Measurement {
            modes: if shown.is_empty() { own } else { shown },
            ..m.clone()
        }
    }

    /// Sides of a detection beyond which the object extends: those at the image border, and those inside the box of an
    /// occluder.
    fn cuts(&self, track: &Track, expected: &Expected, m: &Measurement) -> [bool; 4] {
        let mut cut = m.cut;
        let Some(own) = expected.depth() else {
            return cut;
        };
        let b = m.detection.bounds;
        let before = |o: &&Occupant| o.id != track.id && o.before(own);
        for o in self.occupants.iter().filter(before) {
            let across = covered([b.y0, b.y1], [o.bounds.y0, o.bounds.y1]) >= HALF;
            let along = covered([b.x0, b.x1], [o.bounds.x0, o.bounds.x1]) >= HALF;
            let inside = |x: f64, from: f64, to: f64| x > from && x < to;
            cut[0] |= across && inside(b.x0, o.bounds.x0, o.bounds.x1);
            cut[2] |= across && inside(b.x1, o.bounds.x0, o.bounds.x1);
            cut[1] |= along && inside(b.y0, o.bounds.y0, o.bounds.y1);
            cut[3] |= along && inside(b.y1, o.bounds.y0, o.bounds.y1);
        }
        cut
    }

    /// The surfaces in a detection's box that may belong to the track: without those of occluders. None may be left,
    /// when others cover the middle of the box: then depth is not measured. A surface between two objects belongs to
    /// the nearer one in depth. Visible parts of a person beside them count, even if small.
    fn surfaces(&self, track: &Track, expected: &Expected, m: &Measurement) -> Vec<DepthMode> {
        let Some(own) = Occupant::of(track, expected) else {
            return m.modes.clone();
        };
        let before = |o: &&Occupant| o.id != track.id && o.before(own.z[0]);
        let others = self.occupants.iter().filter(before);
        let theirs = |mode: &DepthMode| {
            others.clone().any(|o| {
                let off = (o.z[0] - mode.depth).abs();
                let his = off <= SAME_DEPTH || off < (own.z[0] - mode.depth).abs();
                his && o.bounds.iou(&m.detection.bounds) > 0.0
            })
        };
        let rest = m.modes.iter().filter(|mode| !theirs(mode));
        let mut modes: Vec<DepthMode> = rest.copied().collect();
        let [near, far] = own.range();
        let shown = modes.iter().any(|m| (near..=far).contains(&m.depth));
        if let (Some(profile), false) = (&self.profile, shown) {
            let covering = others.clone().filter(|o| o.covers(&m.detection.bounds));
            let ends = covering.map(|o| o.z[0] + SAME_DEPTH);
            if let Some(end) = ends.reduce(f64::max) {
                modes.extend(profile.surface([near.max(end), far], SHOWN));
                modes.sort_by(|a, b| a.depth.total_cmp(&b.depth));
            }
        }
        modes
    }
}

/// Share of a range covered by another.
fn covered([from, to]: [f64; 2], [start, end]: [f64; 2]) -> f64 {
    (to.min(end) - from.max(start)).max(0.0) / (to - from).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objects::view::View;
    use crate::{ClassId, Detection};
    use stillpoint_geometry::Camera;
    use stillpoint_imaging::DepthImage;

    const BOX: BoundingBox = BoundingBox {
        x0: 200.0,
        y0: 80.0,
        x1: 400.0,
        y1: 400.0,
    };

    fn flat(z: f32) -> CoarseDepth {
        CoarseDepth::new(
            &DepthImage::from_vec(640, 480, vec![z; 640 * 480]).unwrap(),
            8,
        )
    }

    /// Surfaces attributed to a person 2.5 m away, in a box of one surface with another person 1 m away in front.
    fn left_for_the_farther(surface: f64) -> Vec<f64> {
        let camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
        let view = View::ahead(&camera);
        let detection = Detection {
            class: ClassId::PERSON,
            score: 0.8,
            bounds: BOX,
        };
        let measure = |z: f64| Measurement::new(&view, &detection, &flat(z as f32)).unwrap();
        let tracks = [(0, 1.0), (1, 2.5)].map(|(id, z)| {
            let mut track = Track::new(ObjectId(id), &view, &measure(z), 0.0, 0.1);
            track.hits = 5;
            track
        });
        let expected: Vec<Expected> = tracks.iter().map(|t| t.expected(&view)).collect();
        let m = measure(surface);
        let shown = Occlusion::new(&tracks, &expected).around(&m, &flat(surface as f32));
        let modes = shown.surfaces(&tracks[1], &expected[1], &m);
        modes.iter().map(|m| m.depth).collect()
    }

    /// Backs and outstretched arms are farther from a track's depth than a body is thick: they must not be attributed
    /// to a person far behind.
    #[test]
    fn intermediate_surface_belongs_to_the_nearer_person() {
        for theirs in [1.0, 1.2, 1.45, 1.7] {
            assert_eq!(left_for_the_farther(theirs), Vec::<f64>::new(), "{theirs}");
        }
        for own in [1.85, 2.2, 2.5, 3.5] {
            let left = left_for_the_farther(own);
            assert!(
                left.len() == 1 && (left[0] - own).abs() < 1e-3,
                "{own}: {left:?}"
            );
        }
    }
}
