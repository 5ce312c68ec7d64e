//! What bundle adjustment of whole submaps is about.

use super::nodes::Nodes;
use crate::association::measurement_in;
use std::collections::BTreeMap;
use stillpoint_estimation::{BundleObservation, BundleProblem, Intrinsics};
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_map::{LandmarkId, MapView};

/// The landmarks of the whole map that at least two keyframes see, merged.
pub(super) struct Points {
    pub(super) landmarks: Vec<LandmarkId>,
    /// World positions, m.
    pub(super) positions: Vec<Vec3>,
    /// By point; poses are numbers of nodes.
    pub(super) observations: Vec<BundleObservation>,
}

impl Points {
    /// Where landmarks start from (they moved with their anchors), and what `camera` would have measured of them.
    pub(super) fn gather(
        view: &MapView,
        camera: &Camera,
        nodes: &Nodes<'_>,
        poses: &[Se3],
        merges: &BTreeMap<LandmarkId, LandmarkId>,
    ) -> Self {
        let mut seen: Vec<(LandmarkId, u32, u32)> = Vec::new();
        for (node, k) in nodes.keyframes.iter().enumerate() {
            let matches = k.matches.iter().enumerate();
            seen.extend(matches.filter_map(|(feature, landmark)| {
                let id = landmark.map(|l| merges.get(&l).copied().unwrap_or(l))?;
                Some((id, node as u32, feature as u32))
            }));
        }
        // By landmark, in the order of nodes; of two features of one keyframe the first.
        seen.sort_unstable();
        seen.dedup_by_key(|(id, node, _)| (*id, *node));
        let mut points = Self {
            landmarks: Vec::new(),
            positions: Vec::new(),
            observations: Vec::new(),
        };
        let landmarks = seen.chunk_by(|a, b| a.0 == b.0);
        for list in landmarks.filter(|list| list.len() >= 2) {
            let id = list[0].0;
            let Some(l) = view.landmark(id) else { continue };
            let Some(anchor) = nodes.index.get(&l.anchor) else {
                continue;
            };
            let point = points.landmarks.len() as u32;
            points.landmarks.push(id);
            let position = poses[*anchor as usize].transform(&l.position_in_anchor);
            points.positions.push(position);
            for (_, node, feature) in list {
                let data = &nodes.keyframes[*node as usize].data;
                points.observations.push(BundleObservation {
                    pose: *node,
                    point,
                    measurement: measurement_in(data, *feature as usize, camera),
                });
            }
        }
        points
    }

    /// The problem of bundle adjustment for the nodes that are held, and where each node's pose is in it. Free poses come first; the
    /// first keyframe, which holds the map in place, is the last. Of a large map the observations are most of what there is: they are not copied.
    pub(super) fn problem(
        self,
        camera: Intrinsics,
        poses: &[Se3],
        held: &[bool],
    ) -> (BundleProblem, Vec<Option<u32>>) {
        let mut places = vec![None; poses.len()];
        let mut in_camera = Vec::new();
        let free = (1..poses.len()).filter(|n| held[*n]);
        for node in free.chain((0..poses.len()).take(1)) {
            places[node] = Some(in_camera.len() as u32);
            in_camera.push(poses[node].inverse());
        }
        // What the others saw would pull at points without a pose that it could be weighed with.
        let mut seen = self.observations;
        seen.retain_mut(|o| {
            let place = places[o.pose as usize];
            o.pose = place.unwrap_or(o.pose);
            place.is_some()
        });
        let problem = BundleProblem {
            camera,
            free_poses: in_camera.len().saturating_sub(1),
            poses: in_camera,
            points: self.positions,
            observations: seen,
        };
        (problem, places)
    }
}
