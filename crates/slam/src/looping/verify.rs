//! Geometric verification: do two keyframes see the same things from two places, and from which?

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

/// Points of both keyframes that agree on one rigid motion, and landmarks that are found with it, at least (decision 46): fewer measure no motion.
/// Whether it is that of a place is for [`LoopEvidence`](crate::LoopEvidence) to say.
const MIN_INLIERS: usize = 10;
/// Radius of the search around where the motion found from pairs puts a landmark, px on level 0. Chosen: twice the radius once it is refined.
const WIDE_RADIUS_PX: f32 = 8.0;
/// The same once the motion is refined, px on level 0: that with which ORB-SLAM2 (Mur-Artal, Tardos 2017) fuses landmarks at a loop.
pub(super) const RADIUS_PX: f32 = 4.0;

/// A motion between two keyframes that geometry confirms.
pub(super) struct Verified {
    /// Maps camera coordinates of the older keyframe to those of the new one.
    pub(super) new_from_old: Se3,
    /// The inverse of its covariance, for a left perturbation `[translation; rotation]`.
    pub(super) information: Mat6,
    /// Landmarks of the older place, by id.
    pub(super) landmarks: Vec<LandmarkId>,
}

impl Verified {
    /// The motion, as the map keeps it.
    pub(super) fn edge(&self, old: KeyframeId, new: KeyframeId, inliers: u32) -> LoopEdge {
        LoopEdge {
            old,
            new,
            old_from_new: self.new_from_old.inverse(),
            // Sums of products are symmetric but for their last bits.
            information: (self.information + self.information.transpose()) * 0.5,
            inliers,
        }
    }
}

/// A landmark and the feature that sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub(super) landmark: LandmarkId,
    pub(super) feature: u32,
    distance: u32,
}

impl LoopCloser {
    /// Finds the motion between two keyframes by their points, then by all landmarks around the older one.
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
        // Wide first, since a motion from single depths is rough; then narrow, where fewer wrong matches fit.
        for radius in [WIDE_RADIUS_PX, RADIUS_PX] {
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
            // After each search: a pose that so few support would lead the next one astray.
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

    /// The motion on which most pairs of points agree.
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
        // Several candidates are tried for one keyframe.
        let address = address(new.id.0, old.id.0);
        let camera = Intrinsics::from(&b.camera);
        let rng = rng(self.seed, address, Purpose::RIGID);
        let outcome = find_rigid(&camera, &pairs, &options, rng);
        let found = outcome.found()?;
        report.rigid_inliers = found.inlier_count as u32;
        Some(found.b_from_a)
    }

    /// Features of both that look alike and fall into the same words.
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

/// A search for landmarks in a keyframe, as if it were somewhere else.
pub(super) struct Search<'a> {
    pub(super) view: &'a MapView,
    pub(super) keyframe: &'a Keyframe,
    /// The pose from which the landmarks are looked for.
    pub(super) camera_from_world: Se3,
    /// Radius, px on level 0.
    pub(super) radius_px: f32,
    pub(super) scale_factor: f64,
}

impl Search<'_> {
    /// The landmarks that are found, each in one feature and each feature with one landmark, in the order of features; and how
    /// many are in the image.
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
