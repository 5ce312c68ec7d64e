//! Routing: what follows when a stage of tracking has taken a message.
//!
//! Answers: which event reports it, and which message the next stage gets. The same for all drivers: [`Exchange`](crate::Exchange) and the
//! threads of a live run call these functions. What follows from answers of the mapper and the loop closer is said by the answers
//! themselves: [`MapperOut`](crate::MapperOut), [`LoopCloserOut`](crate::LoopCloserOut).

use crate::event::{Event, FrameEvent};
use crate::health::HealthMonitor;
use crate::messages::{MapperMsg, Tracked};
use crate::retrace::Retracer;
use crate::tracking::Tracker;
use std::sync::Arc;
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::{FrameId, RgbdFrame};

/// The tracker takes a frame: [`Event::Frame`], and what the mapper gets: a keyframe. [`retrace`] is to be called before the next frame.
pub fn track(
    tracker: &mut Tracker,
    retracer: &mut Retracer,
    health: &mut HealthMonitor,
    frame: &Arc<RgbdFrame>,
) -> (Event, Option<MapperMsg>) {
    let mut tracked = tracker.track(frame);
    let frame = &tracker.as_tracked(frame);
    if !tracked.is_passed_over() {
        retracer.follow(tracker, frame, &mut tracked);
    }
    let health = health.judge(frame, &tracked, &tracker.view());
    let Tracked {
        report, keyframe, ..
    } = tracked;
    let event = FrameEvent {
        frame: Some(Arc::clone(frame)),
        report,
        health,
    };
    let keyframe = keyframe.map(|k| MapperMsg::Keyframe(Box::new(k)));
    (Event::Frame(Arc::new(event)), keyframe)
}

/// What can wait until a frame's pose is out: the first frames of a map are tracked again. What the mapper gets: what is to be taken back of them.
pub fn retrace(tracker: &mut Tracker, retracer: &mut Retracer) -> Option<MapperMsg> {
    retracer.work(tracker)
}

/// The stream is over, and the first frames of a map are still being tracked again ([`Retracer::is_on_the_way`]): that is done to its end. What the mapper
/// gets: what is to be taken back of them.
pub fn finish(tracker: &mut Tracker, retracer: &mut Retracer) -> Option<MapperMsg> {
    retracer.finish(tracker)
}

/// The tracker takes what a detector said, before it takes the frame `next`: [`Event::Detected`] or [`Event::DetectorFailed`], and
/// what turned out to move in an earlier keyframe.
pub fn detections(
    tracker: &mut Tracker,
    retracer: &mut Retracer,
    health: &mut HealthMonitor,
    said: Result<Detections, DetectError>,
    next: FrameId,
) -> (Event, Option<MapperMsg>) {
    match said {
        Ok(detections) => {
            health.receive(&detections);
            retracer.receive(&detections);
            let message = tracker.receive_detections(detections.clone(), next);
            (Event::Detected(detections), message)
        }
        Err(e) => (Event::DetectorFailed(e), None),
    }
}
