//! From a verified motion to a correction: merged landmarks, a pose graph, and bundle adjustment of the whole map.

use super::drift::{Drift, loop_covariance};
use super::group_of;
use super::nodes::Nodes;
use super::points::Points;
use super::support::{follow, held};
use super::verify::{RADIUS_PX, Search, Verified};
use crate::association::measurement;
use crate::report::{BundleCounts, LoopReport};
use std::collections::BTreeMap;
use stillpoint_estimation::pose_covariance;
use stillpoint_estimation::{
    BundleOptions, EdgeKernel, Intrinsics, PoseGraph, PoseGraphEdge, PoseGraphOptions,
    PoseGraphOutcome, adjust_bundle, optimise_pose_graph,
};
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::{Correction, Join, Keyframe, LandmarkId, LoopEdge, MapView};

/// Work of full bundle adjustment, at most, in products of two 6x6 blocks: what 2000 keyframes take (1.3e8 for laps of 40 m, decision 11).
const MAX_WORK: u64 = 200_000_000;

/// A loop that is believed.
pub(super) struct Proposal<'a> {
    pub(super) view: &'a MapView,
    /// The new keyframe.
    pub(super) keyframe: &'a Keyframe,
    /// The older one that shows the same place.
    pub(super) with: &'a Keyframe,
    pub(super) verified: &'a Verified,
    /// Its motion, as the map keeps it.
    pub(super) edge: LoopEdge,
    /// Landmarks that hold a keyframe in bundle adjustment, at least.
    pub(super) min_held: usize,
    pub(super) scale_factor: f64,
}

impl Proposal<'_> {
    /// Merges what is seen twice, and moves keyframes and landmarks to where they fit best.
    pub(super) fn correct(&self, drift: &Drift<'_>, report: &mut LoopReport) -> Option<Correction> {
        let _span = tracing::info_span!("correct").entered();
        let join = self.join();
        let poses = match join {
            Some(join) => Self::put_together(&drift.nodes, join),
            None => self.straighten(drift)?,
        };
        let merges = self.merges();
        report.merges = merges.len() as u32;
        Some(Correction {
            join,
            measured: Some(Box::new(self.edge)),
            ..self.refine(&drift.nodes, poses, merges, report)
        })
    }

    /// The submaps that become one, when the two keyframes are of different ones: the younger goes to the older.
    fn join(&self) -> Option<Join> {
        let (a, b) = (self.with.submap, self.keyframe.submap);
        if a == b {
            return None;
        }
        let old_from_new = self.verified.new_from_old.inverse();
        let with_from_keyframe = self.with.world_from_camera * old_from_new;
        // Maps the frame of reference of the new keyframe's submap to that of the older one's.
        let shift = with_from_keyframe * self.keyframe.world_from_camera.inverse();
        Some(if b > a {
            Join {
                submap: b,
                into: a,
                child: self.keyframe.id,
                parent: self.with.id,
                shift,
            }
        } else {
            Join {
                submap: a,
                into: b,
                child: self.with.id,
                parent: self.keyframe.id,
                shift: shift.inverse(),
            }
        })
    }

    /// The poses of two submaps in the frame of reference of the one that stays.
    fn put_together(nodes: &Nodes<'_>, join: Join) -> Vec<Se3> {
        let place = |k: &&Keyframe| {
            if k.submap == join.submap {
                (join.shift * k.world_from_camera).normalized()
            } else {
                k.world_from_camera
            }
        };
        nodes.keyframes.iter().map(place).collect()
    }

    /// The landmarks of the new place that are landmarks of the older one: (new, older), searched in the new keyframe and its
    /// neighbours from where the loop puts them.
    fn merges(&self) -> BTreeMap<LandmarkId, LandmarkId> {
        let _span = tracing::info_span!("merge").entered();
        let mut merges = BTreeMap::new();
        let old = self.with.world_from_camera;
        let shift =
            old * self.verified.new_from_old.inverse() * self.keyframe.world_from_camera.inverse();
        for id in group_of(self.keyframe) {
            let Some(k) = self.view.keyframe(id) else {
                continue;
            };
            let search = Search {
                view: self.view,
                keyframe: k,
                camera_from_world: (shift * k.world_from_camera).inverse(),
                radius_px: RADIUS_PX,
                scale_factor: self.scale_factor,
            };
            let intrinsics = Intrinsics::from(&k.data.camera);
            for s in search.landmarks(&self.verified.landmarks).0 {
                let feature = s.feature as usize;
                let (Some(seen), Some(position)) =
                    (k.matches[feature], self.view.landmark_position(s.landmark))
                else {
                    continue;
                };
                let m = measurement(&k.data, feature);
                let p = search.camera_from_world.transform(&position);
                // A landmark of the older place is never merged itself, so that no chain can close.
                let is_old = self.verified.landmarks.binary_search(&seen).is_ok();
                if !is_old && m.chi2(&intrinsics, &p) <= m.gate() {
                    merges.entry(seen).or_insert(s.landmark);
                }
            }
        }
        merges
    }

    /// The poses of all keyframes after the pose graph. The new edge is believed; loops closed before may turn out to have been wrong.
    fn straighten(&self, drift: &Drift<'_>) -> Option<Vec<Se3>> {
        let (nodes, edge) = (&drift.nodes, &self.edge);
        let _span = tracing::info_span!("straighten").entered();
        let mut edges = Vec::with_capacity(drift.ties.len() + 1);
        for tie in &drift.ties {
            edges.push(PoseGraphEdge {
                a: tie.a,
                b: tie.b,
                a_from_b: tie.a_from_b,
                information: information(&tie.covariance)?,
                kernel: tie.kernel,
            });
        }
        let (a, b, a_from_b) = nodes.loop_between(self.view, edge)?;
        edges.push(PoseGraphEdge {
            a,
            b,
            a_from_b,
            information: information(&loop_covariance(&edge.information, &a_from_b))?,
            kernel: EdgeKernel::Square,
        });
        let poses: Vec<Se3> = nodes
            .keyframes
            .iter()
            .map(|k| k.world_from_camera)
            .collect();
        let mut fixed = vec![false; poses.len()];
        // Edges are relative: without a node that stands still the whole graph could drift.
        *fixed.first_mut()? = true;
        let mut graph = PoseGraph {
            nodes: poses,
            fixed,
            edges,
        };
        // Bundle adjustment comes after.
        let options = PoseGraphOptions {
            max_iterations: 12,
            min_relative_gain: 1e-3,
            ..PoseGraphOptions::default()
        };
        let report = optimise_pose_graph(&mut graph, &options);
        (!matches!(report.outcome, PoseGraphOutcome::Refused(_))).then_some(graph.nodes)
    }

    /// Bundle adjustment of all keyframes and of all landmarks that two of them see, and the correction that it amounts to.
    fn refine(
        &self,
        nodes: &Nodes<'_>,
        mut poses: Vec<Se3>,
        merges: BTreeMap<LandmarkId, LandmarkId>,
        report: &mut LoopReport,
    ) -> Correction {
        let _span = tracing::info_span!("adjust").entered();
        let points = Points::gather(
            self.view,
            &self.keyframe.data.camera,
            nodes,
            &poses,
            &merges,
        );
        let camera = Intrinsics::from(&self.keyframe.data.camera);
        let held = held(&points, &poses, &camera, self.min_held);
        let before = poses.clone();
        let landmarks = points.landmarks.clone();
        let (mut problem, places) = points.problem(camera, &poses, &held);
        let options = BundleOptions {
            max_work: MAX_WORK,
            ..BundleOptions::default()
        };
        let result = adjust_bundle(&mut problem, &options);
        for (pose, place) in poses.iter_mut().zip(&places).skip(1) {
            if let Some(place) = place {
                *pose = problem.poses[*place as usize].inverse().normalized();
            }
        }
        follow(nodes, &held, &before, &mut poses);
        report.bundle = BundleCounts {
            free_keyframes: problem.free_poses as u32,
            fixed_keyframes: 1,
            landmarks: problem.points.len() as u32,
            observations: problem.observations.len() as u32,
            outliers: result.outliers.iter().filter(|o| **o).count() as u32,
            iterations: result.iterations as u32,
        };
        let corrected = nodes.keyframes.iter().zip(&poses);
        let moved = corrected.map(|(k, p)| (k.centre() - p.translation).norm());
        report.moved_m = moved.fold(0.0, f64::max);
        let positions = landmarks.iter().zip(&problem.points);
        Correction {
            base_version: self.view.version(),
            measured: None,
            join: None,
            poses: nodes.corrections(&poses),
            landmarks: positions
                .filter_map(|(id, p)| nodes.landmark_correction(self.view, &poses, *id, p))
                .collect(),
            merges: merges.into_iter().collect(),
        }
    }
}
/// The information of a covariance; none where it has no meaning.
fn information(covariance: &Mat6) -> Option<Mat6> {
    pose_covariance(covariance)
}

#[cfg(test)]
mod tests;
