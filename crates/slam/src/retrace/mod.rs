//! Retracing: the first frames of a map are tracked again, backwards, once it is known who moves.
//!
//! Answers: while who moves is undecided, and where the camera was then. Who walks past a camera that was just switched on looks like
//! the room for a moment, and the pose may ride on him. A second later it is known who he is, and there is a map of what was seen since:
//! from there a second tracker follows the frames of the beginning from the newest to the oldest, in a copy of the map without that
//! beginning. Where both ways agree, all stays as it was; where they do not, the frames are posed anew and the map's first
//! keyframes are taken back. Stands above the tracker, whose trajectory it corrects; changes the map by a message alone.

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

/// Who moves is known so long after a map was begun, s: what a person does within it is more than noise. Chosen on the recordings of decision 25.
const KNOWN: f64 = 1.2;
/// Where the camera is lost until so long after it, the beginning is let go, s: its frames are large. Chosen: at 30 Hz they take half of the memory
/// that a beginning may take.
const MOST: f64 = 3.0;
/// From so long after it on there is enough of a map to go back from, s: half as long again as [`KNOWN`], chosen on the recordings of decision 25.
const RETRACED: f64 = 1.8;
/// Number of frames that are tracked again after each new one: at this rate, the way back ends within a second. The 36 frames of [`KNOWN`] at 30 Hz
/// take 0.6 s (decision 25).
const PER_FRAME: usize = 2;
/// If the time between frames is below this, only one frame is tracked again after each new one, s: there is no time for more. Chosen: a frame of
/// 1000 features takes 11 ms (`CostTable::REFERENCE`), of which two fit.
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

/// How far it is.
#[derive(Default)]
enum Stage {
    /// Nothing is to be done.
    #[default]
    Decided,
    /// A map was begun.
    Begun(Box<Beginning>),
    /// Its first frames are tracked again.
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

    /// Takes detections that the tracker takes.
    pub(crate) fn receive(&mut self, detections: &Detections) {
        if let Stage::Begun(beginning) = &mut self.stage {
            beginning.receive(detections);
        }
    }

    /// Takes note of a frame that was tracked. Says in the frame's report whether who moves is undecided.
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

    /// Tracks some of the first frames again when it is time: what can wait until the newest one's pose is out. Answers with what the mapper is
    /// to take back.
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

    /// Whether there are first frames that [`routing::finish`](crate::routing::finish) would track again.
    #[must_use]
    pub fn is_on_the_way(&self) -> bool {
        match &self.stage {
            Stage::Decided => false,
            Stage::Begun(beginning) => beginning.is_known(),
            Stage::Retracing(_) => true,
        }
    }

    /// The stream is over: goes the way back to its end, with the map that there is. Answers with what the mapper is to take back.
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

    /// Takes a frame of the beginning.
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
        // The map does not hold the turning point before the mapper has answered.
        self.due = since >= RETRACED && beginning.is_mapped(&tracker.view());
        Stage::Begun(beginning)
    }
}

/// How many frames are tracked again after the newest, by the stamps of that one and the one before.
fn steps([newest, before]: [f64; 2]) -> usize {
    if newest - before < FAST { 1 } else { PER_FRAME }
}

#[cfg(test)]
mod tests;
