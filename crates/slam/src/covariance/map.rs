//! What the map itself is off by: every keyframe hangs on the one that it was tracked from, and errs with it.
//!
//! The first keyframe of a map is where it is by definition. Whoever sees a part of what it saw is no farther off than their own pose; whoever sees nothing of it has
//! landmarks that were placed from poses which err, and so on from view to view.

use super::moved;
use crate::view_angle::view_angle;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};
use stillpoint_geometry::nalgebra::ArrayStorage;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::{Keyframe, KeyframeId, KeyframeSlot, MapView};

/// The covariances of a map's keyframes. It takes those of the frames that become keyframes, and the versions of the map.
#[derive(Clone, Debug, Default)]
pub struct MapCovariance {
    /// Of keyframes in the map around them, in the axes of their cameras.
    own: BTreeMap<KeyframeId, Mat6>,
    /// What keyframes are off by from where the map, or the submap, began.
    drift: BTreeMap<KeyframeId, Drift>,
    /// Keyframes that no version has had yet.
    waiting: Vec<KeyframeId>,
    /// Number of loops in the newest version.
    loops: usize,
}

/// What lies between a keyframe and the one with which its map began.
#[derive(Clone, Copy, Debug)]
struct Drift {
    /// By how many fields of view the views on the way differ, in all.
    views: f64,
    /// Of a left perturbation of `world_from_camera`.
    covariance: Mat6,
}

impl Drift {
    const NONE: Self = Self {
        views: 0.0,
        covariance: Mat6::from_array_storage(ArrayStorage([[0.0; 6]; 6])),
    };

    /// At the other end of a tie. With every view that shares nothing with the one before, a map is off by as much again as one of its poses; the first is where it is.
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
    /// By how many fields of view they differ.
    views: f64,
    /// What the newer one is off by in the map around it, for a left perturbation in the world.
    own: Mat6,
}

/// A keyframe on its way through the queue; the one that has least in between comes first, ties by number.
struct Reached(KeyframeId, Drift);

impl Ord for Reached {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_views = other.1.views.total_cmp(&self.1.views);
        by_views.then(other.0.cmp(&self.0))
    }
}
impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl PartialEq for Reached {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Reached {}

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

    /// Takes a version of the map: keyframes that are new hang on those that they were tracked from. After a loop all do on the least that is in between.
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

    /// Covariance of what the map is off by at a pose that was measured from a keyframe, in the axes of the camera there.
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

    /// Those of keyframes and the ones that they were tracked from, and of loops: a place that was recognised is one measurement.
    fn ties(&self, view: &MapView) -> Vec<Tie> {
        let parents = view.keyframes().filter_map(|k| self.tie_to_parent(view, k));
        let loops = view.loops().filter_map(|edge| {
            let [old, new] = [edge.old, edge.new].map(|id| view.resolve_keyframe(id));
            let (old, new) = (old?, view.keyframe(new?)?);
            Some(self.tie([old, new.id], 1.0, new))
        });
        parents.chain(loops).collect()
    }

    /// What lies between each keyframe and the first one of all that it hangs together with.
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
            let mut queue = BinaryHeap::from([Reached(first, Drift::NONE)]);
            while let Some(Reached(id, drift)) = queue.pop() {
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
                        queue.push(Reached(next, drift.after(tie)));
                    }
                }
            }
        }
        found
    }
}
