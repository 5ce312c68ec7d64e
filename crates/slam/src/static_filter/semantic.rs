//! O: objects of classes that move, as regions of the image with a range of depth.

use stillpoint_detection::{BoundingBox, Motion, MotionWeights, Object, ObjectId, ObjectState};

/// Classes of at least this weight move by themselves; lighter things count when they were measured to move.
pub(super) const MOVER: f64 = 4.0;
/// Log odds of "moving" that a detector's word for a mover is worth.
const SEEN: f32 = 2.5;
/// The same at the end of coasting.
const COASTED: f32 = 1.0;

/// An object as the filter sees it.
#[derive(Clone, Debug)]
pub(super) struct Mover {
    pub(super) id: ObjectId,
    pub(super) bounds: BoundingBox,
    /// Nearest and farthest depth of its surface, m; none when it is not known.
    pub(super) range: Option<[f32; 2]>,
    /// Motion weight of its class, 0 to 5.
    pub(super) weight: f64,
    /// Log odds of "moving" that it lends to what it holds; 0 for things that only may move.
    pub(super) strength: f32,
}

impl Mover {
    /// Whether the object reaches to a raw pixel at depth `z` (m; 0: unknown, then the box decides).
    pub(super) fn holds(&self, u: f64, v: f64, z: f32) -> bool {
        self.bounds.contains(u, v)
            && (z <= 0.0 || self.range.is_none_or(|[near, far]| near <= z && z <= far))
    }

    /// Log odds of "moving" that the object lends to a surface at a raw pixel and depth `z` (m): most in the middle of the
    /// box, where the object is; its corners hold what stands around it.
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

/// The objects of classes that may move, as expected at `stamp`.
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
            ObjectState::Coasting => SEEN + (COASTED - SEEN) * faded,
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
