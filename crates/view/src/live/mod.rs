//! The live page of a run, and its updates.
//!
//! [`LivePage`] subscribes to a run and holds its current state. A server requests the [`Update`] since a client's version, at the client's
//! pace, and [`to_html`] makes the page that shows updates. So slow clients get fewer updates, no per-client state is kept, and memory does
//! not grow with the length of the run. It opens no sockets, reads no clock, and has no threads: the server decides when an image is
//! wanted, and when the map is updated.

mod frames;
mod ledger;
mod scene;
#[cfg(test)]
mod tests;
mod update;

pub use frames::FrameUpdate;
pub use scene::{KeyframeUpdate, MapUpdate};
pub use update::{About, Measured, Now, PictureUpdate, Update};

use crate::report::{
    Column, Mark, MarkKind, ObjectColumns, SurfaceColumns, Thumbnails, features, mark_of,
    objects_of, page,
};
use crate::tinted::tinted;
use frames::Frames;
use ledger::Ledger;
use scene::MapScene;
use std::sync::Arc;
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{KeyframeId, MapView};
use stillpoint_slam::{Event, FrameReport, Health, Outcome, Subscriber};

/// Maximum number of shown events; the oldest are dropped.
const MOST_MARKS: usize = 500;
/// Average size of an image, bytes: fifteen per second take 1.3 Mbit/s as text.
const PICTURE_BYTES: usize = 8_000;

/// The live page, titled with the run's name. It requests the relative URL `events` as server-sent events: `update` with an [`Update`]
/// each, and at the end `report` with a [`RunData`](crate::report::RunData), or `end` with a line of text.
#[must_use]
pub fn to_html(name: &str) -> String {
    page(name, "null", true)
}

/// The state of the live page.
pub struct LivePage {
    version: u64,
    about: About,
    frames: Frames,
    scene: MapScene,
    marks: Ledger<Mark>,
    next_mark: u32,
    picture: Option<(u64, PictureUpdate)>,
    surface: Option<(u64, SurfaceColumns)>,
    now: Now,
    view: Option<Arc<MapView>>,
    /// Whether there is a map that was not processed yet.
    behind: bool,
    first_id: u32,
    thumbnails: Thumbnails,
}

impl LivePage {
    /// Before the first frame.
    #[must_use]
    pub fn new(about: About) -> Self {
        Self {
            version: 1,
            about,
            frames: Frames::default(),
            scene: MapScene::default(),
            marks: Ledger::default(),
            next_mark: 0,
            picture: None,
            surface: None,
            now: Now::default(),
            view: None,
            behind: false,
            first_id: 0,
            thumbnails: Thumbnails::new(PICTURE_BYTES),
        }
    }

    /// Sets the map that exists before the first frame.
    pub fn begin_with(&mut self, view: Arc<MapView>) {
        self.first_id = view.keyframe_bound() as u32;
        self.frames.begin(Arc::clone(&view));
        self.count_map(&view);
        self.view = Some(view);
        self.behind = true;
        self.version += 1;
    }

    /// Processes an event. A frame's image is only made if requested, and if the event holds it. The newest map version is kept for
    /// [`LivePage::follow_map`].
    pub fn take(&mut self, event: &Event, wants_picture: bool) {
        self.version += 1;
        if let Some(view) = event.view() {
            let newest = match event {
                Event::Mapped { report, .. } => Some(report.keyframe),
                _ => None,
            };
            self.take_view(view, newest);
        }
        if let Some(mark) = mark_of(event, self.first_id) {
            self.mark(mark);
        }
        match event {
            Event::Frame(event) => {
                self.take_frame(&event.report, &event.health);
                if let Some(frame) = event.frame.as_ref().filter(|_| wants_picture) {
                    self.show(frame, &event.report);
                }
            }
            Event::Detected(_) => self.now.detections += 1,
            Event::Looped(report) => {
                self.now.set_aside += u32::from(report.outcome.is_set_aside());
            }
            _ => {}
        }
    }

    /// Sets the measurements of the run's driver.
    pub fn measure(&mut self, measured: Measured) {
        self.now.measured = measured;
    }

    /// Sets the current surface of the static scene.
    pub fn set_surface(&mut self, surface: SurfaceColumns) {
        self.version += 1;
        self.surface = Some((self.version, surface));
    }

    /// Whether [`LivePage::follow_map`] has a map to process.
    #[must_use]
    pub fn is_behind(&self) -> bool {
        self.behind
    }

    /// Processes the newest map. `exactly`: includes changes too small to see. Takes some milliseconds for 50 000 landmarks.
    pub fn follow_map(&mut self, exactly: bool) {
        let Some(view) = &self.view else { return };
        self.version += 1;
        self.behind = false;
        let submap = self.frames.submap();
        self.scene.follow(self.version, view, submap, exactly);
        self.frames.follow(self.version);
    }

    /// The changes after a version; after 0, everything. The client must have received all updates up to that version.
    #[must_use]
    pub fn since(&self, version: u64) -> Update {
        let picture = self.picture.as_ref().filter(|(at, _)| *at > version);
        let surface = self.surface.as_ref().filter(|(at, _)| *at > version);
        let mut marks = self.marks.since(version);
        marks.set.sort_by_key(|(number, _)| *number);
        Update {
            version: self.version,
            about: (version == 0).then(|| self.about.clone()),
            frames: self.frames.since(version),
            map: self.scene.since(version),
            surface: surface.map(|(_, s)| s.clone()),
            marks: marks.set.into_iter().map(|(_, m)| m.clone()).collect(),
            picture: picture.map(|(_, p)| p.clone()),
            now: self.now.clone(),
        }
    }

    fn take_view(&mut self, view: &Arc<MapView>, newest: Option<KeyframeId>) {
        self.frames.set_view(view, newest);
        self.count_map(view);
        self.view = Some(Arc::clone(view));
        self.behind = true;
    }

    fn count_map(&mut self, view: &MapView) {
        self.now.keyframes = view.keyframe_count() as u32;
        self.now.landmarks = view.landmark_count() as u32;
        self.now.loops = view.loops().count() as u32;
    }

    fn take_frame(&mut self, report: &FrameReport, health: &Health) {
        let measured = &self.now.measured;
        let time_ms = measured
            .latency_ms
            .filter(|_| measured.frame == Some(report.frame.0));
        self.frames.take(self.version, report, health, time_ms);
        if let Outcome::Lost { since, reason } = report.outcome
            && since == report.frame
        {
            self.mark(Mark {
                frame: report.frame.0,
                kind: MarkKind::Loss,
                text: format!("no pose: {reason}"),
            });
        }
        self.now.frames = self.frames.count() as u64;
        self.now.posed = self.frames.posed() as u64;
        self.now.set_health(report, health);
    }

    fn mark(&mut self, mark: Mark) {
        self.marks.set(self.version, self.next_mark, mark);
        self.next_mark += 1;
        if self.marks.len() > MOST_MARKS {
            let first = self.next_mark - MOST_MARKS as u32;
            self.marks.retain(self.version, |number, _| number >= first);
        }
    }

    fn show(&mut self, frame: &RgbdFrame, report: &FrameReport) {
        let frame = &*tinted(frame, &report.segments);
        let image = [frame.gray.width(), frame.gray.height()];
        let size = self.thumbnails.size(image[0], image[1]);
        let mut objects = ObjectColumns::default();
        for object in objects_of(report) {
            objects.add(report.frame.0, &object, report.world_from_camera.as_ref());
        }
        let picture = PictureUpdate {
            frame: report.frame.0,
            image: image.map(|n| n as u32),
            size: [size.0 as u32, size.1 as u32],
            webp: Column(self.thumbnails.make(frame)),
            features: features(report, image.map(|n| n as f32)),
            objects,
        };
        self.picture = Some((self.version, picture));
    }
}

/// For programs without a clock: uses every image and every map.
impl Subscriber for LivePage {
    fn receive(&mut self, event: &Event) {
        self.take(event, true);
        if self.behind {
            self.follow_map(false);
        }
    }
}
