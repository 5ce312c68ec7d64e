//! Routing: events and follow-up messages of the tracker.
//!
//! Shared by all drivers: [`Exchange`](crate::Exchange) and the threads of a live run call these functions. Replies of
//! mapper and loop closer carry their follow-ups themselves: [`MapperOut`](crate::MapperOut),
//! [`LoopCloserOut`](crate::LoopCloserOut).

use crate::event::{Event, FrameEvent};
use crate::health::HealthMonitor;
use crate::messages::{MapperMsg, Tracked};
use crate::retrace::Retracer;
use crate::tracking::Tracker;
use std::sync::Arc;
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::{FrameId, RgbdFrame};

/// Tracks a frame. Returns [`Event::Frame`] and the message to the mapper, a keyframe, if any. Call [`retrace`] before
/// the next frame.
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

/// Tracks some first frames of a map again, after a frame's pose was published. Returns the message to the mapper that
/// revokes keyframes, if any.
pub fn retrace(tracker: &mut Tracker, retracer: &mut Retracer) -> Option<MapperMsg> {
    retracer.work(tracker)
}

/// Completes retracing at the end of the stream ([`Retracer::is_on_the_way`]). Returns the message to the mapper that
/// revokes keyframes, if any.
pub fn finish(tracker: &mut Tracker, retracer: &mut Retracer) -> Option<MapperMsg> {
    retracer.finish(tracker)
}

/// Passes a detector's result to the tracker before frame `next`. Returns [`Event::Detected`] or
/// [`Event::DetectorFailed`], and the message to the mapper about moving features of an earlier keyframe, if any.
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
