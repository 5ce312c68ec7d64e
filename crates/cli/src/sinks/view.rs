//! `--view`: the run in browsers while it goes on.
//!
//! Answers: when a picture is made and the map looked through, and what is measured of the run. What is shown is [`LivePage`]'s business, who may look
//! is [`serve`](crate::serve)'s.

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

/// The subscriber that browsers are shown.
const VIEW: &str = "view";
/// Events of each kind that wait to be shown, at most: some seconds.
const SHOWN: usize = 128;
/// Between two pictures: less than between two updates of a page, so that each finds a fresh one.
const PICTURE: Duration = Duration::from_millis(60);
/// Least time between two looks at the map.
const MAP: Duration = Duration::from_millis(500);
/// Least time between two looks at the map, as a multiple of the time that one look takes: looks use at most 5 % of a core.
const MAP_SHARE: u32 = 20;

/// Between two questions how the threads are: those that are asked hold still for a moment.
const HEALTH: Duration = Duration::from_millis(400);

/// What is shown, and what is measured of the run.
struct Shown {
    page: Mutex<LivePage>,
    /// Of a live run.
    watch: OnceLock<Watch>,
    /// Whether anybody looked when the newest event came.
    is_watched: AtomicBool,
    /// What is measured, and when it was asked for.
    known: Mutex<Option<(Instant, Measured)>>,
}

impl Shown {
    fn page(&self) -> MutexGuard<'_, LivePage> {
        self.page.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is measured of a live run; the latency is that of the newest frame.
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

/// What is asked for.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ViewOutput {
    /// Show the run in a browser while it goes on: the frames with verdicts and boxes, the map, health and latency. The address to open is
    /// printed; without ADDR only this machine reaches it. It takes nothing and ends with the run. PATH goes before it.
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, default_missing_value = "", verbatim_doc_comment)]
    pub(crate) view: Option<Place>,
}

impl Output for ViewOutput {
    /// Says where the run is to be seen, and shows the surface of a run that has one.
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
            // It is set once: a run has one page.
            let _ = window.0.set(Arc::clone(&view.shown));
        }
        Ok(Some(Box::new(view)))
    }

    fn wants_colour(&self) -> bool {
        self.view.is_some()
    }
}

/// Where the surface of a run is shown while it goes on, once there is a page.
#[derive(Clone, Default)]
pub(crate) struct SurfaceWindow(Arc<OnceLock<Arc<Shown>>>);

impl SurfaceWindow {
    /// Whether anybody looks.
    pub(crate) fn is_watched(&self) -> bool {
        let shown = self.0.get();
        shown.is_some_and(|s| s.is_watched.load(Ordering::Relaxed))
    }

    /// Shows it.
    pub(crate) fn show(&self, mesh: &Mesh) {
        if let Some(shown) = self.0.get() {
            shown.page().set_surface(surface(mesh));
        }
    }
}

/// Triangles that pages show of a surface, at most: 15 to 20 bytes each in the page, and drawn without a graphics card, too.
const MOST_TRIANGLES: usize = 20_000;

/// A surface as pages show it.
pub(crate) fn surface(mesh: &Mesh) -> SurfaceColumns {
    let shown = mesh.with_triangles(MOST_TRIANGLES);
    SurfaceColumns::new(
        mesh.triangles.len(),
        &shown.positions,
        &shown.colours,
        &shown.triangles,
    )
}

/// Shows a run.
pub(crate) struct PageView {
    shown: Arc<Shown>,
    server: Server,
    pictured: Option<Instant>,
    /// When the map may be looked through again.
    next_map: Option<Instant>,
}

impl PageView {
    /// Begins to serve, and says where.
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

    /// Tells the report of the run, which is all that there is to know.
    pub(crate) fn report(&self, run: &RunData) {
        if let Ok(json) = serde_json::to_string(run) {
            self.server.end("report", json);
        }
    }

    /// Ends a page whose run came to its end. Pages that know the report keep it.
    pub(crate) fn end(&self, out: &Path) {
        // Of a run without a report this is all that there is.
        self.shown.page().follow_map(true);
        let text = format!("The result is in {}.", out.display());
        let json = serde_json::Value::String(text).to_string();
        self.server.end("end", json);
    }

    /// Looks through the map, where it is time to.
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
            // It is set once: a page is of one run.
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

    /// The page goes on until the result is written: it is told the report.
    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        ended.found.shelf.put(*self);
        Ok(())
    }
}
