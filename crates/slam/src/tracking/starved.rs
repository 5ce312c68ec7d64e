//! Frames with too few landmarks, from motion blur or people: recovers the local map, or bridges the frame with flow.

use super::choice::Vote;
use super::crowd::CROWD;
use super::ego_motion::EgoMotion;
use super::known_map::KnownMap;
use super::local_map::{LOCAL_RADIUS, SearchArea};
use super::pose::{PosePrior, Precision};
use super::sight::Sight;
use super::statistics::Sightings;
use super::{Fix, Tracker};
use crate::association::{Matches, measurement};
use crate::report::{HOLDING, LostReason};
use crate::static_filter::{FeatureVerdict, FlowPair};
use stillpoint_estimation::{
    AbsolutePoseOptions, Intrinsics, PoseObservation, Purpose, find_absolute_pose, rng,
};
use stillpoint_geometry::Se3;
use stillpoint_imaging::FrameId;
use stillpoint_map::KeyframeData;

/// Factor on the search radius to recover the map: landmarks are off by the drift since (decision 18).
const WIDER: f32 = 5.0;
/// Maximum distance of the recovered pose from the pose before, m: tracking does not drift farther. Decision 18
/// measured 5 to 10 cm after a second of people, of which this is five times as much. The last pose of a lost
/// camera is as uncertain.
pub(super) const MAX_DRIFT_M: f64 = 0.5;
/// Maximum angle of the recovered pose from the pose before, rad: tracking does not drift farther. It is 20 degrees
/// (decision 18).
const MAX_DRIFT_RAD: f64 = 0.35;

impl Tracker {
    fn is_starved(&self, fix: &Fix) -> bool {
        fix.matches.landmarks() < self.setup.tracking.min_inliers
    }

    /// Searches the local map in wide windows if a pose has too few inlier landmarks: after several bridged frames it
    /// has drifted, and matches in small windows are wrong. `data` and `fix` exclude dynamic features.
    pub(super) fn regain_map_when_starved(
        &mut self,
        frame: FrameId,
        data: &KeyframeData,
        fix: Fix,
    ) -> Fix {
        if !self.is_starved(&fix) {
            return fix;
        }
        match self.regain_map(frame, data, &fix) {
            Some(regained) => regained,
            None => fix,
        }
    }

    /// Searches all landmarks around in wide windows, estimates a pose by RANSAC, and searches again from there. `None`
    /// if the pose is too far, or has too few inliers.
    fn regain_map(&mut self, frame: FrameId, data: &KeyframeData, fix: &Fix) -> Option<Fix> {
        let _span = tracing::info_span!("regain").entered();
        let submap = self.beginning.submap;
        let KnownMap {
            surroundings, view, ..
        } = &mut self.map;
        // Selected by position, not by covisibility: after bridged frames the reference may share nothing with the
        // view.
        surroundings.update_around(view, submap, &fix.camera_from_world);
        let wide = self.search_map(
            data,
            &fix.camera_from_world,
            WIDER,
            Matches::new(data.len()),
        );
        let targets = wide.targets.iter().enumerate();
        let observations: Vec<PoseObservation> = targets
            .filter_map(|(i, t)| {
                Some(PoseObservation {
                    point: (*t)?.position,
                    measurement: measurement(data, i),
                })
            })
            .collect();
        let outcome = find_absolute_pose(
            &Intrinsics::from(&data.camera),
            &observations,
            &AbsolutePoseOptions::default(),
            rng(self.setup.seed, u64::from(frame.0), Purpose::REGAINED_MAP),
        );
        let found = outcome.found()?.camera_from_world;
        // A wide search has many mismatches; around the pose with most inliers, the usual radius suffices.
        let matches = self.search_map(data, &found, 1.0, Matches::new(data.len()));
        let matched = matches.count;
        let prior = PosePrior {
            turn: self.known_pose_in_crowd(),
            ..PosePrior::default()
        };
        let (matches, pose, precision) = self
            .memory
            .solver
            .solve_with_precision(data, &found, matches, prior);
        let drift = fix.camera_from_world * pose.inverse();
        let near = drift.translation.norm() < MAX_DRIFT_M && drift.rotation.angle() < MAX_DRIFT_RAD;
        let enough = matches.count >= self.setup.tracking.min_inliers;
        (near && enough).then_some(Fix {
            camera_from_world: pose,
            inliers: matches.count,
            matches,
            matched,
            precision,
            // Visibility predicted from the earlier pose is invalid.
            sightings: Sightings::default(),
        })
    }

    /// Searches the local map from a pose, without counting observations.
    fn search_map(
        &mut self,
        data: &KeyframeData,
        camera_from_world: &Se3,
        factor: f32,
        mut matches: Matches,
    ) -> Matches {
        let area = SearchArea {
            bounds: self.front_end.observer.bounds(),
            level_scales: self.front_end.observer.level_scales(),
            radius_px: factor * LOCAL_RADIUS,
        };
        let open = |_: &_| Sight::Open;
        self.map.surroundings.search(
            data,
            camera_from_world,
            &area,
            &mut matches,
            open,
            |_, _| {},
        );
        matches
    }

    /// Bridges a frame with too few landmarks by flow to surfaces of the last frame. It drifts, so it is only used if
    /// the map fails. `data` and `fix` exclude dynamic features, `motion` and `verdicts` include them.
    pub(super) fn bridge_when_starved(
        &mut self,
        data: &KeyframeData,
        motion: &EgoMotion,
        verdicts: &[FeatureVerdict],
        fix: Fix,
    ) -> Fix {
        let starved = self.is_starved(&fix);
        let Some(vote) = motion.by_flow.as_ref().filter(|_| starved) else {
            return fix;
        };
        let mut pairs = motion.pairs.clone();
        let (search, images) = self.front_end.observer.flow();
        search.search(&images, &motion.rest, &mut pairs);
        let matches = self.add_flow_points(&pairs, verdicts, fix.matches);
        let matched = matches.count;
        // Flow drifts, so priors apply.
        let prior = PosePrior {
            turn: self.known_pose(),
            place: self.known_place(&vote.camera_from_world),
        };
        let (matches, pose, precision) =
            self.memory
                .solver
                .solve_with_precision(data, &vote.camera_from_world, matches, prior);
        let enough = self.setup.tracking.min_inliers;
        if matches.count < enough && vote.agreed >= enough {
            return Self::follow_vote(vote, data.len());
        }
        Fix {
            camera_from_world: pose,
            inliers: matches.count,
            matches,
            matched,
            precision,
            // Predictions from a pose not confirmed by the map are no evidence against landmarks.
            sightings: Sightings::default(),
        }
    }

    /// Accepts the pose of the flow vote, if too few static features remain to measure it better: it has enough
    /// agreeing pairs, regardless of the filter.
    pub(super) fn follow_vote(vote: &Vote, features: usize) -> Fix {
        Fix {
            camera_from_world: vote.camera_from_world,
            inliers: vote.agreed,
            matches: Matches::new(features),
            matched: vote.voted,
            precision: Precision {
                information: vote.information,
                scatter: None,
            },
            sightings: Sightings::default(),
        }
    }

    /// Assigns to unmatched features the point found by flow on a surface of the last frame.
    fn add_flow_points(
        &self,
        pairs: &[Option<FlowPair>],
        verdicts: &[FeatureVerdict],
        mut matches: Matches,
    ) -> Matches {
        let (Some(last), Some(previous)) = (self.state.last(), &self.images.previous) else {
            return matches;
        };
        let velocity = self.state.velocity();
        let reader = self.depth_reader(previous, velocity.as_ref());
        let shutter = self.front_end.shutter();
        let kept = pairs.iter().zip(verdicts).filter(|(_, v)| !v.dynamic);
        for (i, (pair, _)) in kept.enumerate() {
            let Some(pair) = pair.filter(|_| matches.targets[i].is_none()) else {
                continue;
            };
            let raw = pair.before_raw.map(f64::from).into();
            if let Some(reading) = reader.read(raw, pair.before_exposed)
                // A distant point from a single depth is too uncertain.
                && reading.z < self.setup.sensor.close_depth
            {
                let raw_y = f64::from(pair.before_raw[1]);
                let z = reading.z;
                let seen = shutter.at_stamp(pair.before_exposed, raw_y, z, velocity.as_ref());
                matches.assign_point(i as u32, last.world_from_camera.transform(&seen));
            }
        }
        matches
    }

    /// Replaces a pose that contradicts the sensors by the bound vote: the majority of the image may be a person
    /// walking along. Many landmarks overrule wheels.
    pub(super) fn refuse_riding(
        &self,
        motion: &EgoMotion,
        fix: Fix,
        features: usize,
    ) -> Result<Fix, LostReason> {
        let reason = self.contradicts(&fix.camera_from_world);
        let Some(reason) = reason.filter(|_| motion.follows) else {
            return Ok(fix);
        };
        let wheels = reason == LostReason::AgainstOdometry;
        // At the beginning of a map, most landmarks may be on people; backward tracking only happens while that is
        // undecided.
        let may_ride = self.goes_back && self.moving_share > CROWD;
        let many = fix.matches.landmarks() >= HOLDING as usize;
        let borne_out = many && !may_ride && !self.was_blind();
        if wheels && borne_out {
            return Ok(fix);
        }
        let enough = self.setup.tracking.min_inliers;
        let bound = motion.by_flow.as_ref();
        let bound = bound.filter(|v| v.is_bound && v.agreed >= enough);
        // Frame by frame a vote may drift with a person; comparison over a second reveals it.
        let bound = bound.filter(|v| !wheels || self.contradicts(&v.camera_from_world).is_none());
        let vote: &Vote = bound.ok_or(reason)?;
        Ok(Self::follow_vote(vote, features))
    }
}
