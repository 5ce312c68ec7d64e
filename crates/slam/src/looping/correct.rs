//! From a verified motion to a correction: merged landmarks, a pose graph, and bundle adjustment of the whole map.

use super::group_of;
use super::points::Points;
use super::verify::{RADIUS_PX, Search, Verified};
use crate::association::measurement;
use crate::report::{BundleCounts, LoopOutcome, LoopReport};
use std::collections::BTreeMap;
use stillpoint_estimation::{
    BundleOptions, BundleProblem, EdgeKernel, Intrinsics, PoseGraph, PoseGraphEdge,
    PoseGraphOptions, PoseGraphOutcome, adjust_bundle, optimise_pose_graph,
};
use stillpoint_geometry::{Mat6, Se3, Vec3, Vec6};
use stillpoint_map::{
    Correction, Join, Keyframe, KeyframeId, LandmarkCorrection, LandmarkId, LoopEdge, MapView,
    PoseCorrection, SubmapId,
};

/// Keyframes that share at least so many landmarks are tied in the pose graph beside the tree of parents.
const MIN_SHARED: u32 = 100;
/// What a motion between two keyframes may be wrong by: m, and rad per axis. Between neighbours it is what they drift.
const SIGMA_M: f64 = 0.005;
/// A quarter of a degree.
const SIGMA_RAD: f64 = 0.0044;
/// What a loop may cost the pose graph: squared Mahalanobis distance to what the map can have drifted. Beyond that the two places are
/// equal, not the same: false loops cost a thousand times as much as true ones.
const MAX_COST: f64 = 50.0;
/// Work of full bundle adjustment, at most, in products of two 6x6 blocks: what 2000 keyframes take.
const MAX_WORK: u64 = 200_000_000;

/// A loop to be closed.
pub(super) struct Proposal<'a> {
    pub(super) view: &'a MapView,
    /// The new keyframe.
    pub(super) keyframe: &'a Keyframe,
    /// The older one that shows the same place.
    pub(super) with: &'a Keyframe,
    pub(super) verified: &'a Verified,
    /// Loops closed before.
    pub(super) earlier: &'a [LoopEdge],
    pub(super) scale_factor: f64,
}

/// The live keyframes of the submaps that take part, numbered.
pub(super) struct Nodes<'a> {
    pub(super) keyframes: Vec<&'a Keyframe>,
    pub(super) index: BTreeMap<KeyframeId, u32>,
}

impl Proposal<'_> {
    /// Merges what is seen twice, and moves keyframes and landmarks to where they fit best.
    pub(super) fn correct(
        &self,
        report: &mut LoopReport,
    ) -> Result<(LoopEdge, Correction), LoopOutcome> {
        let _span = tracing::info_span!("correct").entered();
        let join = self.join();
        let nodes = Nodes::new(self.view, self.with.submap, self.keyframe.submap);
        let edge = LoopEdge {
            old: self.with.id,
            new: self.keyframe.id,
            old_from_new: self.verified.new_from_old.inverse(),
            // Sums of products are symmetric but for their last bits.
            information: (self.verified.information + self.verified.information.transpose()) * 0.5,
            inliers: report.inliers,
        };
        let (poses, cost) = match join {
            // Nothing ties two submaps yet that could contradict.
            Some(join) => (Self::put_together(&nodes, join), 0.0),
            None => self
                .straighten(&nodes, &edge)
                .ok_or(LoopOutcome::Contradicted)?,
        };
        report.cost = cost;
        if cost > MAX_COST {
            return Err(LoopOutcome::Contradicted);
        }
        let merges = self.merges();
        report.merges = merges.len() as u32;
        let correction = Correction {
            join,
            measured: Some(Box::new(edge)),
            ..self.refine(&nodes, poses, merges, report)
        };
        Ok((edge, correction))
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

    /// The poses of all keyframes after the pose graph, and what it cost to believe the loop.
    ///
    /// Nothing of the graph speaks against it but the drift that it takes away, so the new edge has no kernel: its cost has
    /// no upper bound then, and tells an equal place from the same one. Loops closed before may turn out to have been wrong.
    fn straighten(&self, nodes: &Nodes<'_>, edge: &LoopEdge) -> Option<(Vec<Se3>, f64)> {
        let mut edges = nodes.essential_edges();
        let earlier = self.earlier.iter();
        edges.extend(earlier.filter_map(|l| nodes.loop_edge(self.view, l, EdgeKernel::Scaled)));
        edges.push(nodes.loop_edge(self.view, edge, EdgeKernel::Square)?);
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
        // Bundle adjustment comes after; and a false loop, which takes longest, is none the better for being exact.
        let options = PoseGraphOptions {
            max_iterations: 12,
            min_relative_gain: 1e-3,
            ..PoseGraphOptions::default()
        };
        let report = optimise_pose_graph(&mut graph, &options);
        if matches!(report.outcome, PoseGraphOutcome::Refused(_)) {
            return None;
        }
        Some((graph.nodes, report.final_cost))
    }

    /// Bundle adjustment of all keyframes and of all landmarks that two of them see, and the correction that it amounts to.
    fn refine(
        &self,
        nodes: &Nodes<'_>,
        mut poses: Vec<Se3>,
        merges: BTreeMap<LandmarkId, LandmarkId>,
        report: &mut LoopReport,
    ) -> Correction {
        let points = Points::gather(
            self.view,
            &self.keyframe.data.camera,
            nodes,
            &poses,
            &merges,
        );
        let count = poses.len();
        // Free poses come first: the first keyframe, which holds the map in place, becomes the last.
        let place = |node: u32| (node as usize + count - 1) % count;
        let mut problem = BundleProblem {
            camera: Intrinsics::from(&self.keyframe.data.camera),
            poses: (0..count)
                .map(|i| poses[(i + 1) % count].inverse())
                .collect(),
            free_poses: count - 1,
            points: points.positions,
            observations: points.observations,
        };
        for o in &mut problem.observations {
            o.pose = place(o.pose) as u32;
        }
        let options = BundleOptions {
            max_work: MAX_WORK,
            ..BundleOptions::default()
        };
        let result = adjust_bundle(&mut problem, &options);
        for (node, pose) in poses.iter_mut().enumerate().skip(1) {
            *pose = problem.poses[place(node as u32)].inverse().normalized();
        }
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
        let positions = points.landmarks.iter().zip(&problem.points);
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

impl<'a> Nodes<'a> {
    /// Those of one or two submaps; of the submap that began first, the first keyframe comes first.
    fn new(view: &'a MapView, a: SubmapId, b: SubmapId) -> Self {
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

    /// The tree of parents, and the pairs that share most.
    fn essential_edges(&self) -> Vec<PoseGraphEdge> {
        let mut edges = Vec::new();
        for (b, k) in self.keyframes.iter().enumerate() {
            let mut others: Vec<KeyframeId> = k.parent.into_iter().collect();
            let strong = k
                .covisible
                .iter()
                // Each pair once, from its younger end.
                .filter(|(o, n)| *n >= MIN_SHARED && *o < k.id);
            others.extend(strong.map(|c| c.0).filter(|o| Some(*o) != k.parent));
            for other in others {
                let Some(a) = self.index.get(&other).filter(|a| **a != b as u32) else {
                    continue;
                };
                let a_from_world = self.keyframes[*a as usize].world_from_camera.inverse();
                edges.push(PoseGraphEdge {
                    a: *a,
                    b: b as u32,
                    a_from_b: a_from_world * k.world_from_camera,
                    information: information(),
                    kernel: EdgeKernel::Square,
                });
            }
        }
        edges
    }

    /// A loop between the keyframes that its ends are now, through tombstones.
    fn loop_edge(
        &self,
        view: &MapView,
        edge: &LoopEdge,
        kernel: EdgeKernel,
    ) -> Option<PoseGraphEdge> {
        let end = |id: KeyframeId| {
            let live = view.resolve_keyframe(id)?;
            let live_from_world = view.world_from_keyframe(live)?.inverse();
            // The end may have been culled; the measurement is then moved to the keyframe on which its tombstone hangs.
            let live_from_id = live_from_world * view.world_from_keyframe(id)?;
            Some((*self.index.get(&live)?, live_from_id))
        };
        let ((a, a_from_old), (b, b_from_new)) = (end(edge.old)?, end(edge.new)?);
        (a != b).then(|| PoseGraphEdge {
            a,
            b,
            a_from_b: a_from_old * edge.old_from_new * b_from_new.inverse(),
            information: information(),
            kernel,
        })
    }

    fn corrections(&self, poses: &[Se3]) -> Vec<PoseCorrection> {
        let pairs = self.keyframes.iter().zip(poses);
        pairs
            .map(|(k, pose)| PoseCorrection {
                keyframe: k.id,
                before: k.world_from_camera,
                after: *pose,
            })
            .collect()
    }

    fn landmark_correction(
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

/// What is known of a motion between two keyframes, for a perturbation `[translation; rotation]`.
fn information() -> Mat6 {
    let (t, r) = (1.0 / (SIGMA_M * SIGMA_M), 1.0 / (SIGMA_RAD * SIGMA_RAD));
    Mat6::from_diagonal(&Vec6::new(t, t, t, r, r, r))
}
