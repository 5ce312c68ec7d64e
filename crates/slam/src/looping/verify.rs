//! Geometric verification of loop candidates.

use super::recognise::By;
use super::revisit::landmarks_of_then;
use super::{LoopCloser, group_of};
use crate::association::{STRICT_DISTANCE, landmarks_of, measurement, measurement_in, window_of};
use crate::report::{LoopOutcome, LoopReport};
use stillpoint_estimation::{
    Intrinsics, PoseObservation, PoseOptions, Purpose, RigidOptions, RigidPair, address,
    find_rigid, optimise_pose, rng,
};
use stillpoint_features::best_two;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::{Keyframe, KeyframeId, LandmarkId, LoopEdge, MapView};

/// Minimum number of points that agree on a rigid motion, and of landmarks found with it (decision 46): fewer measure
/// no motion. Whether it is the same place is decided by [`LoopEvidence`](crate::LoopEvidence).
const MIN_INLIERS: usize = 10;
/// Search radius with the refined motion, px on level 0: that with which ORB-SLAM2 (Mur-Artal, Tardos 2017) fuses
/// landmarks at a loop. After the motion from pairs it is twice as large.
pub(super) const RADIUS_PX: f32 = 4.0;

/// A geometrically verified motion between two keyframes.
pub(super) struct Verified {
    /// Maps camera coordinates of the older keyframe to those of the new one.
    pub(super) new_from_old: Se3,
    /// Inverse covariance, for a left perturbation `[translation; rotation]`.
    pub(super) information: Mat6,
    /// Landmarks of the older place, sorted by id.
    pub(super) landmarks: Vec<LandmarkId>,
}

impl Verified {
    /// The loop edge stored in the map.
    pub(super) fn edge(&self, old: KeyframeId, new: KeyframeId, inliers: u32) -> LoopEdge {
        LoopEdge {
            old,
            new,
            old_from_new: self.new_from_old.inverse(),
            // Removes rounding asymmetry.
            information: (self.information + self.information.transpose()) * 0.5,
            inliers,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub(super) landmark: LandmarkId,
    pub(super) feature: u32,
    distance: u32,
}

impl LoopCloser {
    /// Estimates the motion between two keyframes from point pairs, then from all landmarks around the older one.
    pub(super) fn verify(
        &self,
        view: &MapView,
        new: &Keyframe,
        old: &Keyframe,
        by: By,
        report: &mut LoopReport,
    ) -> Result<Verified, LoopOutcome> {
        let _span = tracing::info_span!("verify").entered();
        let start = self
            .rigid_motion(view, new, old, by, report)
            .ok_or(LoopOutcome::NoRigidMotion)?;
        let landmarks = match by {
            By::Words => landmarks_of(view, &group_of(old)),
            By::Pose => landmarks_of_then(view, old, new),
        };
        let (mut new_from_old, mut information) = (start, Mat6::zeros());
        // First wide, since a motion from single depths is rough; then narrow, to admit fewer mismatches.
        for radius in [2.0 * RADIUS_PX, RADIUS_PX] {
            let camera_from_world = new_from_old * old.world_from_camera.inverse();
            let search = Search {
                view,
                keyframe: new,
                camera_from_world,
                radius_px: radius,
                scale_factor: self.scale_factor,
            };
            let (seen, expected) = search.landmarks(&landmarks);
            let observation = |s: &Sighting| {
                Some(PoseObservation {
                    point: view.landmark_position(s.landmark)?,
                    measurement: measurement(&new.data, s.feature as usize),
                })
            };
            let observations: Vec<PoseObservation> = seen.iter().filter_map(observation).collect();
            let camera = Intrinsics::from(&new.data.camera);
            let fit = optimise_pose(
                &camera,
                &camera_from_world,
                &observations,
                &PoseOptions::default(),
            );
            report.inliers = fit.inlier_count as u32;
            report.expected = expected;
            // Checked after each search: a poorly supported pose would mislead the next one.
            if fit.inlier_count < MIN_INLIERS {
                return Err(LoopOutcome::FewInliers);
            }
            new_from_old = fit.camera_from_world * old.world_from_camera;
            information = fit.information;
        }
        report.edge = Some(new_from_old.inverse());
        Ok(Verified {
            new_from_old,
            information,
            landmarks,
        })
    }

    /// Rigid motion with the most inlier pairs.
    fn rigid_motion(
        &self,
        view: &MapView,
        new: &Keyframe,
        old: &Keyframe,
        by: By,
        report: &mut LoopReport,
    ) -> Option<Se3> {
        let b = &new.data;
        let pairs = match by {
            By::Words => self.pairs_by_words(new, old)?,
            By::Pose => self.pairs_by_pose(view, new, old),
        };
        let options = RigidOptions {
            min_inliers: MIN_INLIERS,
            ..RigidOptions::default()
        };
        // Several candidates may be verified for one keyframe.
        let address = address(new.id.0, old.id.0);
        let camera = Intrinsics::from(&b.camera);
        let rng = rng(self.seed, address, Purpose::RIGID);
        let outcome = find_rigid(&camera, &pairs, &options, rng);
        let found = outcome.found()?;
        report.rigid_inliers = found.inlier_count as u32;
        Some(found.b_from_a)
    }

    /// Similar features of both keyframes that share a vocabulary word.
    fn pairs_by_words(&self, new: &Keyframe, old: &Keyframe) -> Option<Vec<RigidPair>> {
        let (a, b) = (&old.data, &new.data);
        let (of_old, of_new) = (self.index.get(old.id)?, self.index.get(new.id)?);
        let mut pairs = Vec::new();
        for pair in of_old.candidate_pairs(of_new) {
            let (i, j) = (usize::from(pair.a), usize::from(pair.b));
            let alike = a.descriptors[i].distance(&b.descriptors[j]) <= STRICT_DISTANCE;
            if !alike || !a.mappable[i] || !b.mappable[j] {
                continue;
            }
            if let (Some(point_a), Some(point_b)) = (a.point_in_camera(i), b.point_in_camera(j)) {
                pairs.push(RigidPair {
                    point_a,
                    point_b,
                    measurement_a: measurement_in(a, i, &b.camera),
                    measurement_b: measurement(b, j),
                });
            }
        }
        Some(pairs)
    }
}

/// A search for landmarks in a keyframe with a hypothetical pose.
pub(super) struct Search<'a> {
    pub(super) view: &'a MapView,
    pub(super) keyframe: &'a Keyframe,
    pub(super) camera_from_world: Se3,
    /// Radius, px on level 0.
    pub(super) radius_px: f32,
    pub(super) scale_factor: f64,
}

impl Search<'_> {
    /// One-to-one matches of landmarks and features, in the order of features; and the number of landmarks in the
    /// image.
    pub(super) fn landmarks(&self, landmarks: &[LandmarkId]) -> (Vec<Sighting>, u32) {
        let data = &self.keyframe.data;
        let mut by_feature: Vec<Option<Sighting>> = vec![None; data.len()];
        let mut expected = 0;
        let observes = |id: LandmarkId| self.keyframe.matches.contains(&Some(id));
        for id in landmarks {
            let (Some(l), Some(position)) =
                (self.view.landmark(*id), self.view.landmark_position(*id))
            else {
                continue;
            };
            let p = self.camera_from_world.transform(&position);
            let Some(window) = window_of(data, l, &p, self.radius_px, self.scale_factor) else {
                continue;
            };
            expected += 1;
            let best = best_two(&data.searched(), &window, &l.descriptor, |i| {
                data.mappable[i as usize]
            });
            let Some(best) = best.filter(|b| b.distance <= STRICT_DISTANCE) else {
                continue;
            };
            let slot = &mut by_feature[best.index as usize];
            // Ties go to the older landmark, which came first.
            if slot.is_none_or(|s| best.distance < s.distance) && !observes(*id) {
                *slot = Some(Sighting {
                    landmark: *id,
                    feature: best.index,
                    distance: best.distance,
                });
            }
        }
        (by_feature.into_iter().flatten().collect(), expected)
    }
}

#[cfg(test)]
mod tests;
