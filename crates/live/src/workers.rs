//! The threads of tracking, mapping and looping: their inputs and outputs.

mod tracking;

pub(crate) use tracking::TrackingWorker;

use crate::boxes::{Boxes, LoopingBox, LoopingWork, MappingBox, MappingWork, Published, QUEUE};
use crate::health::guarded;
use crate::measure::{Stage, WorkerEnd};
use crate::recorder::Recorder;
use std::sync::Arc;
use std::time::Instant;
use stillpoint_slam::{
    Event, LogEntry, LoopCloser, LoopCloserMsg, LoopCloserOut, Mapper, MapperMsg, MappingEffort,
    Subscriber,
};

/// Called by every thread before it waits for its next message, with its stage: to set its priority at the first call, to count, or to
/// delay it in a test.
pub type Hook = Arc<dyn Fn(Stage) + Send + Sync>;

pub(crate) struct Desk {
    pub(crate) stage: Stage,
    pub(crate) boxes: Arc<Boxes>,
    pub(crate) recorder: Recorder,
    pub(crate) hook: Option<Hook>,
}

impl Desk {
    fn before(&self) {
        call(self.hook.as_ref(), self.stage);
        self.boxes.rests(self.stage);
    }

    /// Publishes an event to all subscribers. A stage does so before it passes on its results, so that dependent events come later.
    fn publish(&self, event: &Event) {
        if matches!(event, Event::Looped(_) | Event::Corrected { .. }) {
            self.boxes.loops.put(|l| l.receive(event));
        }
        self.boxes.audience.publish(event);
    }
}

pub(crate) fn call(hook: Option<&Hook>, stage: Stage) {
    if let Some(hook) = hook {
        hook(stage);
    }
}

pub(crate) struct MappingWorker {
    pub(crate) desk: Desk,
    pub(crate) mapper: Mapper,
    /// Effort per keyframe without a backlog, and the current one.
    full: MappingEffort,
    effort: MappingEffort,
    answers: u64,
    keyframes: u64,
}

impl MappingWorker {
    pub(crate) fn new(desk: Desk, mapper: Mapper, full: MappingEffort) -> Self {
        Self {
            desk,
            mapper,
            full,
            effort: full,
            answers: 0,
            keyframes: 0,
        }
    }

    /// Runs mapping until tracking and looping have ended.
    pub(crate) fn run(&mut self) -> WorkerEnd {
        let boxes = Arc::clone(&self.desk.boxes);
        let end = guarded(&boxes, Stage::Mapping, || {
            self.desk.before();
            while let Some(work) = boxes.mapping.take(MappingBox::next) {
                boxes.begins(Stage::Mapping);
                match work {
                    MappingWork::Message(message) => self.step(message),
                    MappingWork::Copy(to) => {
                        // The receiver may be gone.
                        let _ = to.send(self.mapper.map().clone());
                    }
                    MappingWork::TrackingIsOver => {
                        // If looping has ended already, it has said so.
                        boxes.looping.put(|b| b.mapping_is_over = true);
                    }
                    MappingWork::Over => break,
                }
                self.desk.before();
            }
        });
        boxes.mapping.close();
        boxes.looping.put(|b| b.mapping_is_over = true);
        end
    }

    fn step(&mut self, message: MapperMsg) {
        if matches!(message, MapperMsg::Keyframe(_)) {
            self.hurry();
        }
        self.desk.recorder.took(LogEntry::from(&message));
        self.keyframes += u64::from(matches!(message, MapperMsg::Keyframe(_)));
        let out = self.mapper.step(message);
        let message = out.for_loop_closer();
        let view = Arc::clone(&out.view);
        let boxes = &self.desk.boxes;
        boxes.view.put(|newest| *newest = Arc::clone(&view));
        self.desk.publish(&out.into_event());
        let published = Published {
            answer: self.answers,
            view,
            at: Instant::now(),
            keyframes: self.keyframes,
        };
        self.answers += 1;
        boxes.tracking.put(|b| b.view = Some(published));
        let room = |b: &LoopingBox| b.queue.len() < QUEUE;
        boxes.looping.put_when(room, |b| b.queue.push_back(message));
    }
}

impl MappingWorker {
    /// Divides the effort among queued keyframes: a map that lags behind the camera is worse than a less refined one, as missing new places
    /// cannot be tracked.
    fn hurry(&mut self) {
        let is_keyframe = |m: &&MapperMsg| matches!(m, MapperMsg::Keyframe(_));
        let boxes = &self.desk.boxes;
        let waiting = boxes
            .mapping
            .look(|b| b.queue.iter().filter(is_keyframe).count());
        let effort = self.full.shared(waiting);
        if effort != self.effort {
            self.effort = effort;
            self.desk.recorder.took(LogEntry::MapEffort { effort });
            self.mapper.set_effort(effort);
        }
    }
}

pub(crate) struct LoopingWorker {
    pub(crate) desk: Desk,
    pub(crate) loop_closer: LoopCloser,
    answers: u64,
}

impl LoopingWorker {
    pub(crate) fn new(desk: Desk, loop_closer: LoopCloser) -> Self {
        Self {
            desk,
            loop_closer,
            answers: 0,
        }
    }

    pub(crate) fn run(&mut self) -> WorkerEnd {
        let boxes = Arc::clone(&self.desk.boxes);
        let end = guarded(&boxes, Stage::Looping, || {
            self.desk.before();
            while let Some(LoopingWork::Message(message)) = boxes.looping.take(LoopingBox::next) {
                boxes.begins(Stage::Looping);
                self.step(message);
                self.desk.before();
            }
        });
        boxes.looping.close();
        boxes.mapping.put(|b| b.looping_is_over = true);
        end
    }

    fn step(&mut self, message: LoopCloserMsg) {
        if let Some(entry) = LogEntry::of_loop_closer(&message) {
            self.desk.recorder.took(entry);
        }
        let LoopCloserOut {
            correction,
            report,
            places,
        } = self.loop_closer.step(message);
        if let Some(report) = report {
            self.desk.publish(&Event::Looped(Box::new(report)));
        }
        let known = (self.answers, places);
        self.answers += 1;
        let boxes = &self.desk.boxes;
        boxes.tracking.put(|b| b.places = Some(known));
        if let Some(correction) = correction {
            // The loop closer finds no other one before this one is in the map.
            boxes.mapping.put(|b| b.corrections.push_back(correction));
        }
    }
}
