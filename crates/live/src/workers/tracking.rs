//! The tracking thread.

use super::Desk;
use crate::backoff::Backoff;
use crate::boxes::{MappingBox, PassedOn, QUEUE, TrackingBox, TrackingWork};
use crate::budget::Budget;
use crate::health::{Newest, guarded};
use crate::measure::{AnswerTiming, FrameTiming, Stage, WorkerEnd};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;
use stillpoint_imaging::RgbdFrame;
use stillpoint_slam::{HealthMonitor, LogEntry, MapperMsg, Retracer, Tracker, routing};

pub(crate) struct TrackingWorker {
    pub(crate) desk: Desk,
    pub(crate) tracker: Tracker,
    retracer: Retracer,
    health: HealthMonitor,
    /// Every n-th frame is sent to the detector.
    pub(crate) stride: u64,
    pub(crate) budget: Option<Budget>,
    /// Limits the detector's share of the time.
    backoff: Backoff,
    pub(crate) frames: Vec<FrameTiming>,
    pub(crate) detections: Vec<AnswerTiming>,
    taken: u64,
    seen: Option<f64>,
    /// When the view in use was published.
    view_at: Option<Instant>,
    /// Number of sent keyframes contained in the view in use.
    mapped: u64,
    sent: u64,
    passed_on: PassedOn,
    /// Number of frames kept in the trajectory; `None` for all.
    pub(crate) keep_frames: Option<usize>,
}

impl TrackingWorker {
    pub(crate) fn new(
        desk: Desk,
        (tracker, retracer, health): (Tracker, Retracer, HealthMonitor),
        stride: u64,
        budget: Option<Budget>,
    ) -> Self {
        Self {
            desk,
            tracker,
            retracer,
            health,
            stride,
            budget,
            backoff: Backoff::default(),
            frames: Vec::new(),
            detections: Vec::new(),
            taken: 0,
            seen: None,
            view_at: None,
            mapped: 0,
            sent: 0,
            passed_on: PassedOn::default(),
            keep_frames: None,
        }
    }

    pub(crate) fn run(&mut self) -> WorkerEnd {
        let boxes = Arc::clone(&self.desk.boxes);
        let end = guarded(&boxes, Stage::Tracking, || {
            self.desk.before();
            while let Some(work) = boxes.tracking.take(TrackingBox::next) {
                boxes.begins(Stage::Tracking);
                self.step(work);
                self.desk.before();
            }
            self.end_stream();
        });
        boxes.tracking.close();
        boxes.detection.close();
        boxes.mapping.put(|b| b.tracking_is_over = true);
        end
    }

    fn step(&mut self, work: TrackingWork) {
        let TrackingWork { arrived, news } = work;
        let waited = arrived.at.elapsed().as_secs_f64();
        let rarer = self.budget.as_ref().map_or(1, Budget::rarer);
        let rarer = rarer.max(self.backoff.observe(news.dropped));
        if self.taken.is_multiple_of(self.stride) {
            let shown = arrived.clone();
            self.desk.boxes.detection.put(|b| b.show(shown, rarer));
        }
        self.taken += 1;
        self.take_news(news, &arrived.frame);
        self.desk.recorder.took(LogEntry::of_frame(&arrived.frame));
        let view_age = self.view_at.map(|at| at.elapsed().as_secs_f64());
        let (event, keyframe) = routing::track(
            &mut self.tracker,
            &mut self.retracer,
            &mut self.health,
            &arrived.frame,
        );
        let latency = arrived.at.elapsed().as_secs_f64();
        let boxes = &self.desk.boxes;
        let timing = FrameTiming {
            frame: arrived.frame.id,
            latency,
            waited,
            detections_age: self.seen.map(|stamp| arrived.frame.stamp - stamp),
            view_age,
            features: self.tracker.features(),
            keyframes_behind: (self.sent - self.mapped) as u32,
            mapping_queue: boxes.mapping.look(|b| b.queue.len()) as u32,
            looping_queue: boxes.looping.look(|b| b.queue.len()) as u32,
        };
        if self.desk.recorder.keeps() {
            self.frames.push(timing);
        }
        boxes.frames.fetch_add(1, Ordering::Relaxed);
        boxes.newest.put(|newest| {
            *newest = event.as_frame().map(|frame| Newest {
                health: frame.health.clone(),
                timing,
                at: Instant::now(),
            });
        });
        if let Some(most) = self.keep_frames
            && self.tracker.trajectory().entries().len() > 2 * most
        {
            self.tracker.forget_frames_but(most);
        }
        self.pass_on();
        let wanted = self
            .budget
            .as_mut()
            .and_then(|b| b.observe(latency - waited));
        if let Some(features) = wanted {
            self.desk.recorder.took(LogEntry::TrackEffort { features });
            self.tracker.set_features(features);
        }
        self.desk.publish(&event);
        if let Some(keyframe) = keyframe {
            self.sent += 1;
            self.tell_mapper(keyframe);
        }
        if let Some(message) = routing::retrace(&mut self.tracker, &mut self.retracer) {
            self.pass_on();
            self.tell_mapper(message);
        }
    }

    /// At the end of the stream, completes the repeated tracking of the map's first frames.
    fn end_stream(&mut self) {
        if self.retracer.is_on_the_way() {
            self.desk.recorder.took(LogEntry::TrackEnd);
            if let Some(message) = routing::finish(&mut self.tracker, &mut self.retracer) {
                self.pass_on();
                self.tell_mapper(message);
            }
        }
    }

    fn pass_on(&mut self) {
        let trajectory = self.tracker.trajectory();
        let tracked = &self.desk.boxes.tracked;
        tracked.put(|t| t.take(&self.passed_on, trajectory));
        self.passed_on = PassedOn::of(trajectory);
    }

    /// Processes the messages since the previous frame, in the order of the inline driver.
    fn take_news(&mut self, news: TrackingBox, next: &RgbdFrame) {
        if let Some(published) = news.view {
            let answer = published.answer;
            self.desk.recorder.took(LogEntry::TrackView { answer });
            self.view_at = Some(published.at);
            self.mapped = published.keyframes;
            self.tracker.receive(published.view);
        }
        if let Some((answer, places)) = news.places {
            self.desk.recorder.took(LogEntry::TrackPlaces { answer });
            self.tracker.receive_places(places);
        }
        if !news.inertial.is_empty() && self.tracker.has_imu() {
            self.tracker.receive_inertial(&news.inertial);
            let samples = news.inertial;
            self.desk.recorder.took(LogEntry::TrackInertial { samples });
        }
        if !news.odometry.is_empty() && self.tracker.has_odometry() {
            self.tracker.receive_odometry(&news.odometry);
            let samples = news.odometry;
            self.desk.recorder.took(LogEntry::TrackOdometry { samples });
        }
        for said in news.said {
            self.desk.recorder.took(LogEntry::TrackDetections {
                next: next.id,
                said: said.answer.clone(),
            });
            if self.desk.recorder.keeps() {
                self.detections.push(AnswerTiming {
                    frame: said.frame,
                    latency: said.arrived.elapsed().as_secs_f64(),
                });
            }
            if let Ok(detections) = &said.answer {
                self.seen = Some(detections.stamp);
            }
            let (event, message) = routing::detections(
                &mut self.tracker,
                &mut self.retracer,
                &mut self.health,
                said.answer,
                next.id,
            );
            self.desk.publish(&event);
            if let Some(message) = message {
                self.tell_mapper(message);
            }
        }
    }

    fn tell_mapper(&self, message: MapperMsg) {
        let room = |b: &MappingBox| b.queue.len() < QUEUE;
        let mapping = &self.desk.boxes.mapping;
        mapping.put_when(room, |b| b.queue.push_back(message));
    }
}
