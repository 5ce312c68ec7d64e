//! Counts frames under any driver, and collects the results of a pass.

use crate::console::{self, counted};
use crate::run::frames::Frames;
use crate::run::live_report::LiveRun;
use crate::run::session::{Poses, Session};
use crate::run::submaps;
use crate::run::summary::{
    DetectorJson, InertialJson, OdometryJson, ReadoutJson, StagesJson, TrackingJson,
};
use std::sync::Arc;
use stillpoint::datasets::StampedPose;
use stillpoint::detection::MOST_DETECTIONS;
use stillpoint::live::{Ended, LiveStatistics};
use stillpoint::map::{Map, MapView};
use stillpoint::slam::{
    CovarianceLog, Event, FrameReport, Health, RunLog, Subscriber, Timing, Trajectory,
};

#[derive(Clone, Default)]
pub(crate) struct Tally {
    pub(crate) frames: usize,
    pub(crate) skipped: usize,
    each: Frames,
    stages: StagesJson,
    covariances: CovarianceLog,
}

impl Subscriber for Tally {
    fn receive(&mut self, event: &Event) {
        tell(event);
        match event {
            Event::Frame(frame) => {
                self.take_report(&frame.report);
                self.take_covariance(&frame.health);
            }
            Event::Refused(refused) => self.skip(refused),
            Event::Rejudged { report, .. } => {
                self.stages.features.rejudged_landmarks += u64::from(report.landmarks);
            }
            Event::Revoked { report, .. } => {
                self.stages.features.revoked_keyframes += u64::from(report.keyframes);
            }
            Event::Looped(report) => self.stages.loops.add(report),
            // Reported by `tell` above.
            Event::Mapped { .. } | Event::Corrected { .. } => {}
            Event::Detected(detections) => {
                self.stages.detector.frames += 1;
                let count = detections.items.len();
                self.stages.detector.detections += count;
                self.stages.detector.left_out += count.saturating_sub(MOST_DETECTIONS);
            }
            Event::DetectorFailed(e) => {
                // Further failures are most likely the same; the report has their number.
                if self.stages.detector.failed_frames == 0 {
                    console::warn(&format!("the detector failed: {e}"));
                }
                self.stages.detector.failed_frames += 1;
            }
        }
    }
}

/// Logs a stage's work: a sentence, and all figures at trace level.
fn tell(event: &Event) {
    match event {
        Event::Frame(frame) => {
            let report = &frame.report;
            tracing::trace!(frame = %report.frame, counts = ?report.counts, outcome = ?report.outcome, "tracked");
        }
        Event::Mapped { report, .. } => {
            tracing::info!(
                "mapped keyframe {}: {}, {}",
                report.keyframe,
                counted(report.keyframes, "keyframe"),
                counted(report.landmarks, "landmark")
            );
            tracing::debug!(?report, "mapped");
        }
        Event::Revoked { report, .. } => {
            tracing::info!(
                "took back {} of the beginning",
                counted(report.keyframes as usize, "keyframe")
            );
            tracing::debug!(?report, "revoked");
        }
        Event::Looped(report) => {
            tracing::info!(
                "keyframe {} looks like keyframe {}: {}",
                report.keyframe,
                report.with,
                report.outcome
            );
            tracing::debug!(?report, "looped");
        }
        Event::Corrected { report, .. } => {
            tracing::info!(
                "corrected {}, merged {}",
                counted((report.keyframes + report.propagated) as usize, "keyframe"),
                counted(report.merged as usize, "landmark")
            );
            tracing::debug!(?report, "corrected");
        }
        _ => {}
    }
}

impl Tally {
    fn take_report(&mut self, report: &FrameReport) {
        self.frames += 1;
        self.stages.features.add(&report.counts);
        InertialJson::take(&mut self.stages.inertial, report);
        OdometryJson::take(&mut self.stages.odometry, report);
        self.stages.detector.too_late += u64::from(report.counts.detections_too_late);
        self.stages.detector.without_pose += u64::from(report.counts.detections_without_pose);
        self.each.take(report);
    }

    /// Takes the covariance of a frame whose pose was measured.
    fn take_covariance(&mut self, health: &Health) {
        if let (Some(_), Some(in_map)) = (&health.covariance, &health.covariance_in_map) {
            self.covariances.note(health.frame, in_map);
        }
    }

    fn skip(&mut self, reason: &dyn std::fmt::Display) {
        self.skipped += 1;
        console::warn(&format!("skipped: {reason}"));
    }

    pub(crate) fn close(mut self, end: End) -> Session {
        let (trajectory, view) = (&end.trajectory, end.view);
        self.each.settle(trajectory);
        let mut submaps = self.each.submaps(trajectory, &view);
        let described = submaps::describe(&submaps);
        let other_submaps = submaps.split_off(submaps.len().min(1));
        let first = submaps.pop();
        let submap = first.as_ref().map(|p| p.id);
        if let Some(inertial) = &mut self.stages.inertial {
            inertial.settle(submap);
        }
        let covariances = first
            .as_ref()
            .and_then(|p| self.covariances.of(&p.entries(trajectory), &view));
        let (final_poses, online, of_frames) = first.map_or_else(Default::default, |p| {
            (p.final_poses, p.online_poses, p.frames)
        });
        let keyframes = view
            .keyframes()
            .filter(|k| Some(k.submap) == submap)
            .map(|k| StampedPose {
                stamp: k.data.stamp,
                world_from_camera: k.world_from_camera,
            })
            .collect();
        let tracking = TrackingJson {
            frames: self.frames,
            skipped: self.skipped,
            tracked: final_poses.len(),
            undecided: self.each.undecided(),
            readout: ReadoutJson {
                seconds: end.timing.readout,
                sigma: end.timing.readout_sigma,
            },
            lost: self.each.lost(),
            still: self.each.still(),
            submaps: described,
        };
        let answered = self.stages.detector.frames;
        let live = end
            .live
            .map(|measured| measured.run(answered as f64 / end.seconds));
        self.stages.detector = self.stages.detector.counts_of(end.detector);
        Session {
            tracking,
            stages: self.stages,
            frames_csv: self.each.to_csv(trajectory, &view),
            poses: Poses {
                final_poses,
                of_frames,
                covariances: covariances.unwrap_or_default(),
                online,
                keyframes,
                other_submaps,
            },
            timing: end.timing,
            view,
            map: end.map,
            interrupted: end.interrupted,
            seconds: end.seconds,
            log: end.log,
            agrees: end.agrees,
            live,
        }
    }
}

pub(crate) struct End {
    pub(crate) trajectory: Trajectory,
    pub(crate) view: Arc<MapView>,
    /// The map itself; `None` if it is unusable or not requested.
    pub(crate) map: Option<Map>,
    /// Final estimate of the exposure timing.
    pub(crate) timing: Timing,
    pub(crate) detector: DetectorJson,
    pub(crate) interrupted: bool,
    /// From the first frame to the last, s.
    pub(crate) seconds: f64,
    /// The order in which the stages took their messages.
    pub(crate) log: Option<RunLog>,
    /// Whether the trajectory of a complete replay equals that of the run.
    pub(crate) agrees: Option<bool>,
    pub(crate) live: Option<Measured>,
}

pub(crate) struct Measured {
    /// Frame selection, as on the command line.
    pub(crate) frames: &'static str,
    pub(crate) statistics: LiveStatistics,
    pub(crate) ended: Ended,
    /// Lateness of frames relative to their stamps, s.
    pub(crate) late: Vec<f64>,
}

impl Measured {
    fn run(&self, detections_per_second: f64) -> LiveRun {
        LiveRun::new(
            self.frames,
            &self.statistics,
            &self.ended,
            detections_per_second,
            &self.late,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::detection::{BoundingBox, ClassId, DetectError, Detection, Detections};
    use stillpoint::imaging::FrameId;
    use stillpoint::map::KeyframeId;
    use stillpoint::slam::{FrameCounts, Outcome, RejudgeReport, Segments};

    #[test]
    fn detector_results_and_failures_are_counted() {
        let frame = FrameId(3);
        let person = Detection {
            class: ClassId::PERSON,
            score: 0.5,
            bounds: BoundingBox::default(),
        };
        let seen = |n: usize| {
            Event::Detected(Detections {
                frame,
                stamp: 0.1,
                items: vec![person; n],
            })
        };
        let failed = Event::DetectorFailed(DetectError::NoColour { frame });
        let rejudged = Event::Rejudged {
            report: RejudgeReport {
                keyframe: KeyframeId(3),
                map_version: 1,
                landmarks: 7,
            },
            view: Arc::default(),
        };
        let mut tally = Tally::default();
        tally.receive_all(&[failed.clone(), failed]);
        assert!(tally.stages.detector.never_answered());
        tally.receive_all(&[seen(2), seen(0), rejudged.clone(), rejudged]);
        let d = &tally.stages.detector;
        assert_eq!((d.frames, d.detections, d.failed_frames), (2, 2, 2));
        assert!(!d.never_answered());
        assert_eq!(tally.stages.features.rejudged_landmarks, 14);
    }

    #[test]
    fn unusable_detector_answers_are_counted() {
        let report = FrameReport {
            frame: FrameId(0),
            stamp: 0.0,
            outcome: Outcome::Initialised,
            world_from_camera: None,
            undecided: None,
            verdicts: [].into(),
            segments: Segments::default(),
            objects: [].into(),
            counts: FrameCounts {
                detections_too_late: 2,
                detections_without_pose: 1,
                ..FrameCounts::default()
            },
            still: None,
            is_keyframe: true,
            inertial: None,
            odometry: None,
            submap: None,
            map_version: 0,
        };
        let mut tally = Tally::default();
        tally.take_report(&report);
        tally.take_report(&report);
        let d = &tally.stages.detector;
        assert_eq!((d.too_late, d.without_pose), (4, 2));
    }
}
