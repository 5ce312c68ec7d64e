//! Collects the data of a report during a run.

use super::columns::Column;
use super::marks::mark_of;
use super::model::{Mark, Said};
use super::thumbnail::Thumbnails;
use std::collections::BTreeMap;
use stillpoint_detection::{Motion, MotionWeights, Object, ObjectState};
use stillpoint_geometry::Vec3;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_slam::{Event, FrameReport, Health, Outcome, Reasons, Subscriber};

use crate::speed::{certain_speed, shown_motion};
use crate::tinted::tinted;

/// Maximum number of images: a page of 10 MB for a run of an hour. In longer runs every second one is dropped, repeatedly.
const MOST_PICTURES: usize = 1200;
/// Maximum number of additional images of the first frames of losses.
const MOST_LOSSES: usize = 40;
/// Static features are thinned to one in this many.
pub(super) const ONE_IN: usize = 4;
/// Maximum number of moving features per image.
const MOST_MOVING: usize = 400;

/// Collects the data of a report. Events without images (from a live run under load) add no image.
#[derive(Default)]
pub struct ReportRecorder {
    frames: Vec<Seen>,
    shown: BTreeMap<FrameId, Shown>,
    losses: BTreeMap<FrameId, Shown>,
    /// One frame in `2^halved` has an image.
    halved: u32,
    marks: Vec<Mark>,
    /// Number of keyframe ids before the first frame.
    known: u32,
    thumbnails: Thumbnails,
    image: [u32; 2],
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) frame: FrameId,
    pub(super) moving: f64,
    pub(super) sigma_m: Option<f64>,
    pub(super) quality: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Shown {
    pub(super) webp: Column<u8>,
    pub(super) features: Column<u8>,
    pub(super) objects: Vec<SeenObject>,
}

#[derive(Clone, Debug)]
pub(crate) struct SeenObject {
    pub(super) id: u32,
    pub(super) class: &'static str,
    pub(super) motion: Motion,
    pub(super) bounds: [f64; 4],
    /// m, in camera coordinates, so that it follows corrections of the frame's pose.
    pub(super) in_camera: Option<Vec3>,
    pub(super) size: [f64; 2],
    pub(super) speed: Option<f64>,
}

impl Subscriber for ReportRecorder {
    fn receive(&mut self, event: &Event) {
        self.marks.extend(mark_of(event, self.known));
        if let Event::Frame(event) = event {
            self.take(&event.report, &event.health);
            if let Some(frame) = &event.frame {
                self.show(frame, &event.report);
            }
        }
    }
}

impl ReportRecorder {
    /// A recorder before the first frame.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// For a run that starts with a map of this many keyframe ids.
    pub fn begin_with(&mut self, ids: usize) {
        self.known = u32::try_from(ids).unwrap_or(u32::MAX);
    }

    pub(super) fn frames(&self) -> &[Seen] {
        &self.frames
    }

    pub(super) fn marks(&self) -> &[Mark] {
        &self.marks
    }

    pub(super) fn image(&self) -> [u32; 2] {
        self.image
    }

    pub(super) fn picture_size(&self, width: usize, height: usize) -> (usize, usize) {
        self.thumbnails.size(width, height)
    }

    pub(super) fn shown(&self) -> BTreeMap<FrameId, &Shown> {
        let losses = self.losses.iter();
        self.shown
            .iter()
            .chain(losses)
            .map(|(f, s)| (*f, s))
            .collect()
    }

    fn take(&mut self, report: &FrameReport, health: &Health) {
        self.frames.push(Seen {
            frame: report.frame,
            moving: report.counts.moving_share(),
            sigma_m: health.sigma_m(),
            quality: health.quality.value(),
        });
    }

    /// Makes an image of every n-th frame.
    fn show(&mut self, frame: &RgbdFrame, report: &FrameReport) {
        let number = self.frames.len() - 1;
        let turn = number.is_multiple_of(1 << self.halved);
        let begins_loss = matches!(report.outcome, Outcome::Lost { since, .. } if since == report.frame)
            && self.losses.len() < MOST_LOSSES;
        if !turn && !begins_loss {
            return;
        }
        let frame = &*tinted(frame, &report.segments);
        let (width, height) = (frame.gray.width(), frame.gray.height());
        self.image = [width as u32, height as u32];
        let shown = Shown {
            webp: Column(self.thumbnails.make(frame)),
            features: features(report, [width as f32, height as f32]),
            objects: objects_of(report).collect(),
        };
        if begins_loss {
            self.losses.insert(report.frame, shown);
            return;
        }
        self.shown.insert(report.frame, shown);
        if self.shown.len() > MOST_PICTURES {
            self.halved += 1;
            let mut number = 0_usize;
            self.shown.retain(|_, _| {
                number += 1;
                !number.is_multiple_of(2)
            });
        }
    }
}

pub(crate) fn features(report: &FrameReport, [width, height]: [f32; 2]) -> Column<u8> {
    let at = |x: f32, of: f32| (x / of * 255.0).round() as u8;
    let still = report.verdicts.iter().filter(|v| !v.dynamic);
    let still = still.step_by(ONE_IN).map(|v| (v.pixel, Said::Still));
    let moving = report.verdicts.iter().filter(|v| v.dynamic);
    let every = moving.clone().count().div_ceil(MOST_MOVING).max(1);
    let moving = moving.step_by(every).map(|v| (v.pixel, said(v.reasons)));
    let all = still.chain(moving);
    all.flat_map(|([x, y], said)| [at(x, width), at(y, height), said as u8])
        .collect()
}

/// The most informative reason.
fn said(reasons: Reasons) -> Said {
    [
        (Reasons::OBJECT, Said::Object),
        (Reasons::RIGID, Said::Rigid),
        (Reasons::EPIPOLAR, Said::Epipolar),
        (Reasons::DEPTH, Said::Depth),
    ]
    .into_iter()
    .find(|(reason, _)| reasons.has(*reason))
    .map_or(Said::History, |(_, said)| said)
}

/// Objects that are neither tentative nor hidden; the latter have no measured position.
pub(crate) fn objects_of(report: &FrameReport) -> impl Iterator<Item = SeenObject> {
    let weights = MotionWeights::default();
    let sure = |o: &&Object| o.state != ObjectState::Tentative;
    let seen = move |object: &Object| {
        let b = &object.bounds;
        let hidden = object.state == ObjectState::Hidden;
        let in_camera = report
            .world_from_camera
            .filter(|_| !hidden)
            .and_then(|pose| object.seen_from(&pose));
        SeenObject {
            id: object.id.0,
            class: object.class.name(),
            motion: shown_motion(object, &weights),
            bounds: [b.x0, b.y0, b.x1, b.y1],
            in_camera: in_camera.map(|o| o.position),
            size: object.size.unwrap_or([f64::NAN; 2]),
            speed: certain_speed(object, 1.0),
        }
    };
    report.objects.iter().filter(sure).map(seen)
}
