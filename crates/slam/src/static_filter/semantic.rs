//! Part O: detected objects of moving classes, as image regions with a depth range.

use stillpoint_detection::{BoundingBox, Motion, MotionWeights, Object, ObjectId, ObjectState};
use stillpoint_imaging::CoarseDepth;

/// Minimum weight of classes that move by themselves; lighter ones count only if measured to move. Chosen: between the
/// person (5) and the chair (3) of the publication behind preset `paper` (doi:10.1007/s11554-024-01527-4).
pub const MOVER: f64 = 4.0;
/// Log odds of "moving" from the detection of a moving class: 12 to one. Chosen below the 4 of `SEEN_THROUGH`: a part
/// of every box is background.
const SEEN: f32 = 2.5;
/// Log odds at the end of coasting: 2.7 to one. Chosen: an object unseen for that time is still more likely there than
/// not.
const COASTED: f32 = 1.0;

#[derive(Clone, Debug)]
pub(super) struct Mover {
    pub(super) id: ObjectId,
    pub(super) bounds: BoundingBox,
    /// Nearest and farthest depth of its surface, m, if known.
    pub(super) range: Option<[f32; 2]>,
    /// Motion weight of its class, 0 to 5.
    pub(super) weight: f64,
    /// Log odds of "moving" for the surfaces it holds; 0 if it is not known to move.
    pub(super) strength: f32,
}

impl Mover {
    /// Whether a raw pixel at depth `z` (m; 0: unknown, then only the box counts) belongs to the object.
    pub(super) fn holds(&self, u: f64, v: f64, z: f32) -> bool {
        self.bounds.contains(u, v)
            && (z <= 0.0 || self.range.is_none_or(|[near, far]| near <= z && z <= far))
    }

    /// The cells that overlap the box, with their centres (raw px).
    pub(super) fn cells(&self, grid: &CoarseDepth) -> impl Iterator<Item = (usize, [f64; 2])> {
        let (size, b) = (grid.cell() as f64, &self.bounds);
        let range = |from: f64, to: f64, count: usize| {
            let first = ((from / size).max(0.0) as usize).min(count);
            let last = ((to / size).max(0.0) as usize + 1).min(count);
            first..last
        };
        let columns = range(b.x0, b.x1, grid.width());
        let width = grid.width();
        range(b.y0, b.y1, grid.height()).flat_map(move |y| {
            columns
                .clone()
                .map(move |x| (y * width + x, grid.centre(x, y)))
        })
    }

    /// Log odds of "moving" at a raw pixel and depth `z` (m): largest in the centre of the box; its corners usually
    /// show background.
    pub(super) fn odds(&self, u: f64, v: f64, z: f32) -> f32 {
        if self.strength <= 0.0 || !self.holds(u, v, z) {
            return 0.0;
        }
        let [x, y] = self.bounds.centre();
        let (a, b) = (
            2.0 * (u - x) / self.bounds.width(),
            2.0 * (v - y) / self.bounds.height(),
        );
        self.strength * ((1.0 - a * a) * (1.0 - b * b * b * b)).max(0.0) as f32
    }
}

/// The objects of classes that may move, as predicted at `stamp`.
pub(super) fn movers(
    objects: &[Object],
    weights: &MotionWeights,
    stamp: f64,
    coast: f64,
) -> Vec<Mover> {
    let mover = |o: &Object| {
        let weight = weights.get(o.class);
        let parked = o.motion == Motion::Parked;
        let moves = weight >= MOVER || o.motion == Motion::Moving;
        let faded = ((stamp - o.last_seen) / coast).clamp(0.0, 1.0) as f32;
        let strength = match o.state {
            _ if !moves || parked => 0.0,
            ObjectState::Coasting | ObjectState::Hidden => SEEN + (COASTED - SEEN) * faded,
            ObjectState::Tentative | ObjectState::Confirmed => SEEN,
        };
        Mover {
            id: o.id,
            bounds: o.bounds,
            range: o.depth_range.map(|r| r.map(|z| z as f32)),
            weight,
            strength,
        }
    };
    let visible = objects.iter().filter(|o| o.bounds.area() > 0.0);
    visible.map(mover).filter(|m| m.weight > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_detection::ClassId;

    const BOX: BoundingBox = BoundingBox {
        x0: 100.0,
        y0: 50.0,
        x1: 200.0,
        y1: 350.0,
    };

    fn object(class: &str) -> Object {
        Object {
            id: ObjectId(3),
            class: ClassId::from_name(class).unwrap(),
            score: 0.8,
            state: ObjectState::Confirmed,
            bounds: BOX,
            bounds_sigma: [4.0; 2],
            depth_range: Some([1.2, 1.8]),
            position: None,
            velocity: None,
            covariance: None,
            size: None,
            last_seen: 10.0,
            motion: Motion::Unknown,
        }
    }

    fn one(object: Object, stamp: f64) -> Option<Mover> {
        movers(&[object], &MotionWeights::default(), stamp, 1.0).pop()
    }

    fn strength(object: Object, stamp: f64) -> f32 {
        one(object, stamp).unwrap().strength
    }

    #[test]
    fn odds_peak_at_the_box_centre_and_vanish_outside() {
        let person = one(object("person"), 10.0).unwrap();
        let [x, y] = BOX.centre();
        let middle = person.odds(x, y, 1.5);
        assert!((middle - SEEN).abs() < 1e-6);
        let mut last = middle;
        for step in 1..=10 {
            let s = f64::from(step) / 10.0;
            let odds = person.odds(x + 49.9 * s, y + 149.9 * s, 1.5);
            assert!(odds < last && odds >= 0.0);
            last = odds;
        }
        // People are tall: head and feet get more than the sides.
        assert!(person.odds(x, y + 100.0, 1.5) > person.odds(x + 100.0 / 3.0, y, 1.5));
        for (u, v) in [(99.0, y), (201.0, y), (x, 49.0), (x, 351.0)] {
            assert!(!person.holds(u, v, 1.5));
            assert!(person.odds(u, v, 1.5).abs() < f32::EPSILON);
        }
    }

    #[test]
    fn object_contains_its_own_depth_range() {
        let mut person = one(object("person"), 10.0).unwrap();
        let [x, y] = BOX.centre();
        for (z, held) in [(1.1, false), (1.25, true), (1.75, true), (1.9, false)] {
            assert_eq!(person.holds(x, y, z), held);
            assert_eq!(person.odds(x, y, z) > 0.0, held);
        }
        // If either depth is unknown the box decides.
        assert!(person.holds(x, y, 0.0));
        person.range = None;
        assert!(person.holds(x, y, 7.0));
    }

    #[test]
    fn people_have_odds_unless_parked() {
        assert!(strength(object("person"), 10.0) > 0.0);
        let state = ObjectState::Tentative;
        let tentative = Object {
            state,
            ..object("person")
        };
        assert!(strength(tentative, 10.0) > 0.0);
        let motion = Motion::Parked;
        let parked = one(
            Object {
                motion,
                ..object("person")
            },
            10.0,
        )
        .unwrap();
        let [x, y] = BOX.centre();
        assert!(parked.odds(x, y, 1.5).abs() < f32::EPSILON);
        // It is still known: its features create no landmarks.
        assert!(parked.holds(x, y, 1.5) && parked.weight >= MOVER);
    }

    #[test]
    fn chairs_have_odds_only_when_moving_and_toilets_never() {
        assert!(strength(object("chair"), 10.0).abs() < f32::EPSILON);
        let motion = Motion::Moving;
        let pushed = Object {
            motion,
            ..object("chair")
        };
        assert!(strength(pushed, 10.0) > 0.0);
        let toilet = Object {
            motion,
            ..object("toilet")
        };
        assert!(one(toilet, 10.0).is_none());
    }

    #[test]
    fn odds_decay_only_while_coasting() {
        let coasting = Object {
            state: ObjectState::Coasting,
            ..object("person")
        };
        let mut last = strength(coasting.clone(), 10.0);
        assert!((last - SEEN).abs() < 1e-6);
        for step in 1..=4 {
            let next = strength(coasting.clone(), 10.0 + 0.25 * f64::from(step));
            assert!(next < last);
            last = next;
        }
        assert!((last - COASTED).abs() < 1e-6);
        assert!((strength(coasting, 99.0) - COASTED).abs() < 1e-6);
        assert!((strength(object("person"), 10.9) - SEEN).abs() < 1e-6);
    }

    #[test]
    fn objects_outside_the_image_are_dropped() {
        let gone = Object {
            bounds: BoundingBox { x1: BOX.x0, ..BOX },
            ..object("person")
        };
        assert!(one(gone, 10.0).is_none());
    }
}
