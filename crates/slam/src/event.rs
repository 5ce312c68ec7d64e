//! Events of the system, as values shared by tests, reports and viewers.
//!
//! # Order
//! Every event but [`Event::Refused`] belongs to one entry of the run log ([`LogEntry`](crate::LogEntry)); an entry has
//! at most one event:
//!
//! | entry | event |
//! |---|---|
//! | the tracker takes detections | [`Event::Detected`] or [`Event::DetectorFailed`] |
//! | the tracker takes a frame | [`Event::Frame`] |
//! | the mapper takes a keyframe | [`Event::Mapped`] |
//! | the mapper takes late verdicts on a keyframe | [`Event::Rejudged`] |
//! | the mapper revokes the beginning of a map | [`Event::Revoked`] |
//! | the mapper takes a correction | [`Event::Corrected`] |
//! | the loop closer takes a keyframe | [`Event::Looped`], when a place was recognised |
//!
//! In all drivers, (1) events of one stage come in the order in which it took its messages, and (2) an event comes
//! after those it depends on: detections before the frame that used them, a frame before the [`Event::Mapped`] of its
//! keyframe, that before the frames tracked in its view and before the [`Event::Looped`] of its keyframe, a loop before
//! its [`Event::Corrected`]. [`System`](crate::System) and [`Replay`](crate::Replay) give events in log order. In a
//! live run stages work in parallel: independent events come as they happen, so that no frame waits for the map.

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

/// An event of one step of the system.
#[derive(Clone)]
pub enum Event {
    /// A frame was tracked. One per frame that was not refused (nor dropped, in a live run).
    Frame(Arc<FrameEvent>),
    /// A frame was repeated, out of order or did not fit the camera. It was ignored.
    Refused(RefusedFrame),
    /// The mapper took a keyframe and published a new version of the map.
    Mapped {
        /// Mapping report.
        report: MappingReport,
        /// The new version.
        view: Arc<MapView>,
    },
    /// Detections arrived for the frame they name.
    Detected(Detections),
    /// The detector failed on a frame; tracking keeps using earlier detections.
    DetectorFailed(DetectError),
    /// Features of an earlier keyframe were found to be moving; their landmarks were removed.
    Rejudged {
        /// Removed landmarks.
        report: RejudgeReport,
        /// The new version of the map.
        view: Arc<MapView>,
    },
    /// The first poses of a map were found to follow a moving object: their keyframes were revoked, and their frames
    /// have other poses, or none, in the trajectory.
    Revoked {
        /// Revoked keyframes.
        report: RevokeReport,
        /// The new version of the map.
        view: Arc<MapView>,
    },
    /// A place was recognised, and a loop closed or deferred. Applying the correction is reported later by
    /// [`Event::Corrected`].
    Looped(Box<LoopReport>),
    /// A loop correction was applied to the map; earlier poses may have changed.
    Corrected {
        /// Applied changes.
        report: CorrectionReport,
        /// The new version of the map.
        view: Arc<MapView>,
    },
}

impl Event {
    /// The [`FrameEvent`], if this is an [`Event::Frame`].
    #[must_use]
    pub fn as_frame(&self) -> Option<&FrameEvent> {
        match self {
            Self::Frame(frame) => Some(frame),
            _ => None,
        }
    }

    /// The version of the map in this event.
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
    /// Converts to the event for subscribers.
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

/// Without images and maps.
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

/// A tracked frame.
#[derive(Clone)]
pub struct FrameEvent {
    /// The frame itself. `None` only for a subscriber of a live run that did not ask for images or already has too many
    /// queued.
    pub frame: Option<Arc<RgbdFrame>>,
    /// Tracking report.
    pub report: FrameReport,
    /// Tracking quality at this frame.
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
