//! Turns a verified loop into a correction: merges landmarks, optimises the pose graph and runs global bundle
//! adjustment.

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

/// Maximum work of full bundle adjustment, in products of two 6x6 blocks: that of 2000 keyframes (1.3e8 for laps of 40
/// m, decision 11).
const MAX_WORK: u64 = 200_000_000;

pub(super) struct Proposal<'a> {
    pub(super) view: &'a MapView,
    pub(super) keyframe: &'a Keyframe,
    /// The older keyframe of the same place.
    pub(super) with: &'a Keyframe,
    pub(super) verified: &'a Verified,
    /// The loop edge stored in the map.
    pub(super) edge: LoopEdge,
    /// Minimum number of landmarks to adjust a keyframe's pose in bundle adjustment.
    pub(super) min_held: usize,
    pub(super) scale_factor: f64,
}

impl Proposal<'_> {
    /// Merges duplicate landmarks and optimises keyframes and landmarks.
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

    /// The submaps to join, if the two keyframes belong to different ones: the younger goes into the older.
    fn join(&self) -> Option<Join> {
        let (a, b) = (self.with.submap, self.keyframe.submap);
        if a == b {
            return None;
        }
        let old_from_new = self.verified.new_from_old.inverse();
        let with_from_keyframe = self.with.world_from_camera * old_from_new;
        // Maps the reference frame of the new keyframe's submap to the older one's.
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

    /// Poses of both submaps in the reference frame of the one that stays.
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

    /// Duplicate landmarks as (new, older): the older ones are searched in the new keyframe and its neighbours at their
    /// loop-corrected poses.
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
                // Landmarks of the older place are never merged away, so no cycles arise.
                let is_old = self.verified.landmarks.binary_search(&seen).is_ok();
                if !is_old && m.chi2(&intrinsics, &p) <= m.gate() {
                    merges.entry(seen).or_insert(s.landmark);
                }
            }
        }
        merges
    }

    /// Keyframe poses after pose-graph optimisation. The new edge has no robust kernel; earlier loops do, as they may
    /// turn out wrong.
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
        // Edges are relative, so one node must be fixed.
        *fixed.first_mut()? = true;
        let mut graph = PoseGraph {
            nodes: poses,
            fixed,
            edges,
        };
        let options = PoseGraphOptions {
            max_iterations: 12,
            min_relative_gain: 1e-3,
            ..PoseGraphOptions::default()
        };
        let report = optimise_pose_graph(&mut graph, &options);
        (!matches!(report.outcome, PoseGraphOutcome::Refused(_))).then_some(graph.nodes)
    }

    /// Bundle adjustment of all keyframes and of all landmarks seen by at least two of them; returns the resulting
    /// correction.
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
/// Inverse of a covariance; `None` if singular.
fn information(covariance: &Mat6) -> Option<Mat6> {
    pose_covariance(covariance)
}

#[cfg(test)]
mod tests;
