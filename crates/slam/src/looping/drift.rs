//! Drift of paths: covariance of the motion between two keyframes along the ties between them.
//!
//! The covariance of a tie comes from the landmarks shared by its keyframes and their fit, with a floor proportional to
//! the motion: errors common to all features (calibration, shutter, depth delay) do not average out.

use super::nodes::Nodes;
use super::shared;
use crate::covariance::moved;
use crate::least_first::Reached;
use std::collections::BinaryHeap;
use stillpoint_estimation::{EdgeKernel, pose_covariance};
use stillpoint_geometry::{Mat6, Se3, Vec3};
use stillpoint_map::{LoopEdge, MapView};

pub(super) struct Tie {
    pub(super) a: u32,
    pub(super) b: u32,
    pub(super) a_from_b: Se3,
    /// For a left perturbation `[translation; rotation]` of `a_from_b`.
    pub(super) covariance: Mat6,
    /// Kernel in the pose graph; robust for loops, which may be wrong.
    pub(super) kernel: EdgeKernel,
}

pub(super) struct Drift<'a> {
    pub(super) nodes: Nodes<'a>,
    pub(super) ties: Vec<Tie>,
    /// Per node: indices of its ties.
    of_node: Vec<Vec<u32>>,
    /// Root mean square distance of the nodes from their centroid, m.
    pub(super) spread: f64,
}

impl<'a> Drift<'a> {
    /// Ties between neighbours and those of earlier loops.
    pub(super) fn new(view: &'a MapView, nodes: Nodes<'a>, earlier: &[LoopEdge]) -> Self {
        let _span = tracing::info_span!("drift").entered();
        let pairs = nodes.essential_pairs();
        let covariances = shared::covariances(view, &nodes, &pairs);
        let tie = |((a, b), covariance): (&(u32, u32), Mat6)| Tie {
            a: *a,
            b: *b,
            a_from_b: nodes.motion(*a, *b),
            covariance,
            kernel: EdgeKernel::Square,
        };
        let mut ties: Vec<Tie> = pairs.iter().zip(covariances).map(tie).collect();
        for edge in earlier {
            let Some((a, b, a_from_b)) = nodes.loop_between(view, edge) else {
                continue;
            };
            let covariance = loop_covariance(&edge.information, &edge.old_from_new);
            ties.push(Tie {
                a,
                b,
                a_from_b,
                covariance,
                kernel: EdgeKernel::Scaled,
            });
        }
        let mut of_node = vec![Vec::new(); nodes.keyframes.len()];
        for (i, tie) in ties.iter().enumerate() {
            of_node[tie.a as usize].push(i as u32);
            of_node[tie.b as usize].push(i as u32);
        }
        let centres = || nodes.keyframes.iter().map(|k| k.centre());
        let count = nodes.keyframes.len().max(1) as f64;
        let middle = centres().sum::<Vec3>() / count;
        let spread = centres().map(|c| (c - middle).norm_squared()).sum::<f64>() / count;
        Self {
            ties,
            of_node,
            spread: spread.sqrt(),
            nodes,
        }
    }

    /// Covariance of the motion between two nodes along the least uncertain path, for a left perturbation of
    /// `a_from_b`; `None` if they are not connected. An upper bound, since the information of other paths, which is
    /// correlated, is not used.
    pub(super) fn between(&self, a: u32, b: u32) -> Option<Mat6> {
        let count = self.nodes.keyframes.len();
        let mut best = vec![f64::INFINITY; count];
        let mut from = vec![u32::MAX; count];
        let reached = |cost, node| Reached {
            cost,
            node,
            value: (),
        };
        let mut queue = BinaryHeap::from([reached(0.0, a)]);
        best[a as usize] = 0.0;
        while let Some(Reached { cost, node, .. }) = queue.pop() {
            if node == b {
                break;
            }
            if cost > best[node as usize] {
                continue;
            }
            for i in &self.of_node[node as usize] {
                let tie = &self.ties[*i as usize];
                let next = if tie.a == node { tie.b } else { tie.a };
                let cost = cost + self.length(&tie.covariance);
                if cost < best[next as usize] {
                    best[next as usize] = cost;
                    from[next as usize] = *i;
                    queue.push(reached(cost, next));
                }
            }
        }
        if !best[b as usize].is_finite() {
            return None;
        }
        // In world coordinates a tie's perturbation is the same from both ends.
        let mut sum = Mat6::zeros();
        let mut node = b;
        while node != a {
            let tie = &self.ties[from[node as usize] as usize];
            let pose = self.nodes.keyframes[tie.a as usize].world_from_camera;
            sum += moved(&tie.covariance, &pose);
            node = if tie.a == node { tie.b } else { tie.a };
        }
        let a_from_world = self.nodes.keyframes[a as usize].world_from_camera.inverse();
        Some(moved(&sum, &a_from_world))
    }

    /// Squared Mahalanobis distance of a loop's motion from the map's, with the combined covariance of path and loop;
    /// and that covariance.
    pub(super) fn cost(&self, view: &MapView, edge: &LoopEdge) -> Option<(f64, Mat6)> {
        let (a, b, measured) = self.nodes.loop_between(view, edge)?;
        let covariance = self.between(a, b)? + loop_covariance(&edge.information, &measured);
        let cost = distance(&measured, &self.motion(a, b), &covariance);
        Some((cost, covariance))
    }

    pub(super) fn motion(&self, a: u32, b: u32) -> Se3 {
        self.nodes.motion(a, b)
    }

    /// Uncertainty that a tie adds to a path, m^2. Rotations are scaled by the spread of the nodes, their lever arm.
    fn length(&self, covariance: &Mat6) -> f64 {
        let (d, lever) = (covariance.diagonal(), self.spread);
        d[0] + d[1] + d[2] + lever * lever * (d[3] + d[4] + d[5])
    }
}

/// Squared Mahalanobis distance between two motions, for a left perturbation; infinite if the covariance is singular.
pub(super) fn distance(measured: &Se3, expected: &Se3, covariance: &Mat6) -> f64 {
    let off = (*measured * expected.inverse()).log();
    let solved = pose_covariance(covariance).map(|information| off.dot(&(information * off)));
    solved.filter(|d| d.is_finite()).unwrap_or(f64::INFINITY)
}

/// Covariance of a loop's motion `old_from_new` from the information of `new_from_old`.
pub(super) fn loop_covariance(information: &Mat6, old_from_new: &Se3) -> Mat6 {
    let measured = pose_covariance(information).map(|c| moved(&c, old_from_new));
    measured.unwrap_or_else(Mat6::zeros) + shared::of_loop(old_from_new)
}

#[cfg(test)]
mod tests;
