//! The error of the map itself. A keyframe inherits the error of the keyframe that it was tracked from, and adds one of its own.
//!
//! The first keyframe defines the origin of a map and has no error. A pose that shares landmarks with it has only the error of its own measurement.
//! Farther away, landmarks were placed from uncertain poses, and errors accumulate from view to view.

use super::moved;
use crate::least_first::Reached;
use crate::view_angle::view_angle;
use std::collections::{BTreeMap, BinaryHeap};
use stillpoint_geometry::nalgebra::ArrayStorage;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::{Keyframe, KeyframeId, KeyframeSlot, MapView};

/// The covariances of a map's keyframes. It takes those of the frames that become keyframes, and the versions of the map.
#[derive(Clone, Debug, Default)]
pub struct MapCovariance {
    /// Of keyframes in the map around them, in the axes of their cameras.
    own: BTreeMap<KeyframeId, Mat6>,
    /// Errors of keyframes relative to the origin of the map, or of the submap.
    drift: BTreeMap<KeyframeId, Drift>,
    /// Keyframes that no version has had yet.
    waiting: Vec<KeyframeId>,
    /// Number of loops in the newest version.
    loops: usize,
}

/// What lies between a keyframe and the one with which its map began.
#[derive(Clone, Copy, Debug)]
struct Drift {
    /// Sum of the differences between views along the path, in fields of view.
    views: f64,
    /// Of a left perturbation of `world_from_camera`.
    covariance: Mat6,
}

impl Drift {
    const NONE: Self = Self {
        views: 0.0,
        covariance: Mat6::from_array_storage(ArrayStorage([[0.0; 6]; 6])),
    };

    /// The drift at the other end of a tie. Beyond the first view, each view without overlap with the one before adds the error of one pose.
    fn after(&self, tie: &Tie) -> Self {
        let views = self.views + tie.views;
        let new = views.max(1.0) - self.views.max(1.0);
        Self {
            views,
            covariance: self.covariance + tie.own * new,
        }
    }
}

/// Between two keyframes.
struct Tie {
    ends: [KeyframeId; 2],
    /// Difference of their views, in fields of view.
    views: f64,
    /// Covariance of the newer one in the map around it, for a left perturbation in the world.
    own: Mat6,
}

impl MapCovariance {
    /// That of a whole map, by the covariances of its keyframes in the map around them.
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

    /// Notes a frame that becomes a keyframe, and its pose's covariance in the map around it, in the axes of the camera. Keyframes that were never noted, as those
    /// of a map that was loaded, count as exact.
    pub fn note(&mut self, keyframe: KeyframeId, in_map: Mat6) {
        self.own.insert(keyframe, in_map);
        self.waiting.push(keyframe);
    }

    /// Takes a version of the map. A new keyframe inherits the drift of its parent. After a loop, all keyframes get the drift along their shortest path.
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

    /// Covariance of the map's error at a pose that was measured from a keyframe, in the axes of the camera at that pose.
    #[must_use]
    pub fn at(&self, view: &MapView, reference: KeyframeId, world_from_camera: &Se3) -> Mat6 {
        let live = view.resolve_keyframe(reference);
        let drift = live.and_then(|id| self.drift.get(&id));
        drift.map_or_else(Mat6::zeros, |d| {
            moved(&d.covariance, &world_from_camera.inverse())
        })
    }

    /// Keeps memory in proportion to the map, where that culls keyframes as fast as it gets them.
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
        // Where nothing has a depth, nothing tells how much of the view is another.
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

    /// The ties between keyframes and their parents, and between the two ends of each loop. A loop counts as one measurement.
    fn ties(&self, view: &MapView) -> Vec<Tie> {
        let parents = view.keyframes().filter_map(|k| self.tie_to_parent(view, k));
        let loops = view.loops().filter_map(|edge| {
            let [old, new] = [edge.old, edge.new].map(|id| view.resolve_keyframe(id));
            let (old, new) = (old?, view.keyframe(new?)?);
            Some(self.tie([old, new.id], 1.0, new))
        });
        parents.chain(loops).collect()
    }

    /// The drift of each keyframe along the shortest path from the first keyframe of its component.
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
