//! What the system says about each frame. Events are values: tests, reports and viewers read the same ones.
//!
//! # Order
//! Every event but [`Event::Refused`] belongs to one entry of the run log ([`LogEntry`](crate::LogEntry)), and an entry has one event
//! at most:
//!
//! | entry | event |
//! |---|---|
//! | the tracker takes detections | [`Event::Detected`] or [`Event::DetectorFailed`] |
//! | the tracker takes a frame | [`Event::Frame`] |
//! | the mapper takes a keyframe | [`Event::Mapped`] |
//! | the mapper learns what moves in a keyframe | [`Event::Rejudged`] |
//! | the mapper takes back the beginning of a map | [`Event::Revoked`] |
//! | the mapper takes a correction | [`Event::Corrected`] |
//! | the loop closer takes a keyframe | [`Event::Looped`], when a place was recognised |
//!
//! In all drivers, (1) the events of one stage come in the order in which it took its messages, and (2) an event comes after those
//! of everything that it depends on: detections before the frame that they were used for, a frame before the
//! [`Event::Mapped`] of its keyframe, that before the frames tracked in its view and before the [`Event::Looped`] of its keyframe, a
//! loop before its [`Event::Corrected`]. [`System`](crate::System) and [`Replay`](crate::Replay) give the events in the order of the
//! log. In a live run stages work at the same time: events that do not depend on each other come as they happen there, so that no
//! frame waits for a slow map.

use crate::gate::RefusedFrame;
use crate::health::Health;
use crate::messages::{MapperOut, MapperReport};
use crate::report::{
    CorrectionReport, FrameReport, LoopReport, MappingReport, RejudgeReport, RevokeReport,
};
use std::sync::Arc;
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::MapView;

/// What happened in one step of the system.
#[derive(Clone)]
pub enum Event {
    /// A frame went through tracking. Exactly one per frame that was not refused (nor dropped, in a live run).
    Frame(Arc<FrameEvent>),
    /// A frame came twice or out of order, or does not fit the camera: it was not looked at, and changed nothing.
    Refused(RefusedFrame),
    /// The mapper took a keyframe and published a new version of the map.
    Mapped {
        /// What it did.
        report: MappingReport,
        /// The new version.
        view: Arc<MapView>,
    },
    /// The detector answered, as of the frame named in it.
    Detected(Detections),
    /// The detector failed on a frame; tracking keeps using its earlier detections.
    DetectorFailed(DetectError),
    /// Features of an earlier keyframe turned out to move: their landmarks were taken out.
    Rejudged {
        /// What was taken out.
        report: RejudgeReport,
        /// The new version of the map.
        view: Arc<MapView>,
    },
    /// The first frames of a map turned out to have ridden on what moves: their keyframes were taken back, and the frames have other poses,
    /// or none, in the trajectory.
    Revoked {
        /// What was taken back.
        report: RevokeReport,
        /// The new version of the map.
        view: Arc<MapView>,
    },
    /// A place was recognised, and a loop closed or set aside. What applying the correction did comes later: [`Event::Corrected`].
    Looped(Box<LoopReport>),
    /// The correction of a loop is in the map: poses that were known before may have moved.
    Corrected {
        /// What moved.
        report: CorrectionReport,
        /// The new version of the map.
        view: Arc<MapView>,
    },
}

impl Event {
    /// The frame that this event is about, if it is an [`Event::Frame`].
    #[must_use]
    pub fn as_frame(&self) -> Option<&FrameEvent> {
        match self {
            Self::Frame(frame) => Some(frame),
            _ => None,
        }
    }

    /// The version of the map that this event brings.
    #[must_use]
    pub fn view(&self) -> Option<&Arc<MapView>> {
        match self {
            Self::Mapped { view, .. }
            | Self::Rejudged { view, .. }
            | Self::Revoked { view, .. }
            | Self::Corrected { view, .. } => Some(view),
            _ => None,
        }
    }
}

impl MapperOut {
    /// The event by which subscribers learn of it.
    #[must_use]
    pub fn into_event(self) -> Event {
        let view = self.view;
        match self.report {
            MapperReport::Mapped(report) => Event::Mapped { report, view },
            MapperReport::Rejudged(report) => Event::Rejudged { report, view },
            MapperReport::Revoked(report) => Event::Revoked { report, view },
            MapperReport::Corrected(report) => Event::Corrected { report, view },
        }
    }
}

/// Without images and maps: of these only the numbers.
impl std::fmt::Debug for Event {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Frame(frame) => frame.fmt(f),
            Self::Refused(refused) => f.debug_tuple("Refused").field(refused).finish(),
            Self::Mapped { report, .. } => f.debug_tuple("Mapped").field(report).finish(),
            Self::Detected(detections) => f.debug_tuple("Detected").field(detections).finish(),
            Self::DetectorFailed(e) => f.debug_tuple("DetectorFailed").field(e).finish(),
            Self::Rejudged { report, .. } => f.debug_tuple("Rejudged").field(report).finish(),
            Self::Revoked { report, .. } => f.debug_tuple("Revoked").field(report).finish(),
            Self::Looped(report) => f.debug_tuple("Looped").field(report).finish(),
            Self::Corrected { report, .. } => f.debug_tuple("Corrected").field(report).finish(),
        }
    }
}

/// A frame that went through tracking.
#[derive(Clone)]
pub struct FrameEvent {
    /// The frame itself. None only for a subscriber of a live run that asked for no images, or that so many wait for that this
    /// one would be one too many.
    pub frame: Option<Arc<RgbdFrame>>,
    /// What became of it.
    pub report: FrameReport,
    /// How well things stand at it.
    pub health: Health,
}

/// Without the images.
impl std::fmt::Debug for FrameEvent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { report, health, .. } = self;
        let frame = &mut f.debug_struct("Frame");
        frame.field("report", report).field("health", health);
        frame.finish()
    }
}
