//! Retracing: tracks the first frames of a map again, backwards, once it is known which surfaces move.
//!
//! A person walking past a camera that was just switched on looks static at first, and the pose may follow them. About
//! a second later the static filter knows better, and a map of the static scene exists. From there, a second tracker
//! follows the first frames from newest to oldest, in a copy of the map without them. If both trajectories agree,
//! nothing changes; otherwise the frames get the new poses and the map's first keyframes are revoked. Corrects the
//! tracker's trajectory; changes the map only by a message.

mod beginning;
mod way_back;

use crate::mapping::MapperSetup;
use crate::messages::{MapperMsg, Tracked};
use crate::report::Outcome;
use crate::tracking::Tracker;
use beginning::Beginning;
use std::sync::Arc;
use stillpoint_detection::Detections;
use stillpoint_imaging::RgbdFrame;
use way_back::WayBack;

/// Time after the start of a map at which it is known which surfaces move, s: by then a person's motion exceeds the
/// noise. Chosen on the recordings of decision 25.
const KNOWN: f64 = 1.2;
/// If the turning point is not reached by then, because the camera is lost, the first frames are dropped, s: they are
/// large. Chosen: at 30 Hz they take half of their memory limit.
const MOST: f64 = 3.0;
/// Time from which the map suffices to track backwards, s: half as long again as [`KNOWN`], chosen on the recordings of
/// decision 25.
const RETRACED: f64 = 1.8;
/// Number of frames tracked again after each new one: at this rate, retracing ends within a second. The 36 frames of
/// [`KNOWN`] at 30 Hz take 0.6 s (decision 25).
const PER_FRAME: usize = 2;
/// Frame interval below which only one frame is tracked again after each new one, s: there is no time for more. Chosen:
/// a frame of 1000 features takes 11 ms (`CostTable::REFERENCE`), of which two fit.
const FAST: f64 = 1.0 / 45.0;

/// Tracks the first frames of every map and submap again.
pub struct Retracer {
    setup: MapperSetup,
    stage: Stage,
    /// Whether there is work to do before the next frame.
    due: bool,
    /// Stamps of the newest frame and of the one before, s.
    stamps: [f64; 2],
}

#[derive(Default)]
enum Stage {
    #[default]
    Decided,
    /// Collecting the first frames of a map.
    Begun(Box<Beginning>),
    /// Tracking them again.
    Retracing(Box<WayBack>),
}

impl Retracer {
    /// A retracer before the first frame.
    #[must_use]
    pub fn new(setup: impl Into<MapperSetup>) -> Self {
        Self {
            setup: setup.into(),
            stage: Stage::Decided,
            due: false,
            stamps: [f64::NEG_INFINITY; 2],
        }
    }

    pub(crate) fn receive(&mut self, detections: &Detections) {
        if let Stage::Begun(beginning) = &mut self.stage {
            beginning.receive(detections);
        }
    }

    /// Takes a tracked frame; sets in its report whether it is undecided which surfaces move.
    pub(crate) fn follow(
        &mut self,
        tracker: &mut Tracker,
        frame: &Arc<RgbdFrame>,
        tracked: &mut Tracked,
    ) {
        if !tracker.learns_who_moves() {
            return;
        }
        self.stamps = [frame.stamp, self.stamps[0]];
        if tracked.report.outcome == Outcome::Initialised {
            self.stage = Stage::Begun(Box::new(Beginning::at(frame.stamp)));
        }
        self.stage = match std::mem::take(&mut self.stage) {
            Stage::Begun(beginning) => self.go_on(beginning, tracker, frame, tracked),
            stage => {
                self.due = matches!(stage, Stage::Retracing(_));
                stage
            }
        };
    }

    /// Tracks some of the first frames again, if due; call after the newest pose is published. Returns the message that
    /// revokes keyframes, if any.
    pub(crate) fn work(&mut self, tracker: &mut Tracker) -> Option<MapperMsg> {
        if !std::mem::take(&mut self.due) {
            return None;
        }
        let (stage, message) = match std::mem::take(&mut self.stage) {
            Stage::Decided => (Stage::Decided, None),
            Stage::Begun(beginning) => {
                let way = WayBack::begin(*beginning, tracker, &self.setup);
                let stage = way.map(|way| Stage::Retracing(Box::new(way)));
                (stage.unwrap_or_default(), None)
            }
            Stage::Retracing(mut way) => {
                (0..steps(self.stamps)).for_each(|_| way.step());
                if way.is_over() {
                    (Stage::Decided, way.settle(tracker))
                } else {
                    (Stage::Retracing(way), None)
                }
            }
        };
        self.stage = stage;
        message
    }

    /// Whether [`routing::finish`](crate::routing::finish) would track frames again.
    #[must_use]
    pub fn is_on_the_way(&self) -> bool {
        match &self.stage {
            Stage::Decided => false,
            Stage::Begun(beginning) => beginning.is_known(),
            Stage::Retracing(_) => true,
        }
    }

    /// Completes retracing at the end of the stream with the current map. Returns the message that revokes keyframes,
    /// if any.
    pub(crate) fn finish(&mut self, tracker: &mut Tracker) -> Option<MapperMsg> {
        self.due = false;
        let mut way = match std::mem::take(&mut self.stage) {
            Stage::Decided => return None,
            Stage::Begun(beginning) => {
                let can_turn = beginning.is_known() && beginning.is_mapped(&tracker.view());
                let way = can_turn.then(|| WayBack::begin(*beginning, tracker, &self.setup));
                Box::new(way??)
            }
            Stage::Retracing(way) => way,
        };
        while !way.is_over() {
            way.step();
        }
        way.settle(tracker)
    }

    fn go_on(
        &mut self,
        mut beginning: Box<Beginning>,
        tracker: &mut Tracker,
        frame: &Arc<RgbdFrame>,
        tracked: &mut Tracked,
    ) -> Stage {
        let Some(since) = beginning.take(frame, tracked) else {
            // The clock was set back.
            return Stage::Decided;
        };
        let endless = since > MOST && !beginning.is_known();
        if beginning.is_quiet(since) || endless || beginning.is_too_large() {
            return Stage::Decided;
        }
        if !beginning.is_known() {
            tracked.report.undecided = Some(since);
            if since >= KNOWN {
                if tracked.report.is_keyframe
                    && let Some(point) = tracker.turning_point()
                {
                    beginning.turn_at(point, frame);
                } else {
                    tracker.want_keyframe();
                }
            }
            return Stage::Begun(beginning);
        }
        // The map contains the turning point only after the mapper's reply.
        self.due = since >= RETRACED && beginning.is_mapped(&tracker.view());
        Stage::Begun(beginning)
    }
}

/// Number of frames to track again, from the stamps of the last two frames.
fn steps([newest, before]: [f64; 2]) -> usize {
    if newest - before < FAST { 1 } else { PER_FRAME }
}

#[cfg(test)]
mod tests;
