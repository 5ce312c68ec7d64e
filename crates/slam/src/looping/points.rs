//! The global bundle adjustment problem.

use super::nodes::Nodes;
use crate::association::measurement_in;
use std::collections::BTreeMap;
use stillpoint_estimation::{BundleObservation, BundleProblem, Intrinsics};
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_map::{LandmarkId, MapView};

/// All landmarks seen by at least two keyframes, with duplicates merged.
pub(super) struct Points {
    pub(super) landmarks: Vec<LandmarkId>,
    pub(super) positions: Vec<Vec3>,
    /// Grouped by point; poses are node indices.
    pub(super) observations: Vec<BundleObservation>,
}

impl Points {
    /// Initial landmark positions (moved with their anchors) and their measurements, converted to `camera`.
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
        // Sorted by landmark and node; of two features of one keyframe the first is kept.
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

    /// The bundle adjustment problem of the supported nodes, and the index of each node's pose in it. Free poses come
    /// first; the first keyframe, which fixes the gauge, is the last. Reuses the observations, which dominate memory in
    /// large maps.
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
        // Observations of other nodes would pull at points without a pose to optimise.
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
