//! A submap as a pose graph of measurements: edges come from what two keyframes observed, not from the map's poses. Edges derived from the
//! poses would agree with them everywhere and tell an optimiser nothing.

use std::collections::BTreeMap;
use stillpoint::datasets::pose_graph::GraphEdge;
use stillpoint::estimation::{
    Intrinsics, Measurement, PoseObservation, PoseOptions, optimise_pose,
};
use stillpoint::geometry::{Mat6, Se3};
use stillpoint::map::{Keyframe, KeyframeData, KeyframeId, LoopEdge, MapView, SubmapId};

/// Minimum number of inliers for a measured motion between two keyframes.
const MIN_INLIERS: usize = 20;

pub(super) struct Graph {
    /// Of covisible pairs and of parents, by the older keyframe; then those of loops.
    pub(super) edges: Vec<GraphEdge>,
    pub(super) loops: usize,
    /// Number of parent edges that are taken from the map's poses, because too little was measured.
    pub(super) as_estimated: usize,
}

impl Graph {
    /// Measures the relative poses of covisible keyframes of a submap, and adds its loops.
    pub(super) fn measure(view: &MapView, submap: Option<SubmapId>) -> Self {
        let mut graph = Self {
            edges: Vec::new(),
            loops: 0,
            as_estimated: 0,
        };
        for ((a, b), is_parent) in pairs(view, submap) {
            let (Some(a), Some(b)) = (view.keyframe(a), view.keyframe(b)) else {
                continue;
            };
            match between(a, b) {
                Some((from_to, information)) => graph.add(a, b, from_to, information),
                // Without this edge the graph may fall apart.
                None if is_parent => {
                    let from_to = a.world_from_camera.inverse() * b.world_from_camera;
                    graph.add(a, b, from_to, Mat6::identity());
                    graph.as_estimated += 1;
                }
                None => {}
            }
        }
        let loops = view
            .loops()
            .filter_map(|edge| loop_edge(view, submap, edge));
        let before = graph.edges.len();
        graph.edges.extend(loops);
        graph.loops = graph.edges.len() - before;
        graph
    }

    fn add(&mut self, a: &Keyframe, b: &Keyframe, from_to: Se3, information: Mat6) {
        self.edges.push(GraphEdge {
            from: a.id.0,
            to: b.id.0,
            from_to,
            information,
        });
    }
}

/// The pairs of keyframes of a submap that share landmarks or are parent and child, the smaller id first; true for the latter.
fn pairs(view: &MapView, submap: Option<SubmapId>) -> BTreeMap<(KeyframeId, KeyframeId), bool> {
    let mut pairs = BTreeMap::new();
    for k in view.keyframes().filter(|k| Some(k.submap) == submap) {
        let ordered = |other: KeyframeId| (k.id.min(other), k.id.max(other));
        for (other, _) in &k.covisible {
            pairs.entry(ordered(*other)).or_insert(false);
        }
        let parent = k.parent.and_then(|p| view.resolve_keyframe(p));
        if let Some(parent) = parent.filter(|p| *p != k.id) {
            pairs.insert(ordered(parent), true);
        }
    }
    pairs
}

/// The relative pose of two keyframes and its information matrix, from points that `a` saw with depth where `b` saw them. `None` with too
/// few inliers. The map's poses only start the search.
fn between(a: &Keyframe, b: &Keyframe) -> Option<(Se3, Mat6)> {
    let seen = a.matches.iter().enumerate();
    let points: BTreeMap<_, _> = seen
        .filter_map(|(i, landmark)| Some(((*landmark)?, a.data.point_in_camera(i)?)))
        .collect();
    let observation = |(i, landmark): (usize, &Option<_>)| {
        Some(PoseObservation {
            point: *points.get(&(*landmark)?)?,
            measurement: measurement(&b.data, i),
        })
    };
    let observations: Vec<PoseObservation> = b
        .matches
        .iter()
        .enumerate()
        .filter_map(observation)
        .collect();
    if observations.len() < MIN_INLIERS {
        return None;
    }
    let fit = optimise_pose(
        &Intrinsics::from(&b.data.camera),
        &(b.world_from_camera.inverse() * a.world_from_camera),
        &observations,
        &PoseOptions::default(),
    );
    let b_from_a = fit.camera_from_world;
    let holds = fit.inlier_count >= MIN_INLIERS && b_from_a.is_finite();
    // The fit assumes exact points, but they are as noisy as the observations fitted to them.
    holds.then(|| (b_from_a.inverse(), fit.information * 0.5))
}

fn measurement(data: &KeyframeData, feature: usize) -> Measurement {
    let sigma = f64::from(data.depth_sigmas[feature]);
    let depth = data.depth(feature).map(|z| (z, sigma));
    let sigma_px = f64::from(data.sigma_px[feature]);
    Measurement::new(data.position(feature), sigma_px, depth)
        .on_edge(data.keypoints[feature].edge.vector().into())
}

/// A loop edge between the live keyframes at its ends: a culled keyframe is replaced by its anchor. `None` between submaps, and where both
/// ends have the same anchor.
fn loop_edge(view: &MapView, submap: Option<SubmapId>, edge: &LoopEdge) -> Option<GraphEdge> {
    let end = |id: KeyframeId| {
        let live = view.keyframe(view.resolve_keyframe(id)?)?;
        let live = (Some(live.submap) == submap).then_some(live)?;
        if live.id == id {
            // Exact, so that the measurement is exported unchanged.
            return Some((id, Se3::identity()));
        }
        let live_from_id = live.world_from_camera.inverse() * view.world_from_keyframe(id)?;
        Some((live.id, live_from_id))
    };
    let ((from, from_from_old), (to, to_from_new)) = (end(edge.old)?, end(edge.new)?);
    (from != to).then(|| GraphEdge {
        from: from.0,
        to: to.0,
        from_to: from_from_old * edge.old_from_new * to_from_new.inverse(),
        // Transforms a perturbation at the new keyframe to the keyframe that it is anchored to.
        information: {
            let new_from_to = to_from_new.inverse().adjoint();
            let information = new_from_to.transpose() * edge.information * new_from_to;
            (information + information.transpose()) * 0.5
        },
    })
}
