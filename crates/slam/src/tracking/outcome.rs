//! Conclusion of a frame: starts a map, accepts a pose, or reports a loss.

use super::config::MIN_INITIAL_POINTS;
use super::ego_motion::EgoMotion;
use super::keyframe::Coverage;
use super::motion::CameraMotion;
use super::state::{LastFrame, State};
use super::statistics::Statistics;
use super::{Notes, Solution, Tracker};
use crate::anchored_pose::AnchoredPose;
use crate::evidence::Cells;
use crate::inertial::Inertial;
use crate::messages::{NewKeyframe, Tracked};
use crate::odometry::Odometry;
use crate::report::{FrameReport, LostReason, Outcome};
use crate::static_filter::CapturePose;
use crate::trajectory::TrajectoryEntry;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::{KeyframeData, LandmarkId, SubmapId};

pub(super) struct Ending {
    outcome: Outcome,
    /// Capture pose; `None` if lost.
    place: Option<CapturePose>,
    keyframe: Option<NewKeyframe>,
}

impl Ending {
    pub(super) fn lost(since: FrameId, reason: LostReason) -> Self {
        Self {
            outcome: Outcome::Lost { since, reason },
            place: None,
            keyframe: None,
        }
    }
}

#[derive(Default)]
pub(super) struct SinceKeyframe {
    frame: Option<FrameId>,
    statistics: Statistics,
    coverage: Coverage,
}

impl Tracker {
    /// Starts a map or submap with a frame that has enough depth.
    pub(super) fn begin_submap(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        notes: &mut Notes,
    ) -> Ending {
        let motion = EgoMotion::unknown(Arc::clone(data));
        self.judge(frame, &motion, notes);
        let (data, _) = self.keep_static(&motion, notes);
        let (counts, enough) = (&notes.counts, MIN_INITIAL_POINTS);
        if (counts.with_depth as usize) < enough {
            let reason = if (counts.keypoints as usize) < enough {
                LostReason::FewFeatures
            } else {
                LostReason::FewDepths
            };
            return Ending::lost(self.state.lose(frame.id), reason);
        }
        let inliers = counts.with_depth;
        // The pose is exact by definition, so all points count as inliers.
        (notes.evidence.matched, notes.evidence.agreed) = (inliers, inliers);
        notes.evidence.cells = Cells::of(&data, |i| data.depths[i] > 0.0);
        let id = self.map.keyframe_id(frame.id);
        let place = CapturePose {
            anchored: AnchoredPose {
                keyframe: Some(id),
                reference: id,
                reference_from_camera: Se3::identity(),
                online_world_from_camera: Se3::identity(),
            },
            camera_from_depth: Se3::identity(),
        };
        let matches = vec![None; data.len()];
        self.forget_world();
        self.beginning.submap = Some(SubmapId(id.0));
        self.beginning.stamp = frame.stamp;
        self.keyframes.since.frame = Some(frame.id);
        self.keyframes.since.coverage = Coverage::of(place.anchored, 0);
        self.write_down(frame, &place, Some(inliers));
        let motion = CameraMotion::default();
        self.follow_from(frame, &data, matches.clone(), &place, motion);
        self.keyframes.first = Some(NewKeyframe {
            id,
            data: Arc::new(KeyframeData::clone(&data)),
            reference: None,
            reference_from_camera: place.anchored.reference_from_camera,
            matches,
            statistics: Vec::new(),
            exposure: self.front_end.exposure(None),
        });
        Ending {
            outcome: Outcome::Initialised,
            place: Some(place),
            keyframe: None,
        }
    }

    /// Accepts a pose: updates motion model and trajectory, and decides on a keyframe.
    pub(super) fn accept(
        &mut self,
        frame: &RgbdFrame,
        mut solution: Solution,
        notes: &Notes,
    ) -> Ending {
        let outcome = match (self.state.lost_since(), solution.recognised) {
            (None, None) => Outcome::Tracked,
            (since, with) => Outcome::Relocalised {
                since: since.unwrap_or(frame.id),
                with: with.unwrap_or(solution.reference),
            },
        };
        let camera_from_world = solution.camera_from_world;
        let motion = match outcome {
            Outcome::Tracked => self.moved_to(&camera_from_world, notes.evidence.information),
            // The camera's motion during the loss is unknown.
            _ => CameraMotion::default(),
        };
        if outcome != Outcome::Tracked {
            self.forget_motions();
        }
        self.sensors.carried = None;
        let measured = !solution.sightings.is_empty();
        self.learn_motion(notes, &camera_from_world.inverse(), measured);
        self.learn_readout(&mut solution);
        // Counted only for accepted poses: a rejected pose would count landmarks as missing that were never in view.
        let worth = self.pace.worth();
        let statistics = &mut self.keyframes.since.statistics;
        let list = statistics.count(std::mem::take(&mut solution.sightings), worth);
        self.memory.sightings.give(list);
        let (view, reference) = (&self.map.view, solution.reference);
        // A recognised place may lie in another submap.
        if let Some(id) = view.submap_of(reference)
            && self.beginning.submap != Some(id)
        {
            self.beginning.submap = Some(id);
        }
        let world_from_camera = camera_from_world.inverse();
        // Relative to a keyframe, so that the pose follows later corrections of the map.
        let world_from_reference = view.world_from_keyframe(reference).unwrap_or_default();
        let mut anchored = AnchoredPose {
            keyframe: None,
            reference,
            reference_from_camera: world_from_reference.inverse() * world_from_camera,
            online_world_from_camera: world_from_camera,
        };
        let keyframe = self.make_keyframe(frame, &solution, &anchored);
        anchored.keyframe = keyframe.as_ref().map(|k| k.id);
        let place = CapturePose {
            anchored,
            camera_from_depth: self
                .front_end
                .camera_from_depth(frame, motion.at_last().as_ref()),
        };
        self.write_down(frame, &place, Some(notes.counts.inliers));
        self.follow_from(frame, &solution.data, solution.matches, &place, motion);
        Ending {
            outcome,
            place: Some(place),
            keyframe,
        }
    }

    /// Accepts a propagated pose, which creates no keyframe.
    pub(super) fn accept_carried(
        &mut self,
        frame: &RgbdFrame,
        solution: Solution,
        since: FrameId,
    ) -> Ending {
        let motion = self.moved_to(&solution.camera_from_world, None);
        let world_from_camera = solution.camera_from_world.inverse();
        let view = &self.map.view;
        let world_from_reference = view.world_from_keyframe(solution.reference);
        let place = CapturePose {
            anchored: AnchoredPose {
                keyframe: None,
                reference: solution.reference,
                reference_from_camera: world_from_reference.unwrap_or_default().inverse()
                    * world_from_camera,
                online_world_from_camera: world_from_camera,
            },
            camera_from_depth: self
                .front_end
                .camera_from_depth(frame, motion.at_last().as_ref()),
        };
        self.write_down(frame, &place, None);
        self.follow_from(frame, &solution.data, solution.matches, &place, motion);
        Ending {
            outcome: Outcome::Carried { since },
            place: Some(place),
            keyframe: None,
        }
    }

    /// The frame as a new keyframe, if one is due.
    fn make_keyframe(
        &mut self,
        frame: &RgbdFrame,
        solution: &Solution,
        pose: &AnchoredPose,
    ) -> Option<NewKeyframe> {
        let Solution { data, matches, .. } = solution;
        let _span = tracing::info_span!("keyframe").entered();
        // If a person filled the view recently, the keyframe would map the person.
        if !self.map.grows || self.was_blind() || self.keyframes.first.is_some() {
            return None;
        }
        let since = |id: FrameId| frame.id.0.saturating_sub(id.0);
        let frames = self.keyframes.since.frame.map(since);
        let pace = self.pace.seconds();
        let gap = frames.map_or(f64::INFINITY, |n| f64::from(n) * pace);
        let (config, view) = (&self.setup.keyframes, &self.map.view);
        let of_reference = view.keyframe(pose.reference)?;
        let tracked = matches.iter().flatten().count();
        let here = &pose.online_world_from_camera;
        let coverage = &mut self.keyframes.since.coverage;
        coverage.note(tracked);
        let depths = &mut self.memory.depths;
        let mut new_view = || {
            let depth = data.median_depth(depths);
            coverage.lacks_view(config, (view, of_reference), here, depth)
        };
        let needed =
            gap >= config.min_seconds && (coverage.lacks_landmarks(config, tracked) || new_view());
        if !needed && !self.keyframes.wanted {
            return None;
        }
        self.keyframes.wanted = false;
        let id = self.map.keyframe_id(frame.id);
        self.keyframes.since.frame = Some(frame.id);
        let own = AnchoredPose {
            keyframe: Some(id),
            ..*pose
        };
        self.keyframes.since.coverage = Coverage::of(own, tracked);
        Some(NewKeyframe {
            id,
            // A compact copy, so that the frame's buffers can be reused.
            data: Arc::new(data.copied()),
            reference: Some(pose.reference),
            reference_from_camera: pose.reference_from_camera,
            matches: matches.clone(),
            statistics: self.keyframes.since.statistics.take(),
            exposure: solution.exposure,
        })
    }

    /// Appends the frame to the trajectory; `inliers` is `None` for a propagated pose.
    fn write_down(&mut self, frame: &RgbdFrame, place: &CapturePose, inliers: Option<u32>) {
        self.trajectory.push(TrajectoryEntry {
            frame: frame.id,
            stamp: frame.stamp,
            pose: place.anchored,
            inliers: inliers.unwrap_or(0),
            carried: inliers.is_none(),
        });
    }

    /// Makes this frame the reference for tracking the next.
    fn follow_from(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        matches: Vec<Option<LandmarkId>>,
        place: &CapturePose,
        motion: CameraMotion,
    ) {
        let last = LastFrame {
            stamp: frame.stamp,
            time: self.front_end.clock.times(frame).colour,
            data: Arc::clone(data),
            matches,
            pose: place.anchored,
            world_from_camera: place.anchored.online_world_from_camera,
        };
        let before = std::mem::replace(&mut self.state, State::Tracking { last, motion });
        if let State::Tracking { last, .. } = before {
            self.memory.landmarks.give(last.matches);
        }
    }

    /// Handles a frame with a repeated image: no pose, and tracking continues from the frame before.
    pub(super) fn pass_over(&mut self, frame: &RgbdFrame, notes: Notes) -> Tracked {
        let first = *self.images.repeated.get_or_insert(frame.id);
        let since = self.state.lost_since().unwrap_or(first);
        let moving_share = self.moving_share;
        let tracked = self.conclude(frame, notes, Ending::lost(since, LostReason::Repeated));
        self.moving_share = moving_share;
        tracked
    }

    pub(super) fn conclude(
        &mut self,
        frame: &RgbdFrame,
        mut notes: Notes,
        ending: Ending,
    ) -> Tracked {
        let has_map = !self.map.is_empty();
        let waited = self.release_first_keyframe(frame.id);
        // A frame that starts a map has no inliers, which says nothing about the number of keypoints needed.
        let agreed = match ending.outcome {
            Outcome::Initialised => None,
            _ if self.images.repeated.is_some() => None,
            _ => has_map.then_some(notes.counts.inliers),
        };
        self.front_end.note_inliers(agreed);
        self.moving_share = notes.counts.moving_share();
        self.note_quiet(frame.stamp - self.beginning.stamp);
        // The filter state is adopted even without a pose: detections it used are consumed.
        if let Some(filter) = notes.filter.take() {
            let before = std::mem::replace(&mut self.filter, filter);
            self.memory.filter.give(before);
        }
        if let Some(place) = &ending.place {
            self.filter.remember(place, &mut self.memory.filter);
        }
        self.keep_all_unless_judged(&mut notes.judgement);
        let unused = self.filter.end_frame();
        notes.counts.detections_too_late = unused.too_late;
        notes.counts.detections_without_pose = unused.without_pose;
        notes.evidence.has_map = has_map;
        // A frame without a pose belongs to no submap, though the tracker keeps the last one.
        let submap = self.beginning.submap.filter(|_| ending.place.is_some());
        let report = FrameReport {
            frame: frame.id,
            stamp: frame.stamp,
            outcome: ending.outcome,
            world_from_camera: ending.place.map(|p| p.anchored.online_world_from_camera),
            undecided: None,
            verdicts: notes.judgement.verdicts,
            objects: notes.judgement.objects,
            segments: notes.judgement.segments,
            counts: notes.counts,
            still: notes.still,
            is_keyframe: ending.place.is_some_and(|p| p.anchored.keyframe.is_some()),
            submap,
            map_version: self.map.view.version(),
            inertial: self.sensors.inertial.as_ref().map(Inertial::report),
            odometry: self.sensors.odometry.as_ref().map(Odometry::report),
        };
        Tracked {
            report,
            evidence: notes.evidence,
            keyframe: waited.or(ending.keyframe),
        }
    }
}

#[cfg(test)]
mod tests;
