//! Creates landmarks from depth and by triangulation between covisible keyframes. Criteria follow ORB-SLAM2 (Mur-Artal,
//! Tardos 2017), but depth is used at any distance.

use super::Mapper;
use crate::association::{STRICT_DISTANCE, measurement};
use std::sync::Arc;
use stillpoint_estimation::{Intrinsics, triangulate_midpoint};
use stillpoint_geometry::{Mat3, Se3, Vec3, robust, so3};
use stillpoint_map::{Keyframe, KeyframeId, NewLandmark};

/// Minimum parallax of triangulated points: cos(1.15 deg), as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
const MAX_PARALLAX_COSINE: f64 = 0.9998;
/// Minimum ratio of baseline to median depth for triangulation, a share, as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
const MIN_BASELINE_SHARE: f64 = 0.01;

impl Mapper {
    /// Creates landmarks from unmatched features with depth, nearest first. Distant ones are included and weighted by
    /// their noise.
    pub(super) fn create_from_depth(&mut self, id: KeyframeId) -> u32 {
        let _span = tracing::info_span!("create").entered();
        let Some(keyframe) = self.map.view().keyframe(id).map(Arc::clone) else {
            return 0;
        };
        let data = &keyframe.data;
        let mut order: Vec<(f64, usize)> = (0..data.len())
            .filter_map(|i| Some((data.depth(i)?, i)))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut created = 0;
        for &(z, i) in &order {
            if keyframe.matches[i].is_some() || !data.mappable[i] {
                continue;
            }
            let point = data.camera.backproject(data.position(i), z);
            let new = NewLandmark {
                position: keyframe.world_from_camera.transform(&point),
                observation: (id, i as u32),
            };
            if let Some(landmark) = self.map.insert_landmark(&new) {
                self.young.push(landmark);
                created += 1;
            }
        }
        created
    }

    /// Triangulates features without depth against the neighbours.
    pub(super) fn triangulate(&mut self, id: KeyframeId) -> u32 {
        let _span = tracing::info_span!("triangulate").entered();
        let mut created = 0;
        for neighbour in self.neighbours(id, self.effort.neighbours as usize) {
            let view = self.map.view();
            let (Some(a), Some(b)) = (view.keyframe(id), view.keyframe(neighbour)) else {
                continue;
            };
            let (a, b) = (Arc::clone(a), Arc::clone(b));
            for (i, j, position) in triangulate_pair(&a, &b, self.scale_factor) {
                let new = NewLandmark {
                    position,
                    observation: (id, i),
                };
                let Some(landmark) = self.map.insert_landmark(&new) else {
                    continue;
                };
                if self.map.add_observation(landmark, neighbour, j) {
                    self.map.refresh_landmark(landmark);
                    self.young.push(landmark);
                    created += 1;
                } else {
                    // Without depth, a single observation does not determine a point.
                    self.map.cull_landmark(landmark);
                }
            }
        }
        created
    }
}

/// Points seen by unmatched features of both keyframes: `(feature in a, feature in b, world position)`.
fn triangulate_pair(a: &Keyframe, b: &Keyframe, scale_factor: f64) -> Vec<(u32, u32, Vec3)> {
    let baseline = (a.centre() - b.centre()).norm();
    // Assumes a depth of 1 m if unknown.
    if baseline < MIN_BASELINE_SHARE * b.data.median_depth(&mut Vec::new()).unwrap_or(1.0) {
        return Vec::new();
    }
    let b_from_a = b.world_from_camera.inverse() * a.world_from_camera;
    // Without depth, only the epipolar line constrains the match.
    let essential: Mat3 = so3::hat(&b_from_a.translation) * b_from_a.rotation_matrix();
    let free = |k: &Keyframe| -> Vec<usize> {
        (0..k.data.len())
            .filter(|i| {
                k.matches[*i].is_none() && k.data.depth(*i).is_none() && k.data.mappable[*i]
            })
            .collect()
    };
    let (free_a, free_b) = (free(a), free(b));
    let rays_b: Vec<Vec3> = free_b
        .iter()
        .map(|j| b.data.camera.ray(b.data.position(*j)))
        .collect();
    let mut best_of_b: Vec<Option<(u32, usize)>> = vec![None; free_b.len()];
    for (ia, i) in free_a.iter().enumerate() {
        let line = essential * a.data.camera.ray(a.data.position(*i));
        let norm = (line.x * line.x + line.y * line.y).sqrt() / b.data.camera.fx;
        let descriptor = &a.data.descriptors[*i];
        let mut best: Option<(u32, usize)> = None;
        for (jb, (j, ray)) in free_b.iter().zip(&rays_b).enumerate() {
            let distance_px = line.dot(ray).abs() / norm;
            let sigma = f64::from(b.data.sigma_px[*j]);
            if distance_px * distance_px > robust::CHI2_95_1 * sigma * sigma {
                continue;
            }
            let distance = descriptor.distance(&b.data.descriptors[*j]);
            if distance <= STRICT_DISTANCE && best.is_none_or(|x| distance < x.0) {
                best = Some((distance, jb));
            }
        }
        // Mutual best matches, so that no point is created twice.
        if let Some((distance, jb)) = best
            && best_of_b[jb].is_none_or(|x| distance < x.0)
        {
            best_of_b[jb] = Some((distance, ia));
        }
    }
    best_of_b
        .iter()
        .enumerate()
        .filter_map(|(jb, m)| {
            let (i, j) = (free_a[(*m)?.1], free_b[jb]);
            let position = triangulate_match(a, i, b, j, scale_factor)?;
            Some((i as u32, j as u32, position))
        })
        .collect()
}

/// Triangulates one match if the parallax suffices, the residuals pass their gates and the levels fit the distances.
fn triangulate_match(
    a: &Keyframe,
    i: usize,
    b: &Keyframe,
    j: usize,
    scale_factor: f64,
) -> Option<Vec3> {
    let ray = |k: &Keyframe, f: usize| {
        k.world_from_camera.rotation * k.data.camera.ray(k.data.position(f))
    };
    let t = triangulate_midpoint(&a.centre(), &ray(a, i), &b.centre(), &ray(b, j))?;
    if t.cos_parallax > MAX_PARALLAX_COSINE {
        return None;
    }
    for (k, f) in [(a, i), (b, j)] {
        let camera_from_world: Se3 = k.world_from_camera.inverse();
        let p = camera_from_world.transform(&t.point);
        let m = measurement(&k.data, f);
        if m.chi2(&Intrinsics::from(&k.data.camera), &p) > m.gate() {
            return None;
        }
    }
    // The nearer keyframe sees a patch larger, on a coarser level; a contradiction between levels and distances is a
    // wrong match.
    let size = |k: &Keyframe, f: usize| {
        (t.point - k.centre()).norm()
            * libm::pow(scale_factor, f64::from(k.data.keypoints[f].level))
    };
    let ratio = size(a, i) / size(b, j);
    let tolerance = 1.5 * scale_factor;
    (1.0 / tolerance..=tolerance)
        .contains(&ratio)
        .then_some(t.point)
}

#[cfg(test)]
mod tests;
