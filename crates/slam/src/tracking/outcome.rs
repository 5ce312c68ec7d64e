//! What becomes of a frame: it begins a map, its pose is taken, or it is lost.

use super::ego_motion::EgoMotion;
use super::{LastFrame, Notes, Solution, Tracker};
use crate::event::{FrameReport, LostReason, Outcome};
use crate::evidence::Cells;
use crate::messages::{NewKeyframe, Tracked};
use crate::static_filter::Place;
use crate::trajectory::TrajectoryEntry;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, PieceId};

/// Keyframes that a piece of map gets early, whether they are needed or not: only keyframes are compared with the places of other
/// pieces, and it takes some in a row to be recognised.
const YOUNG_KEYFRAMES: u32 = 5;
/// Frames between these.
const YOUNG_GAP: u32 = 10;

impl Tracker {
    /// Begins a map, or a piece of one, with a frame that has enough depth.
    pub(super) fn initialise(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        mut notes: Notes,
    ) -> Tracked {
        let pose = Se3::identity();
        self.judge(frame, data, &EgoMotion::unknown(), &mut notes);
        let timing = self.calibration.timing();
        let data = self
            .observer
            .measure(frame, None, timing, Some(&notes.judgement.verdicts));
        let counts = &notes.counts;
        if (counts.with_depth as usize) < self.config.tracking.min_initial_points {
            let few = (counts.keypoints as usize) < self.config.tracking.min_initial_points;
            let reason = if few {
                LostReason::FewFeatures
            } else {
                LostReason::FewDepths
            };
            return self.lose(frame, notes, reason);
        }
        let inliers = counts.with_depth;
        self.keep_filter(&mut notes);
        // The pose is what the frame is said to have: all points agree with it.
        (notes.evidence.matched, notes.evidence.agreed) = (inliers, inliers);
        notes.evidence.cells = Cells::of(&data, |i| data.depths[i] > 0.0);
        let id = self.keyframe_id(frame.id);
        let matches = vec![None; data.len()];
        self.remember(frame, &data, matches.clone(), id, Se3::identity(), pose);
        self.filter.remember(&Place {
            reference: id,
            reference_from_camera: Se3::identity(),
            world_from_camera: pose,
            camera_from_depth: Se3::identity(),
        });
        self.last_keyframe = Some(frame.id);
        self.lost_since = None;
        self.unplaced = 0;
        self.piece = Some(PieceId(id.0));
        self.young = (self.view.keyframe_count() > 0).then_some(1);
        self.trajectory.push(TrajectoryEntry {
            frame: frame.id,
            stamp: frame.stamp,
            reference: id,
            reference_from_camera: Se3::identity(),
            online_world_from_camera: pose,
            inliers,
        });
        let keyframe = NewKeyframe {
            id,
            data,
            reference: None,
            reference_from_camera: pose,
            matches,
            statistics: Vec::new(),
        };
        let outcome = Outcome::Initialised;
        self.tell(frame, outcome, Some(pose), notes, Some(keyframe))
    }

    /// Takes a pose: motion model, trajectory, keyframe decision.
    pub(super) fn accept(
        &mut self,
        frame: &RgbdFrame,
        mut notes: Notes,
        solution: Solution,
        outcome: Outcome,
    ) -> Tracked {
        self.keep_filter(&mut notes);
        let counts = &notes.counts;
        let Solution {
            data,
            camera_from_world,
            reference,
            matches,
            sightings,
        } = solution;
        self.statistics.count(sightings);
        let world_from_camera = camera_from_world.inverse();
        match &self.last {
            Some(last) if self.lost_since.is_none() && outcome == Outcome::Tracked => {
                self.motion.learn(
                    &last.world_from_camera.inverse(),
                    &camera_from_world,
                    frame.stamp - last.stamp,
                )
            }
            _ => self.motion.forget(),
        }
        self.lost_since = None;
        self.unplaced = 0;
        let piece = self.view.piece_of(reference).or(self.piece);
        if piece != self.piece {
            (self.piece, self.young) = (piece, None);
        }
        let world_from_reference = self.view.world_from_keyframe(reference).unwrap_or_default();
        let reference_from_camera = world_from_reference.inverse() * world_from_camera;
        self.trajectory.push(TrajectoryEntry {
            frame: frame.id,
            stamp: frame.stamp,
            reference,
            reference_from_camera,
            online_world_from_camera: world_from_camera,
            inliers: counts.inliers,
        });
        self.filter.remember(&Place {
            reference,
            reference_from_camera,
            world_from_camera,
            camera_from_depth: self.camera_from_depth(frame, self.motion.velocity()),
        });
        let keyframe = self.make_keyframe(frame, &data, reference, reference_from_camera, &matches);
        self.remember(
            frame,
            &data,
            matches,
            reference,
            reference_from_camera,
            world_from_camera,
        );
        self.tell(frame, outcome, Some(world_from_camera), notes, keyframe)
    }

    /// The frame as a new keyframe, when one is due.
    fn make_keyframe(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        reference: KeyframeId,
        reference_from_camera: Se3,
        matches: &[Option<LandmarkId>],
    ) -> Option<NewKeyframe> {
        let _span = tracing::info_span!("keyframe").entered();
        if !self.grows {
            return None;
        }
        let gap = self
            .last_keyframe
            .map_or(u32::MAX, |id| frame.id.0.saturating_sub(id.0));
        let config = &self.config.keyframes;
        let of_reference = self.view.keyframe(reference)?;
        let needed = gap >= config.min_gap
            && config.is_due(
                &self.view,
                of_reference,
                data,
                matches,
                self.config.sensor.close_depth,
            );
        let young = self.young.is_some_and(|n| n < YOUNG_KEYFRAMES) && gap >= YOUNG_GAP;
        if !needed && !young {
            return None;
        }
        self.young = self.young.map(|n| n.saturating_add(1));
        self.last_keyframe = Some(frame.id);
        Some(NewKeyframe {
            id: self.keyframe_id(frame.id),
            data: Arc::clone(data),
            reference: Some(reference),
            reference_from_camera,
            matches: matches.to_vec(),
            statistics: self.statistics.take(),
        })
    }

    /// Keeps the frame as the last one with a pose.
    fn remember(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        matches: Vec<Option<LandmarkId>>,
        reference: KeyframeId,
        reference_from_camera: Se3,
        world_from_camera: Se3,
    ) {
        self.last = Some(LastFrame {
            stamp: frame.stamp,
            data: Arc::clone(data),
            matches,
            reference,
            reference_from_camera,
            world_from_camera,
        });
    }

    /// Notes that the frame gave no pose.
    pub(super) fn lose(
        &mut self,
        frame: &RgbdFrame,
        mut notes: Notes,
        reason: LostReason,
    ) -> Tracked {
        // What the filter saw counts, though no pose came of it: detections that it used are used up.
        self.keep_filter(&mut notes);
        self.motion.forget();
        let since = *self.lost_since.get_or_insert(frame.id);
        let outcome = Outcome::Lost { since, reason };
        self.tell(frame, outcome, None, notes, None)
    }

    /// Takes the static filter as of this frame for the next one.
    fn keep_filter(&mut self, notes: &mut Notes) {
        if let Some(filter) = notes.filter.take() {
            self.filter = filter;
        }
    }

    /// Says what became of the frame, which ends here.
    fn tell(
        &mut self,
        frame: &RgbdFrame,
        outcome: Outcome,
        world_from_camera: Option<Se3>,
        mut notes: Notes,
        keyframe: Option<NewKeyframe>,
    ) -> Tracked {
        let has_map = self.view.keyframe_count() > 0;
        let agreed = match outcome {
            Outcome::Initialised => None,
            _ => has_map.then_some(notes.counts.inliers),
        };
        self.demand.hear(agreed);
        let unused = self.filter.end_frame();
        notes.counts.detections_too_late = unused.too_late;
        notes.counts.detections_without_pose = unused.without_pose;
        let report = FrameReport {
            frame: frame.id,
            stamp: frame.stamp,
            outcome,
            world_from_camera,
            verdicts: notes.judgement.verdicts,
            objects: notes.judgement.objects,
            segments: notes.judgement.segments,
            counts: notes.counts,
            is_keyframe: keyframe.is_some(),
            piece: self.piece.filter(|_| world_from_camera.is_some()),
            map_version: self.view.version(),
        };
        notes.evidence.has_map = has_map;
        Tracked {
            report,
            evidence: notes.evidence,
            keyframe,
        }
    }
}
