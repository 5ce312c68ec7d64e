//! Selects the keyframes with enough support for bundle adjustment, and moves the others along.

use super::nodes::Nodes;
use super::points::Points;
use super::shared::Known;
use stillpoint_estimation::Intrinsics;
use stillpoint_geometry::Se3;

/// Maximum standard deviation of a keyframe's pose from its landmarks, as a share of their median depth and in radians
/// (decision 22). It moves the image by 2 % of the focal length.
const MAX_SHARE: f64 = 0.02;

/// Per node: whether its pose is supported. The first node is; another one is if at least `min_held` landmarks shared
/// with supported nodes determine its pose. A well-connected group with few links to the rest is therefore not
/// supported.
pub(super) fn held(
    points: &Points,
    poses: &[Se3],
    camera: &Intrinsics,
    min_held: usize,
) -> Vec<bool> {
    let count = poses.len();
    let mut held = vec![false; count];
    let mut of_node: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (i, o) in points.observations.iter().enumerate() {
        of_node[o.pose as usize].push(i as u32);
    }
    let mut carried = vec![false; points.positions.len()];
    let mut reached = vec![0u32; count];
    let mut by_point: Vec<Vec<u32>> = vec![Vec::new(); points.positions.len()];
    for o in &points.observations {
        by_point[o.point as usize].push(o.pose);
    }
    let mut queue: Vec<usize> = (0..count.min(1)).collect();
    while let Some(node) = queue.pop() {
        if held[node] {
            continue;
        }
        held[node] = true;
        for o in of_node[node]
            .iter()
            .map(|i| &points.observations[*i as usize])
        {
            if std::mem::replace(&mut carried[o.point as usize], true) {
                continue;
            }
            for other in &by_point[o.point as usize] {
                reached[*other as usize] += 1;
            }
        }
        // A node may gain support in a later pass. Each pass adds at least one node, or is the last.
        let next = (0..count).filter(|n| !held[*n] && reached[*n] as usize >= min_held.max(1));
        let tells = |n: &usize| {
            let camera_from_world = poses[*n].inverse();
            let seen = of_node[*n]
                .iter()
                .map(|i| &points.observations[*i as usize])
                .filter(|o| carried[o.point as usize])
                .map(|o| {
                    let p = camera_from_world.transform(&points.positions[o.point as usize]);
                    (p, o.measurement)
                });
            is_known(camera, seen)
        };
        if queue.is_empty() {
            queue = next.filter(tells).collect();
        }
    }
    held
}

/// Whether landmarks determine a pose. Poor fits count as well: the pose predates bundle adjustment, which moves it.
fn is_known(
    camera: &Intrinsics,
    seen: impl Iterator<
        Item = (
            stillpoint_geometry::Vec3,
            stillpoint_estimation::Measurement,
        ),
    >,
) -> bool {
    // Replaces measurements by predictions: only the geometry matters here, not the fit.
    let mut depths = Vec::new();
    let fitting = seen.filter(|(p, _)| p.z > 1e-3).map(|(p, mut m)| {
        depths.push(p.z);
        let iz = 1.0 / p.z;
        m.pixel.x = camera.fx * p.x * iz + camera.cx;
        m.pixel.y = camera.fy * p.y * iz + camera.cy;
        m.inverse_depth = iz;
        (p, m)
    });
    let Some(covariance) = Known::gather(camera, fitting).covariance() else {
        return false;
    };
    depths.sort_unstable_by(f64::total_cmp);
    let depth = depths[depths.len() / 2];
    let d = covariance.diagonal();
    let (t, r) = (d[0].max(d[1]).max(d[2]), d[3].max(d[4]).max(d[5]));
    t <= MAX_SHARE * depth * MAX_SHARE * depth && r <= MAX_SHARE * MAX_SHARE
}

/// Moves unsupported nodes rigidly with their nearest supported ancestor, else with the node before.
pub(super) fn follow(nodes: &Nodes<'_>, held: &[bool], before: &[Se3], after: &mut [Se3]) {
    for node in 0..after.len() {
        if held[node] {
            continue;
        }
        let leader = ancestor(nodes, held, node)
            .or_else(|| (0..node).rev().find(|n| held[*n]))
            .or_else(|| held.iter().position(|h| *h));
        if let Some(l) = leader {
            after[node] = (after[l] * before[l].inverse() * before[node]).normalized();
        }
    }
}

fn ancestor(nodes: &Nodes<'_>, held: &[bool], node: usize) -> Option<usize> {
    let mut at = node;
    // A tree is no deeper than its number of nodes.
    for _ in 0..held.len() {
        let parent = nodes.keyframes[at].parent?;
        at = *nodes.index.get(&parent)? as usize;
        if held[at] {
            return Some(at);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.
    use super::super::tests::map;
    use super::*;
    use stillpoint_estimation::{BundleObservation, BundleOptions, Measurement, adjust_bundle};
    use stillpoint_geometry::{Vec2, Vec3};
    use stillpoint_map::{LandmarkId, SubmapId};

    const CAMERA: Intrinsics = Intrinsics {
        fx: 525.0,
        fy: 525.0,
        cx: 319.5,
        cy: 239.5,
    };
    const COUNT: usize = 6;
    const MIN_HELD: usize = 30;

    /// Nodes 0.1 m apart.
    fn poses() -> Vec<Se3> {
        let at = |i: usize| Se3::new(Default::default(), Vec3::new(0.1 * i as f64, 0.0, 0.0));
        (0..COUNT).map(at).collect()
    }

    /// 48 points about 2 m away for each `group`.
    fn points(groups: usize) -> Vec<Vec3> {
        let point = |i: usize| {
            let (x, y) = ((i % 8) as f64, (i % 48 / 8) as f64);
            Vec3::new(0.2 * x - 0.5, 0.2 * y - 0.5, 2.0 + 0.1 * ((x * y) % 3.0))
        };
        (0..48 * groups).map(point).collect()
    }

    /// Observations of the nodes: `seen(node, point)` is the index of the point observed in its place.
    fn gather(positions: Vec<Vec3>, seen: impl Fn(usize, usize) -> Option<usize>) -> Points {
        let mut observations = Vec::new();
        for point in 0..positions.len() {
            for (node, pose) in poses().iter().enumerate() {
                let Some(really) = seen(node, point) else {
                    continue;
                };
                let p = pose.inverse().transform(&positions[really]);
                let pixel = Vec2::new(
                    CAMERA.fx * p.x / p.z + CAMERA.cx,
                    CAMERA.fy * p.y / p.z + CAMERA.cy,
                );
                observations.push(BundleObservation {
                    pose: node as u32,
                    point: point as u32,
                    measurement: Measurement::new(pixel, 1.0, Some((p.z, 0.01))),
                });
            }
        }
        let ids = (0..positions.len() as u32).map(LandmarkId::new);
        Points {
            landmarks: ids.collect(),
            positions,
            observations,
        }
    }

    /// Distance that bundle adjustment moves the last node, m.
    fn moved(points: Points, min_held: usize) -> f64 {
        let map = map(COUNT as u32);
        let nodes = Nodes::new(map.view(), SubmapId(0), SubmapId(0));
        let before = poses();
        let held = held(&points, &before, &CAMERA, min_held);
        let (mut problem, places) = points.problem(CAMERA, &before, &held);
        let _ = adjust_bundle(&mut problem, &BundleOptions::default());
        let mut after = before.clone();
        for (pose, place) in after.iter_mut().zip(&places).skip(1) {
            if let Some(place) = place {
                *pose = problem.poses[*place as usize].inverse();
            }
        }
        follow(&nodes, &held, &before, &mut after);
        (after[COUNT - 1].translation - before[COUNT - 1].translation).norm()
    }

    /// Four wrong observations do not move a keyframe. Control: without the limit they do.
    #[test]
    fn weakly_observed_keyframe_follows_its_neighbours() {
        let seen = || {
            gather(points(1), |node, point| {
                let wrong = [8, 14, 32, 38].contains(&point).then_some(point + 1);
                if node == COUNT - 1 {
                    wrong
                } else {
                    Some(point)
                }
            })
        };
        assert!(moved(seen(), MIN_HELD) < 1e-6);
        // They agree on a pose 0.2 m beside the true one, so residuals do not reveal them.
        let free = |n: usize| held(&seen(), &poses(), &CAMERA, n);
        assert!(!free(MIN_HELD)[COUNT - 1] && free(4)[COUNT - 1]);
        let distance = moved(seen(), 4);
        assert!(distance > 0.1, "{distance}");
    }

    /// Two keyframes that see the same points, but share only four with the others, are not supported. Control: with
    /// all points they are.
    #[test]
    fn group_linked_by_four_points_is_not_supported() {
        let shares = |count: usize| {
            let points = gather(points(2), |node, point| {
                let of_group = node >= COUNT - 2;
                let is_seen = (point < 48) != of_group || (of_group && point < count);
                is_seen.then_some(point)
            });
            held(&points, &poses(), &CAMERA, MIN_HELD)
        };
        let [front, back] = [[true; COUNT - 2].as_slice(), &[false; 2]];
        assert_eq!(shares(4), [front, back].concat());
        assert_eq!(shares(40), [true; COUNT]);
    }

    /// Many points in one spot do not determine a pose. Control: the same number all over the image does.
    #[test]
    fn concentrated_points_do_not_support_a_keyframe() {
        let spot = |size: f64| {
            let all = points(1).into_iter();
            let positions = all.map(|p| Vec3::new(p.x * size, p.y * size, p.z));
            let points = gather(positions.collect(), |_, point| Some(point));
            held(&points, &poses(), &CAMERA, MIN_HELD)[COUNT - 1]
        };
        assert!(spot(1.0));
        assert!(!spot(0.01));
    }

    /// An unsupported node keeps its pose relative to the nearest supported ancestor.
    #[test]
    fn unsupported_keyframe_moves_with_its_ancestor() {
        let map = map(COUNT as u32);
        let nodes = Nodes::new(map.view(), SubmapId(0), SubmapId(0));
        let before = poses();
        let shift = Se3::new(Default::default(), Vec3::new(0.0, 0.3, 0.0));
        let mut after: Vec<Se3> = before.iter().map(|p| shift * *p).collect();
        let expected = after.clone();
        (after[3], after[4]) = (before[3], before[4]);
        follow(
            &nodes,
            &[true, true, true, false, false, true],
            &before,
            &mut after,
        );
        for (found, expected) in after.iter().zip(&expected) {
            assert!((found.translation - expected.translation).norm() < 1e-12);
        }
    }
}
