//! One pass of a stream of frames through the system.
//!
//! Answers: which frames went in, which came out with a pose, what the map was in the end. Knows nothing of where the
//! frames come from or where results go.

use crate::console::{self, Progress};
use crate::failure::Failure;
use crate::frames::{self, Frames, Piece};
use crate::interrupt::Interrupt;
use crate::map_file::SavedMap;
pub(crate) use crate::session_outputs::Outputs;
use crate::summary::{DetectorJson, FeaturesJson, LoopsJson, LostStretch, PieceJson};
use crate::timing::Timing;
use std::sync::Arc;
use std::time::Instant;
use stillpoint::datasets::StampedPose;
use stillpoint::detection::{Detector, NoDetector};
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::map::{Map, MapView};
use stillpoint::slam::{Config, Event, FrameReport, MapUse, System};

/// What a pass gave.
pub(crate) struct Session {
    /// Frames that went through the system.
    pub(crate) frames: usize,
    /// Frames that could not be read.
    pub(crate) skipped: usize,
    /// Stretches of frames without a pose.
    pub(crate) lost: Vec<LostStretch>,
    /// What the detector was and did.
    pub(crate) detector: DetectorJson,
    /// What the static filter did.
    pub(crate) features: FeaturesJson,
    /// Places that were recognised.
    pub(crate) loops: LoopsJson,
    /// The user ended it early.
    pub(crate) interrupted: bool,
    /// From the first frame to the last, s.
    pub(crate) seconds: f64,
    /// Final poses of the tracked frames.
    pub(crate) final_poses: Vec<StampedPose>,
    /// Poses as known at each of these frames; without those that were in another piece then, whose poses were in another frame of
    /// reference.
    pub(crate) online_poses: Vec<StampedPose>,
    /// Poses in other pieces of map, each in a frame of reference of its own.
    pub(crate) other_pieces: Vec<Piece>,
    /// All pieces; the first is that of the poses above.
    pub(crate) pieces: Vec<PieceJson>,
    /// What became of every frame, as `frames.csv` has it.
    pub(crate) frames_csv: String,
    /// Final poses of the keyframes of the first piece.
    pub(crate) keyframes: Vec<StampedPose>,
    /// The final map.
    pub(crate) view: Arc<MapView>,
    /// Where it was saved, or why it could not be; nothing when it was not to be.
    pub(crate) saved: Option<Result<SavedMap, Failure>>,
}

/// Means of a pass.
pub(crate) struct Driver<'a> {
    pub(crate) config: Config,
    pub(crate) camera: Camera,
    pub(crate) simd: Simd,
    pub(crate) timing: &'a Timing,
    pub(crate) interrupt: &'a Interrupt,
    pub(crate) detector: Option<Box<dyn Detector>>,
    /// A map to begin with, and what is done with it.
    pub(crate) map: Option<(Map, MapUse)>,
}

impl Driver<'_> {
    /// Runs the stream to its end, or until the user asks to stop.
    ///
    /// # Errors
    /// A configuration out of range, a stream that fails for good, a stream without any readable frame, outputs that cannot
    /// be written.
    pub(crate) fn drive(
        mut self,
        source: &mut dyn FrameSource,
        outputs: &mut Outputs,
    ) -> Result<Session, Failure> {
        let mut system =
            System::new(self.config.clone(), self.camera, self.simd).map_err(Failure::input)?;
        if let Some(detector) = self.detector.take() {
            system = system.with_detector(detector);
        }
        if let Some((map, map_use)) = self.map.take() {
            system = system.with_map(map, map_use).map_err(Failure::input)?;
        }
        let mut tally = Tally::default();
        let start = Instant::now();
        let taken = self.take_frames(source, outputs, &mut system, &mut tally);
        tally.take(&system.finish());
        if let Err(failure) = taken {
            outputs.rescue_map(&system, tally.frames);
            return Err(failure);
        }
        if tally.frames == 0 && self.interrupt.requested() {
            return Err(Failure::criteria(
                "interrupted before the first frame: nothing was written",
            ));
        }
        if tally.frames == 0 {
            return Err(Failure::input(format!(
                "expected frames, found none that can be read ({} skipped); check the images",
                tally.skipped
            )));
        }
        let mut session = tally.close(&system, start, self.interrupt.requested());
        // What was found until then is worth having even when the map cannot be saved.
        session.saved = outputs.map.take().map(|map| map.save(system.map()));
        Ok(session)
    }

    /// Lets the frames go by.
    fn take_frames(
        &self,
        source: &mut dyn FrameSource,
        outputs: &mut Outputs,
        system: &mut System,
        tally: &mut Tally,
    ) -> Result<(), Failure> {
        let mut progress = Progress::new(source.remaining());
        while !self.interrupt.requested() {
            let next = tracing::info_span!("wait").in_scope(|| source.next_frame());
            match next {
                None => break,
                Some(Ok(frame)) => {
                    let kept = outputs.keep(&frame);
                    let events = tracing::info_span!("total").in_scope(|| system.step(frame));
                    tally.take(&events);
                    outputs
                        .take(&events, kept.as_ref())
                        .inspect_err(|_| progress.finish())?;
                    self.timing.end_frame();
                }
                Some(Err(e)) if e.recoverable => {
                    tally.skipped += 1;
                    console::warn(&format!("skipped: {e}"));
                }
                Some(Err(e)) => {
                    progress.finish();
                    return Err(Failure::input(e));
                }
            }
            let note = if tally.without_pose == 0 {
                String::new()
            } else {
                format!(", {} lost", tally.without_pose)
            };
            progress.show(tally.frames + tally.skipped, &note);
        }
        progress.finish();
        Ok(())
    }
}

/// Counts while frames go by.
#[derive(Default)]
struct Tally {
    frames: usize,
    skipped: usize,
    without_pose: usize,
    each: Frames,
    features: FeaturesJson,
    loops: LoopsJson,
    detector: DetectorJson,
}

impl Tally {
    fn take(&mut self, events: &[Event]) {
        for event in events {
            match event {
                Event::Frame(report) => self.take_report(report),
                Event::Refused(refused) => {
                    self.skipped += 1;
                    console::warn(&format!("skipped: {refused}"));
                }
                Event::Mapped(report) => tracing::debug!(
                    keyframe = %report.keyframe,
                    version = report.map_version,
                    keyframes = report.keyframes,
                    landmarks = report.landmarks,
                    "mapped"
                ),
                Event::Rejudged(report) => {
                    self.features.rejudged_landmarks += u64::from(report.landmarks);
                }
                Event::Looped(report) => {
                    tracing::debug!(?report, "looped");
                    self.loops.add(report);
                }
                Event::Detected(detections) => {
                    self.detector.frames += 1;
                    self.detector.detections += detections.items.len();
                }
                Event::DetectorFailed(e) => {
                    // The others are most likely the same; the number of them is told at the end.
                    if self.detector.failed_frames == 0 {
                        console::warn(&format!("the detector failed: {e}"));
                    }
                    self.detector.failed_frames += 1;
                }
            }
        }
    }

    fn take_report(&mut self, report: &FrameReport) {
        self.frames += 1;
        self.features.add(&report.counts);
        self.detector.too_late += u64::from(report.counts.detections_too_late);
        self.detector.without_pose += u64::from(report.counts.detections_without_pose);
        tracing::trace!(frame = %report.frame, counts = ?report.counts, outcome = ?report.outcome, "tracked");
        self.without_pose += usize::from(self.each.take(report));
    }

    fn close(self, system: &System, start: Instant, interrupted: bool) -> Session {
        let seconds = start.elapsed().as_secs_f64();
        let view = system.view();
        let mut pieces = self.each.pieces(system.trajectory(), &view);
        let described = frames::describe(&pieces);
        let other_pieces = pieces.split_off(pieces.len().min(1));
        let first = pieces.pop();
        let piece = first.as_ref().map(|p| p.id);
        let (final_poses, online_poses) =
            first.map_or_else(Default::default, |p| (p.final_poses, p.online_poses));
        let keyframes = view
            .keyframes()
            .filter(|k| Some(k.piece) == piece)
            .map(|k| StampedPose {
                stamp: k.data.stamp,
                world_from_camera: k.world_from_camera,
            })
            .collect();
        let info = system
            .detector()
            .map_or_else(|| NoDetector.info(), Detector::info);
        let detector = DetectorJson {
            remark: system.detector().and_then(Detector::remark),
            frames: self.detector.frames,
            detections: self.detector.detections,
            failed_frames: self.detector.failed_frames,
            too_late: self.detector.too_late,
            without_pose: self.detector.without_pose,
            ..DetectorJson::new(&info)
        };
        Session {
            detector,
            features: self.features,
            loops: self.loops,
            frames: self.frames,
            skipped: self.skipped,
            lost: self.each.lost(),
            frames_csv: self.each.to_csv(system.trajectory(), &view),
            pieces: described,
            other_pieces,
            interrupted,
            seconds,
            final_poses,
            online_poses,
            keyframes,
            view,
            saved: None,
        }
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
    fn what_the_detector_says_is_counted() {
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
        let rejudged = Event::Rejudged(RejudgeReport {
            keyframe: KeyframeId(3),
            map_version: 1,
            landmarks: 7,
        });
        let mut tally = Tally::default();
        tally.take(&[failed.clone(), failed]);
        assert!(tally.detector.never_answered());
        tally.take(&[seen(2), seen(0), rejudged.clone(), rejudged]);
        let d = &tally.detector;
        assert_eq!((d.frames, d.detections, d.failed_frames), (2, 2, 2));
        assert!(!d.never_answered());
        assert_eq!(tally.features.rejudged_landmarks, 14);
    }

    #[test]
    fn answers_that_were_of_no_use_are_counted() {
        let report = Event::Frame(FrameReport {
            frame: FrameId(0),
            stamp: 0.0,
            outcome: Outcome::Initialised,
            world_from_camera: None,
            verdicts: [].into(),
            segments: Segments::default(),
            objects: [].into(),
            counts: FrameCounts {
                detections_too_late: 2,
                detections_without_pose: 1,
                ..FrameCounts::default()
            },
            is_keyframe: true,
            piece: None,
            map_version: 0,
        });
        let mut tally = Tally::default();
        tally.take(&[report.clone(), report]);
        let d = &tally.detector;
        assert_eq!((d.too_late, d.without_pose), (4, 2));
    }
}
