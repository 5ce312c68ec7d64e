//! `--view`: shows the run in browsers while it goes on.
//!
//! Decides when images and the map are updated, and measures the run. [`LivePage`] defines the contents, [`serve`](crate::serve) the
//! access.

use crate::console;
use crate::failure::Failure;
use crate::priority;
use crate::serve::{Feed, Place, Server};
use crate::sink::{Ended, Output, PICTURES, Sink, Start, Subscription};
use clap::Args;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use stillpoint::dense::Mesh;
use stillpoint::live::{Delivery, FrameTiming, LiveHealth, Stage, Watch};
use stillpoint::map::MapView;
use stillpoint::slam::Event;
use stillpoint::view::live::{About, LivePage, Measured, to_html};
use stillpoint::view::report::{RunData, SurfaceColumns};

const VIEW: &str = "view";
/// Maximum number of queued events of each kind: some seconds.
const SHOWN: usize = 128;
/// Minimum interval between images: less than between two updates of a page, so that each has a new one.
const PICTURE: Duration = Duration::from_millis(60);
/// Minimum interval between updates of the map.
const MAP: Duration = Duration::from_millis(500);
/// Minimum interval between those updates as a multiple of their duration: they use at most 5 % of a core.
const MAP_SHARE: u32 = 20;

/// Interval between queries of the threads' state, which briefly block them.
const HEALTH: Duration = Duration::from_millis(400);

/// The page, and measurements of the run.
struct Shown {
    page: Mutex<LivePage>,
    watch: OnceLock<Watch>,
    /// Whether a page was open at the newest event.
    is_watched: AtomicBool,
    /// The last measurements, with their time.
    known: Mutex<Option<(Instant, Measured)>>,
}

impl Shown {
    fn page(&self) -> MutexGuard<'_, LivePage> {
        self.page.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Measurements of a live run; the latency is that of the newest frame.
    fn measured(&self) -> Option<Measured> {
        let watch = self.watch.get()?;
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        match &mut *known {
            Some((asked, measured)) if asked.elapsed() < HEALTH => {
                set_timing(measured, watch.timing());
            }
            known => *known = Some((Instant::now(), measured(&watch.health()))),
        }
        known.as_ref().map(|(_, measured)| measured.clone())
    }
}

fn set_timing(measured: &mut Measured, timing: Option<FrameTiming>) {
    measured.frame = timing.map(|t| t.frame.0);
    measured.latency_ms = timing.map(|t| 1e3 * t.latency);
}

impl Feed for Shown {
    fn since(&self, version: u64, json: &mut Vec<u8>) -> u64 {
        let measured = self.measured();
        let update = {
            let mut page = self.page();
            if let Some(measured) = measured {
                page.measure(measured);
            }
            page.since(version)
        };
        let begin = json.len();
        if serde_json::to_writer(&mut *json, &update).is_err() {
            json.truncate(begin);
            json.extend_from_slice(b"{}");
        }
        update.version
    }
}

fn measured(health: &LiveHealth) -> Measured {
    let troubles = health
        .troubles()
        .map(|(stage, state)| format!("{stage}: {state}"));
    let mut measured = Measured {
        silent_s: health.frame_age,
        dropped: health.dropped,
        troubles: troubles.collect(),
        ..Measured::default()
    };
    set_timing(&mut measured, health.timing);
    measured
}

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ViewOutput {
    /// Show the run in a browser while it goes on: frames with verdicts and boxes, the map, health and latency. The address to open is
    /// printed; without ADDR it is reachable from this machine only. The page is read-only and ends with the run. PATH goes before this
    /// option.
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, default_missing_value = "", verbatim_doc_comment)]
    pub(crate) view: Option<Place>,
}

impl Output for ViewOutput {
    /// Starts the server, and connects the display of the surface, if the run has one.
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(place) = &self.view else {
            return Ok(None);
        };
        let about = About {
            name: start.name.clone(),
            input: format!("{} - camera {}", start.input.layout, start.input.camera),
            command: start.command.clone(),
            config: start.config_text.to_owned(),
            time_is: "latency".to_owned(),
            frames: start.frames.map(|n| n as u64),
        };
        let view = PageView::start(place, about)?;
        if let Some(window) = start.shelf.get::<SurfaceWindow>() {
            // Set only once: a run has one page.
            let _ = window.0.set(Arc::clone(&view.shown));
        }
        Ok(Some(Box::new(view)))
    }

    fn wants_colour(&self) -> bool {
        self.view.is_some()
    }
}

/// Live display of the surface, active once there is a page.
#[derive(Clone, Default)]
pub(crate) struct SurfaceWindow(Arc<OnceLock<Arc<Shown>>>);

impl SurfaceWindow {
    pub(crate) fn is_watched(&self) -> bool {
        let shown = self.0.get();
        shown.is_some_and(|s| s.is_watched.load(Ordering::Relaxed))
    }

    pub(crate) fn show(&self, mesh: &Mesh) {
        if let Some(shown) = self.0.get() {
            shown.page().set_surface(surface(mesh));
        }
    }
}

/// Maximum number of triangles on a page: 15 to 20 bytes each, and fast enough without a graphics card.
const MOST_TRIANGLES: usize = 20_000;

/// A surface in the page's format.
pub(crate) fn surface(mesh: &Mesh) -> SurfaceColumns {
    let shown = mesh.with_triangles(MOST_TRIANGLES);
    SurfaceColumns::new(
        mesh.triangles.len(),
        &shown.positions,
        &shown.colours,
        &shown.triangles,
    )
}

pub(crate) struct PageView {
    shown: Arc<Shown>,
    server: Server,
    pictured: Option<Instant>,
    next_map: Option<Instant>,
}

impl PageView {
    fn start(place: &Place, about: About) -> Result<Self, Failure> {
        let html = to_html(&about.name);
        let shown = Arc::new(Shown {
            page: Mutex::new(LivePage::new(about)),
            watch: OnceLock::new(),
            is_watched: AtomicBool::new(false),
            known: Mutex::default(),
        });
        let feed: Arc<dyn Feed> = Arc::clone(&shown) as _;
        let server = Server::start(place, html, feed, || priority::lower(Stage::Looping))?;
        console::line(&format!("live page at {}", server.url()));
        if server.is_open() {
            console::warn(
                "the live page is open to the network: everybody who is told this address sees what the camera sees, and it is not encrypted; without ADDR only this machine does",
            );
        }
        Ok(Self {
            shown,
            server,
            pictured: None,
            next_map: None,
        })
    }

    /// Sends the report of the run, which supersedes the live data.
    pub(crate) fn report(&self, run: &RunData) {
        if let Ok(json) = serde_json::to_string(run) {
            self.server.end("report", json);
        }
    }

    /// Ends the page of a finished run. Pages that have the report keep it.
    pub(crate) fn end(&self, out: &Path) {
        // A run without a report ends with this message.
        self.shown.page().follow_map(true);
        let text = format!("The result is in {}.", out.display());
        let json = serde_json::Value::String(text).to_string();
        self.server.end("end", json);
    }

    fn follow_map(&mut self, page: &mut LivePage) {
        let began = Instant::now();
        if !page.is_behind() || self.next_map.is_some_and(|next| began < next) {
            return;
        }
        page.follow_map(false);
        let rest = (began.elapsed() * MAP_SHARE).max(MAP);
        self.next_map = Some(began + rest);
    }
}

impl Sink for PageView {
    fn subscribe(&mut self, map: &Arc<MapView>, watch: Option<&Watch>) -> Option<Subscription> {
        if map.keyframe_count() > 0 {
            self.shown.page().begin_with(Arc::clone(map));
        }
        if let Some(watch) = watch {
            // Set only once: a page shows one run.
            let _ = self.shown.watch.set(watch.clone());
        }
        Some(Subscription {
            name: VIEW,
            // Viewers want the newest state. No frame waits for them, even in runs that drop no frames.
            delivery: Delivery::newest(SHOWN).with_images(PICTURES, 2),
        })
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let _span = tracing::info_span!("view").entered();
        let is_watched = self.server.is_watched();
        self.shown.is_watched.store(is_watched, Ordering::Relaxed);
        let is_due = self.pictured.is_none_or(|at| at.elapsed() >= PICTURE);
        let pictures = event.as_frame().is_some_and(|f| f.frame.is_some());
        let wants_picture = is_watched && is_due && pictures;
        if wants_picture {
            self.pictured = Some(Instant::now());
        }
        let measured = event.as_frame().and_then(|_| self.shown.measured());
        let shown = Arc::clone(&self.shown);
        let mut page = shown.page();
        if let Some(measured) = measured {
            page.measure(measured);
        }
        page.take(event, wants_picture);
        if is_watched {
            self.follow_map(&mut page);
        }
        drop(page);
        if is_watched && event.as_frame().is_some() {
            self.server.wake();
        }
        Ok(())
    }

    /// The page stays open until the result is written, to get the report.
    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        ended.found.shelf.put(*self);
        Ok(())
    }
}
