//! What is changed in a map all at once, by one who worked on an older version of it.

use crate::{KeyframeId, LandmarkId, LoopEdge, Map, MapView, SubmapId};
use std::collections::BTreeSet;
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec3};

/// A keyframe that a correction moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseCorrection {
    /// The keyframe.
    pub keyframe: KeyframeId,
    /// Its pose `world_from_camera` in the version that was corrected.
    pub before: Se3,
    /// Its corrected pose.
    pub after: Se3,
}

impl PoseCorrection {
    /// Where this keyframe's part of the world went: maps what it was to what it is.
    fn shift(&self) -> Se3 {
        self.after * self.before.inverse()
    }

    /// The corrected pose of this keyframe, given its present pose `now`. If it moved since `before`, the shift is applied on top of that move.
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

/// A landmark that a correction moves relative to its anchor. Those that it does not name move with their anchors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LandmarkCorrection {
    /// The landmark.
    pub landmark: LandmarkId,
    /// Its anchor in the version that was corrected.
    pub anchor: KeyframeId,
    /// Its position (m) in the anchor's camera coordinates in that version.
    pub before: Vec3,
    /// Its corrected position in the anchor's camera coordinates, m.
    pub after: Vec3,
}

/// Two submaps that turned out to be parts of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Join {
    /// The submap that is no more: its keyframes go to the other.
    pub submap: SubmapId,
    /// The submap that stays, with its frame of reference.
    pub into: SubmapId,
    /// The keyframe of the first submap by which both were recognised as one. It becomes the root of its submap's tree.
    pub child: KeyframeId,
    /// The keyframe of the second submap that becomes the parent of `child`.
    pub parent: KeyframeId,
    /// Maps the first submap's frame of reference to the second's, for keyframes that the correction does not reach otherwise.
    pub shift: Se3,
}

/// What is to be changed in a map, found on its version `base_version`. [`Map::apply`] brings it into the present one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Correction {
    /// The version that was corrected.
    pub base_version: u64,
    /// Keyframes that are seen in another place.
    pub poses: Vec<PoseCorrection>,
    /// Landmarks that are seen in another place relative to their anchors.
    pub landmarks: Vec<LandmarkCorrection>,
    /// What was measured, and made the correction necessary. The map keeps it.
    pub measured: Option<Box<LoopEdge>>,
    /// Submaps that become one; the poses of the one that is no more are named as `poses`.
    pub join: Option<Join>,
    /// Landmarks that are the same as another: (which, as which). In this order.
    pub merges: Vec<(LandmarkId, LandmarkId)>,
}

/// What a correction did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Applied {
    /// Keyframes that it named and that were still there.
    pub poses: u32,
    /// Of these, the ones that had been moved since; the correction came on top.
    pub composed: u32,
    /// Keyframes made since (or left out by the correction) that moved along with the one they hang on.
    pub propagated: u32,
    /// Landmarks that were moved relative to their anchors.
    pub landmarks: u32,
    /// Landmarks that became others.
    pub merged: u32,
    /// Keyframes whose landmarks are others now, by id: what they share has to be counted again.
    pub touched: Vec<KeyframeId>,
}

impl Map {
    /// Applies a correction by one rule: what it saw is replaced, what it did not see moves along.
    ///
    /// - A keyframe that has moved since `base_version` gets the correction on top of that.
    /// - A keyframe that the correction does not name keeps its pose relative to the first of its ancestors that it names; without
    ///   one it stays. Culled keyframes move with the one that their tombstone hangs on.
    /// - Landmarks move with their anchors, and what the correction says of one relative to its anchor comes on top, unless it
    ///   has another anchor by now.
    /// - All keyframes of a submap that is joined to another are that one's, the ones made since too.
    /// - Merges follow what the landmarks have become since; those of culled ones lapse, and those across submaps.
    ///
    /// Covisibility is left to the caller: see [`Applied::touched`].
    pub fn apply(&mut self, correction: &Correction) -> Applied {
        let mut applied = Applied::default();
        // All poses are decided before the first one changes: what moves along refers to where its ancestor was.
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

    /// Where every keyframe goes that does not stay.
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

    /// Keeps what was measured between two keyframes, if it is sound and both have poses in one submap.
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

    /// Makes a keyframe the root of its tree, and a child of a keyframe of another tree: parents between it and the old root turn
    /// round.
    fn hang(&mut self, child: KeyframeId, parent: KeyframeId) {
        let resolved = |id| self.view.resolve_keyframe(id);
        let (Some(child), Some(parent)) = (resolved(child), resolved(parent)) else {
            return;
        };
        let (mut at, mut new_parent) = (child, parent);
        let mut turned = BTreeSet::new();
        // Parents can form a ring: once around is enough.
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

/// The keyframes that a correction names, by id.
struct Named<'a>(Vec<&'a PoseCorrection>);

impl<'a> Named<'a> {
    fn new(correction: &'a Correction) -> Self {
        let mut named: Vec<&PoseCorrection> = correction.poses.iter().collect();
        // Stable: of two for one keyframe the first counts.
        named.sort_by_key(|c| c.keyframe);
        named.dedup_by_key(|c| c.keyframe);
        Self(named)
    }

    fn get(&self, id: KeyframeId) -> Option<&'a PoseCorrection> {
        let at = self.0.binary_search_by_key(&id, |c| c.keyframe).ok()?;
        Some(self.0[at])
    }

    /// The correction of the first ancestor of a keyframe that is named.
    fn ancestor(&self, view: &MapView, id: KeyframeId) -> Option<&'a PoseCorrection> {
        let mut at = id;
        // A keyframe's parent can come to hang on its child when keyframes between are culled: count, so that no ring holds us.
        for _ in 0..view.keyframe_count() {
            at = view.resolve_keyframe(view.keyframe(at)?.parent?)?;
            if let Some(c) = self.get(at) {
                return Some(c);
            }
        }
        None
    }
}
