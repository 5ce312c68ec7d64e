//! The keyframes affected by a loop, as numbered nodes, and their connections.

use std::collections::{BTreeMap, BTreeSet};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_map::{
    Keyframe, KeyframeId, LandmarkCorrection, LandmarkId, LoopEdge, MapView, PoseCorrection,
    SubmapId,
};

/// Number of most covisible keyframes that count as the same place, as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
const GROUP: usize = 10;
/// Minimum number of shared landmarks of a tie beside the tree of parents, as in the essential graph of ORB-SLAM
/// (Mur-Artal, Montiel, Tardos, T-RO 2015).
const MIN_SHARED: u32 = 100;

/// The live keyframes of the submaps involved, numbered.
pub(super) struct Nodes<'a> {
    pub(super) keyframes: Vec<&'a Keyframe>,
    pub(super) index: BTreeMap<KeyframeId, u32>,
}

impl<'a> Nodes<'a> {
    /// Nodes of one or two submaps; the first keyframe of the older submap comes first.
    pub(super) fn new(view: &'a MapView, a: SubmapId, b: SubmapId) -> Self {
        let all = view.keyframes().map(|k| &**k);
        let mut keyframes: Vec<&Keyframe> =
            all.filter(|k| k.submap == a || k.submap == b).collect();
        keyframes.sort_by_key(|k| (k.submap, k.id));
        let numbered = keyframes.iter().zip(0..);
        Self {
            index: numbered.map(|(k, i)| (k.id, i)).collect(),
            keyframes,
        }
    }

    /// Edges of the essential graph: the tree of parents and strongly covisible pairs, as (older, younger).
    pub(super) fn essential_pairs(&self) -> Vec<(u32, u32)> {
        let mut pairs = Vec::new();
        for (b, k) in self.keyframes.iter().enumerate() {
            let mut others: Vec<KeyframeId> = k.parent.into_iter().collect();
            let strong = k
                .covisible
                .iter()
                // Each pair once, from its younger end.
                .filter(|(o, n)| *n >= MIN_SHARED && *o < k.id);
            others.extend(strong.map(|c| c.0).filter(|o| Some(*o) != k.parent));
            let known = others.iter().filter_map(|o| self.index.get(o));
            pairs.extend(known.filter(|a| **a != b as u32).map(|a| (*a, b as u32)));
        }
        pairs
    }

    pub(super) fn motion(&self, a: u32, b: u32) -> Se3 {
        let pose = |i: u32| self.keyframes[i as usize].world_from_camera;
        pose(a).inverse() * pose(b)
    }

    /// Both nodes of a loop edge and the measured motion. Culled ends resolve through tombstones.
    pub(super) fn loop_between(&self, view: &MapView, edge: &LoopEdge) -> Option<(u32, u32, Se3)> {
        let end = |id: KeyframeId| {
            let live = view.resolve_keyframe(id)?;
            let live_from_world = view.world_from_keyframe(live)?.inverse();
            // If the end was culled, moves the measurement to the keyframe that its tombstone refers to.
            let live_from_id = live_from_world * view.world_from_keyframe(id)?;
            Some((*self.index.get(&live)?, live_from_id))
        };
        let ((a, a_from_old), (b, b_from_new)) = (end(edge.old)?, end(edge.new)?);
        (a != b).then(|| (a, b, a_from_old * edge.old_from_new * b_from_new.inverse()))
    }

    pub(super) fn corrections(&self, poses: &[Se3]) -> Vec<PoseCorrection> {
        let pairs = self.keyframes.iter().zip(poses);
        pairs
            .map(|(k, pose)| PoseCorrection {
                keyframe: k.id,
                before: k.world_from_camera,
                after: *pose,
            })
            .collect()
    }

    pub(super) fn landmark_correction(
        &self,
        view: &MapView,
        poses: &[Se3],
        id: LandmarkId,
        position: &Vec3,
    ) -> Option<LandmarkCorrection> {
        let l = view.landmark(id)?;
        let anchor = *self.index.get(&l.anchor)?;
        Some(LandmarkCorrection {
            landmark: id,
            anchor: l.anchor,
            before: l.position_in_anchor,
            after: poses[anchor as usize].inverse().transform(position),
        })
    }
}

/// A keyframe and its most covisible ones, sorted by id.
pub(super) fn group_of(k: &Keyframe) -> Vec<KeyframeId> {
    let mut group: Vec<KeyframeId> = k.covisible.iter().take(GROUP).map(|c| c.0).collect();
    group.push(k.id);
    group.sort_unstable();
    group
}

/// The keyframes covisible with one, and those covisible with them.
pub(super) fn surroundings(view: &MapView, k: &Keyframe) -> BTreeSet<KeyframeId> {
    let mut near = BTreeSet::from([k.id]);
    for (id, _) in &k.covisible {
        near.insert(*id);
        let second = view.keyframe(*id);
        near.extend(second.iter().flat_map(|k| k.covisible.iter().map(|c| c.0)));
    }
    near
}
