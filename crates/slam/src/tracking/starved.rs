//! Frames in which too few landmarks are found, in motion blur or among people: the map is looked for again, or the frame is bridged.

use super::ego_motion::EgoMotion;
use super::known_map::KnownMap;
use super::local_map::{LOCAL_RADIUS, SearchArea};
use super::pose::{PosePrior, Precision};
use super::sight::Sight;
use super::statistics::Sightings;
use super::vote::Vote;
use super::{Fix, Tracker};
use crate::association::{Matches, measurement};
use crate::static_filter::{FeatureVerdict, FlowPair};
use stillpoint_estimation::{
    AbsolutePoseOptions, Intrinsics, PoseObservation, Purpose, find_absolute_pose, rng,
};
use stillpoint_geometry::Se3;
use stillpoint_imaging::FrameId;
use stillpoint_map::KeyframeData;

/// Factor on the radius of the search when the map is looked for again: landmarks are then off by what was drifted meanwhile (decision 18).
const WIDER: f32 = 5.0;
/// Largest distance of a pose from the one before the wide search, m: tracking does not drift farther. Decision 18 measured 5 to 10 cm after a second
/// of people, of which this is five times as much.
const MAX_DRIFT_M: f64 = 0.5;
/// Largest angle between a pose and the one before the wide search, rad: tracking does not drift farther. It is 20 degrees (decision 18).
const MAX_DRIFT_RAD: f64 = 0.35;

impl Tracker {
    /// Whether fewer landmarks agree with a pose than make one.
    fn is_starved(&self, fix: &Fix) -> bool {
        fix.matches.landmarks() < self.setup.tracking.min_inliers
    }

    /// Looks for the local map in a wide neighbourhood when too few landmarks agree with the pose: after some bridged frames it has
    /// drifted away from the map, and what matches in small windows is then wrong. `data` and `fix` are without the dynamic features.
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

    /// Searches all landmarks around widely, finds the pose that most of them agree on, and searches again from there. None when it is not
    /// near, or too few agree.
    fn regain_map(&mut self, frame: FrameId, data: &KeyframeData, fix: &Fix) -> Option<Fix> {
        let _span = tracing::info_span!("regain").entered();
        let submap = self.beginning.submap;
        let KnownMap {
            surroundings, view, ..
        } = &mut self.map;
        // By where keyframes are, not by what they share: after bridged frames the reference may share nothing with what is in view.
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
        // Much of what a wide search matches is wrong; around a pose that many agree on, the usual radius is enough.
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
            // What was expected from the pose before says nothing.
            sightings: Sightings::default(),
        })
    }

    /// Searches the local map from a pose, without noting what is seen.
    fn search_map(
        &mut self,
        data: &KeyframeData,
        camera_from_world: &Se3,
        factor: f32,
        mut matches: Matches,
    ) -> Matches {
        let area = SearchArea {
            bounds: self.front_end.observer.bounds(),
            level_sigmas: self.front_end.observer.level_sigmas(),
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

    /// Bridges a frame in which too few landmarks are found, in motion blur or among people, with what flow found of the last
    /// frame's surfaces. It drifts, so it is not used where the map holds. `data` and `fix` are without the dynamic features,
    /// `motion` and `verdicts` are of all.
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
        self.front_end
            .observer
            .flow_to_previous(&motion.rest, &mut pairs);
        let matches = self.add_flow_points(&pairs, verdicts, fix.matches);
        let matched = matches.count;
        // Flow drifts, and so does the pose that it leads to.
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
            // What should be seen from a pose that the map does not bear out says nothing against landmarks.
            sightings: Sightings::default(),
        }
    }

    /// Takes the pose that the vote of the flow leads to, where too little stands still around it to measure it better: as many pairs
    /// agree with it as make a pose, whatever the filter says of them.
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

    /// Gives features without a match the point where flow found them on a surface of the last frame.
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
                // A farther point from one depth alone is too uncertain to hold a pose.
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
}
