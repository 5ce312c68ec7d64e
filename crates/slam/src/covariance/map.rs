//! Covariance of the map itself: a keyframe inherits the error of its parent keyframe and adds its own.
//!
//! The first keyframe defines the origin and has no error. A pose that shares landmarks with it has only its own
//! measurement error. Farther away, landmarks were triangulated from uncertain poses, so errors accumulate from view to
//! view.

use super::moved;
use crate::least_first::Reached;
use crate::view_angle::view_angle;
use std::collections::{BTreeMap, BinaryHeap};
use stillpoint_geometry::nalgebra::ArrayStorage;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::{Keyframe, KeyframeId, KeyframeSlot, MapView};

/// Covariances of the keyframes of a map, updated from new keyframes and map versions.
#[derive(Clone, Debug, Default)]
pub struct MapCovariance {
    /// Covariance of each keyframe in the map around it, in camera axes.
    own: BTreeMap<KeyframeId, Mat6>,
    /// Error of each keyframe relative to the origin of the map or submap.
    drift: BTreeMap<KeyframeId, Drift>,
    /// Keyframes not yet part of a map version.
    waiting: Vec<KeyframeId>,
    /// Number of loops in the newest version.
    loops: usize,
}

/// Accumulated error between a keyframe and the first one of its map.
#[derive(Clone, Copy, Debug)]
struct Drift {
    /// Sum of view changes along the path, in fields of view.
    views: f64,
    /// Of a left perturbation of `world_from_camera`.
    covariance: Mat6,
}

impl Drift {
    const NONE: Self = Self {
        views: 0.0,
        covariance: Mat6::from_array_storage(ArrayStorage([[0.0; 6]; 6])),
    };

    /// The drift at the other end of a tie. The first field of view adds nothing; beyond it, each non-overlapping view
    /// adds the error of one pose.
    fn after(&self, tie: &Tie) -> Self {
        let views = self.views + tie.views;
        let new = views.max(1.0) - self.views.max(1.0);
        Self {
            views,
            covariance: self.covariance + tie.own * new,
        }
    }
}

struct Tie {
    ends: [KeyframeId; 2],
    /// Difference between their views, in fields of view.
    views: f64,
    /// Local covariance of the newer keyframe, for a left perturbation in the world.
    own: Mat6,
}

impl MapCovariance {
    /// Covariances of a whole map, from the local covariances of its keyframes.
    #[must_use]
    pub fn of(own: BTreeMap<KeyframeId, Mat6>, view: &MapView) -> Self {
        let mut map = Self {
            own,
            loops: view.loops().count(),
            ..Self::default()
        };
        map.drift = map.least(view);
        map
    }

    /// Records the local covariance of a frame that becomes a keyframe, in camera axes. Keyframes never recorded, such
    /// as those of a loaded map, count as exact.
    pub fn note(&mut self, keyframe: KeyframeId, in_map: Mat6) {
        self.own.insert(keyframe, in_map);
        self.waiting.push(keyframe);
    }

    /// Processes a version of the map. A new keyframe inherits the drift of its parent. After a loop, all drifts are
    /// recomputed along shortest paths.
    pub fn follow(&mut self, view: &MapView) {
        let loops = view.loops().count();
        if loops != self.loops {
            self.loops = loops;
            self.drift = self.least(view);
        }
        self.forget_culled(view);
        let waiting = std::mem::take(&mut self.waiting);
        for id in waiting {
            match view.keyframe_slot(id) {
                KeyframeSlot::Empty => self.waiting.push(id),
                KeyframeSlot::Culled { .. } => {}
                KeyframeSlot::Live(k) => {
                    let drift = self.tie_to_parent(view, k).map_or(Drift::NONE, |tie| {
                        let of_parent = self.drift.get(&tie.ends[0]);
                        of_parent.unwrap_or(&Drift::NONE).after(&tie)
                    });
                    self.drift.entry(id).or_insert(drift);
                }
            }
        }
    }

    /// Covariance of the map error at a pose measured from keyframe `reference`, in camera axes at that pose.
    #[must_use]
    pub fn at(&self, view: &MapView, reference: KeyframeId, world_from_camera: &Se3) -> Mat6 {
        let live = view.resolve_keyframe(reference);
        let drift = live.and_then(|id| self.drift.get(&id));
        drift.map_or_else(Mat6::zeros, |d| {
            moved(&d.covariance, &world_from_camera.inverse())
        })
    }

    fn forget_culled(&mut self, view: &MapView) {
        if self.own.len() > 2 * view.keyframe_count() + self.waiting.len() {
            let is_culled =
                |id: &KeyframeId| matches!(view.keyframe_slot(*id), KeyframeSlot::Culled { .. });
            self.own.retain(|id, _| !is_culled(id));
            self.drift.retain(|id, _| !is_culled(id));
        }
    }

    fn tie_to_parent(&self, view: &MapView, k: &Keyframe) -> Option<Tie> {
        let parent = view.keyframe(view.resolve_keyframe(k.parent?)?)?;
        let motion = parent.world_from_camera.inverse() * k.world_from_camera;
        let depth = k.data.median_depth(&mut Vec::new());
        // Without depth the overlap is unknown; a full field of view is assumed.
        let angle = depth.map(|z| view_angle(&motion, z));
        let camera = &k.data.camera;
        let field = 2.0 * libm::atan(0.5 * camera.width as f64 / camera.fx);
        let views = angle.map_or(1.0, |angle| (angle / field).min(1.0));
        Some(self.tie([parent.id, k.id], views, k))
    }

    fn tie(&self, ends: [KeyframeId; 2], views: f64, newer: &Keyframe) -> Tie {
        let own = self.own.get(&newer.id);
        Tie {
            ends,
            views,
            own: own.map_or_else(Mat6::zeros, |c| moved(c, &newer.world_from_camera)),
        }
    }

    /// Connections between keyframes and their parents, and between the ends of each loop. A loop counts as one
    /// measurement.
    fn ties(&self, view: &MapView) -> Vec<Tie> {
        let parents = view.keyframes().filter_map(|k| self.tie_to_parent(view, k));
        let loops = view.loops().filter_map(|edge| {
            let [old, new] = [edge.old, edge.new].map(|id| view.resolve_keyframe(id));
            let (old, new) = (old?, view.keyframe(new?)?);
            Some(self.tie([old, new.id], 1.0, new))
        });
        parents.chain(loops).collect()
    }

    /// Drift of each keyframe along the shortest path from the first keyframe of its component.
    fn least(&self, view: &MapView) -> BTreeMap<KeyframeId, Drift> {
        let ties = self.ties(view);
        let mut of_end: BTreeMap<KeyframeId, Vec<usize>> = BTreeMap::new();
        for (i, tie) in ties.iter().enumerate() {
            for end in tie.ends {
                of_end.entry(end).or_default().push(i);
            }
        }
        let mut found = BTreeMap::new();
        for first in view.keyframes().map(|k| k.id) {
            let reached = |node, drift: Drift| Reached {
                cost: drift.views,
                node,
                value: drift,
            };
            let mut queue = BinaryHeap::from([reached(first, Drift::NONE)]);
            while let Some(Reached {
                node: id,
                value: drift,
                ..
            }) = queue.pop()
            {
                if found.contains_key(&id) {
                    continue;
                }
                found.insert(id, drift);
                for tie in of_end.get(&id).into_iter().flatten().map(|i| &ties[*i]) {
                    let next = if tie.ends[0] == id {
                        tie.ends[1]
                    } else {
                        tie.ends[0]
                    };
                    if !found.contains_key(&next) {
                        queue.push(reached(next, drift.after(tie)));
                    }
                }
            }
        }
        found
    }
}
