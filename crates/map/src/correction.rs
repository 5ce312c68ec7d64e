//! Atomic corrections of a map, computed on an older version of it.

use crate::{KeyframeId, LandmarkId, LoopEdge, Map, MapView, SubmapId};
use std::collections::BTreeSet;
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec3};

/// A corrected keyframe pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseCorrection {
    /// The keyframe.
    pub keyframe: KeyframeId,
    /// Its pose `world_from_camera` in the base version.
    pub before: Se3,
    /// Its corrected pose.
    pub after: Se3,
}

impl PoseCorrection {
    /// Maps positions near the keyframe from before the correction to after it.
    fn shift(&self) -> Se3 {
        self.after * self.before.inverse()
    }

    /// The corrected pose, given the present pose `now`. If the keyframe has moved since `before`, the shift is applied
    /// on top.
    fn corrected(&self, now: &Se3) -> Se3 {
        if self.before == self.after {
            *now
        } else if *now == self.before {
            self.after
        } else {
            (self.shift() * *now).normalized()
        }
    }
}

/// A landmark moved relative to its anchor. Landmarks not listed move with their anchors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LandmarkCorrection {
    /// The landmark.
    pub landmark: LandmarkId,
    /// Its anchor in the base version.
    pub anchor: KeyframeId,
    /// Its position (m) in the anchor's camera coordinates in the base version.
    pub before: Vec3,
    /// Its corrected position in the anchor's camera coordinates, m.
    pub after: Vec3,
}

/// Joins one submap to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Join {
    /// The submap that disappears: its keyframes go to the other.
    pub submap: SubmapId,
    /// The submap that remains, with its frame of reference.
    pub into: SubmapId,
    /// The keyframe of the first submap that was recognised in the second. Becomes the root of its submap's tree.
    pub child: KeyframeId,
    /// The keyframe of the second submap that becomes the parent of `child`.
    pub parent: KeyframeId,
    /// Maps the first submap's frame of reference to the second's, for keyframes not corrected otherwise.
    pub shift: Se3,
}

/// Changes computed on version `base_version` of a map; [`Map::apply`] applies them to the present version.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Correction {
    /// The version on which the correction was computed.
    pub base_version: u64,
    /// Corrected keyframes.
    pub poses: Vec<PoseCorrection>,
    /// Landmarks corrected relative to their anchors.
    pub landmarks: Vec<LandmarkCorrection>,
    /// The loop measurement behind the correction. The map stores it.
    pub measured: Option<Box<LoopEdge>>,
    /// Submaps to join; `poses` contains the poses of the one that disappears.
    pub join: Option<Join>,
    /// Landmarks to merge, as (from, into), in this order.
    pub merges: Vec<(LandmarkId, LandmarkId)>,
}

/// Statistics of an applied correction.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Applied {
    /// Corrected keyframes that were still live.
    pub poses: u32,
    /// Of these, keyframes moved since the base version, where the correction was applied on top.
    pub composed: u32,
    /// Keyframes not in the correction (such as newer ones) that moved with an ancestor or their submap.
    pub propagated: u32,
    /// Landmarks moved relative to their anchors.
    pub landmarks: u32,
    /// Merged landmarks.
    pub merged: u32,
    /// Keyframes whose landmarks have changed, by id: their covisibility must be refreshed.
    pub touched: Vec<KeyframeId>,
}

impl Map {
    /// Applies a correction to the present version of the map.
    ///
    /// - A keyframe that has moved since `base_version` gets the correction on top of that.
    /// - A keyframe not in the correction keeps its pose relative to its nearest ancestor that is; without one it
    ///   stays. Culled keyframes move with the keyframe of their tombstone.
    /// - Landmarks move with their anchors; corrections relative to the anchor are added, unless the landmark has
    ///   another anchor in the meantime.
    /// - All keyframes of a joined submap change to the other one, including newer ones.
    /// - Merges follow earlier merges; those of culled landmarks and those across submaps are ignored.
    ///
    /// The caller must refresh covisibility: see [`Applied::touched`].
    pub fn apply(&mut self, correction: &Correction) -> Applied {
        let mut applied = Applied::default();
        // All moves are computed before any is applied: propagated moves depend on the old poses of ancestors.
        let named = Named::new(correction);
        let moves = self.moves(&named, correction.join, &mut applied);
        for (keyframe, pose) in moves {
            self.set_pose(keyframe, pose);
        }
        for l in &correction.landmarks {
            applied.landmarks += u32::from(self.correct_landmark(l));
        }
        if let Some(join) = correction.join {
            self.join(join);
        }
        if let Some(edge) = &correction.measured {
            self.keep(**edge);
        }
        let mut touched = BTreeSet::new();
        for &(from, into) in &correction.merges {
            let resolved = (
                self.view.resolve_landmark(from),
                self.view.resolve_landmark(into),
            );
            let (Some(from), Some(into)) = resolved else {
                continue;
            };
            let observers = self.observations(from).iter().map(|o| o.0);
            let observers: Vec<KeyframeId> = observers.collect();
            if self.merge_landmarks(from, into) {
                touched.extend(observers);
                applied.merged += 1;
            }
        }
        applied.touched = touched.into_iter().collect();
        applied
    }

    fn moves(
        &self,
        named: &Named<'_>,
        join: Option<Join>,
        applied: &mut Applied,
    ) -> Vec<(KeyframeId, Se3)> {
        let mut moves = Vec::new();
        for k in self.view.keyframes() {
            let now = k.world_from_camera;
            let pose = if let Some(c) = named.get(k.id) {
                applied.poses += 1;
                applied.composed += u32::from(now != c.before);
                c.corrected(&now)
            } else if let Some(c) = named.ancestor(&self.view, k.id) {
                applied.propagated += 1;
                if c.before == c.after {
                    now
                } else {
                    (c.shift() * now).normalized()
                }
            } else if let Some(join) = join.filter(|j| j.submap == k.submap) {
                applied.propagated += 1;
                (join.shift * now).normalized()
            } else {
                now
            };
            if pose != now && pose.is_finite() {
                moves.push((k.id, pose));
            }
        }
        moves
    }

    /// Stores a loop edge, if it is sound and both keyframes have poses in one submap.
    fn keep(&mut self, edge: LoopEdge) {
        let submap = |id| self.view.submap_of(id);
        let of_one = submap(edge.old).is_some() && submap(edge.old) == submap(edge.new);
        if of_one && edge.is_sound() {
            Arc::make_mut(&mut self.view.loops).push(edge);
        }
    }

    fn join(&mut self, join: Join) {
        let of_submap = self.view.keyframes().filter(|k| k.submap == join.submap);
        let ids: Vec<KeyframeId> = of_submap.map(|k| k.id).collect();
        for id in ids {
            if let Some(k) = self.keyframe_mut(id) {
                k.submap = join.into;
            }
        }
        self.hang(join.child, join.parent);
    }

    /// Makes a keyframe the root of its tree and a child of a keyframe of another tree, reversing the parents between
    /// it and the old root.
    fn hang(&mut self, child: KeyframeId, parent: KeyframeId) {
        let resolved = |id| self.view.resolve_keyframe(id);
        let (Some(child), Some(parent)) = (resolved(child), resolved(parent)) else {
            return;
        };
        let (mut at, mut new_parent) = (child, parent);
        let mut turned = BTreeSet::new();
        // Parents can form a ring: stop after one round.
        while turned.insert(at) {
            let Some(k) = self.keyframe_mut(at) else {
                return;
            };
            let old_parent = k.parent.replace(new_parent);
            let Some(next) = old_parent.and_then(|p| self.view.resolve_keyframe(p)) else {
                return;
            };
            (at, new_parent) = (next, at);
        }
    }

    fn correct_landmark(&mut self, c: &LandmarkCorrection) -> bool {
        let Some(l) = self.landmark_mut(c.landmark) else {
            return false;
        };
        let position = if l.position_in_anchor == c.before {
            c.after
        } else {
            l.position_in_anchor + (c.after - c.before)
        };
        if l.anchor != c.anchor || !position.iter().all(|x| x.is_finite()) {
            return false;
        }
        l.position_in_anchor = position;
        true
    }
}

struct Named<'a>(Vec<&'a PoseCorrection>);

impl<'a> Named<'a> {
    fn new(correction: &'a Correction) -> Self {
        let mut named: Vec<&PoseCorrection> = correction.poses.iter().collect();
        // Stable sort: of two corrections for one keyframe the first wins.
        named.sort_by_key(|c| c.keyframe);
        named.dedup_by_key(|c| c.keyframe);
        Self(named)
    }

    fn get(&self, id: KeyframeId) -> Option<&'a PoseCorrection> {
        let at = self.0.binary_search_by_key(&id, |c| c.keyframe).ok()?;
        Some(self.0[at])
    }

    fn ancestor(&self, view: &MapView, id: KeyframeId) -> Option<&'a PoseCorrection> {
        let mut at = id;
        // Culling can make a keyframe's parent its child: the count bounds such cycles.
        for _ in 0..view.keyframe_count() {
            at = view.resolve_keyframe(view.keyframe(at)?.parent?)?;
            if let Some(c) = self.get(at) {
                return Some(c);
            }
        }
        None
    }
}
