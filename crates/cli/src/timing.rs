//! Timing and log output: the `tracing` subscriber for the spans and events of the libraries.
//!
//! Every span is timed by name on its own thread; the time of workers that share the work on a frame counts for the thread that ends the
//! frame. Durations of a name are summed until the thread ends a round (a frame, a message), so that a row of the table is the cost per
//! round in which a stage ran. A span nested in one of the same name is not counted twice, and one inside `retrace` is not counted, since
//! that reprocesses earlier frames after the newest pose is published. A span costs two clock readings and one uncontended lock. With
//! `--trace` each span is also kept individually.

use crate::console;
use crate::trace::Trace;
use std::cell::RefCell;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use stillpoint::evaluation::timing::Stats;
use stillpoint::imaging::workers;
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber, subscriber::Interest};

#[derive(Debug, Default)]
pub(crate) struct Timing {
    table: Mutex<Stages>,
    /// By stage, the time of worker threads in the current frame, ns.
    shared: Mutex<Vec<Option<u64>>>,
    pub(crate) trace: Trace,
    /// The id of the span whose nested spans are not counted; 0 until known.
    apart: AtomicU64,
    /// Number of open spans of that name.
    open_apart: AtomicUsize,
}

/// The stage whose nested spans are not counted.
const APART: &str = "retrace";

#[derive(Debug, Default)]
struct Stages {
    /// Address of a call site's metadata, and its stage.
    sites: Vec<(u64, usize)>,
    stages: Vec<TimedStage>,
    frames: usize,
}

#[derive(Debug)]
struct TimedStage {
    name: &'static str,
    /// One per round in which it ran; millions in a run of hours.
    samples: Vec<Sample>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    frame: u32,
    /// In tenths of a microsecond; saturates at seven minutes.
    duration: u32,
}

impl Sample {
    fn new(frame: usize, ms: f64) -> Self {
        Self {
            frame: frame as u32,
            // The cast saturates.
            duration: (ms * 1e4).round() as u32,
        }
    }

    fn ms(self) -> f64 {
        f64::from(self.duration) / 1e4
    }
}

impl Stages {
    fn stage_of(&mut self, site: u64, name: &'static str) -> usize {
        if let Some((_, stage)) = self.sites.iter().find(|(s, _)| *s == site) {
            return *stage;
        }
        let known = self.stages.iter().position(|s| s.name == name);
        let stage = known.unwrap_or_else(|| {
            let samples = Vec::new();
            self.stages.push(TimedStage { name, samples });
            self.stages.len() - 1
        });
        self.sites.push((site, stage));
        stage
    }
}

thread_local! {
    /// Stages entered on this thread, with the time of entry.
    static OPEN: RefCell<Vec<(u64, Instant)>> = const { RefCell::new(Vec::new()) };
    /// By stage, the sum within the current round of this thread, ns; `None` when it did not run.
    static SUMS: RefCell<Vec<Option<u64>>> = const { RefCell::new(Vec::new()) };
}

fn add(sums: &mut Vec<Option<u64>>, stage: usize, ns: u64) {
    if sums.len() <= stage {
        sums.resize(stage + 1, None);
    }
    sums[stage] = Some(sums[stage].unwrap_or(0) + ns);
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Installs the timing as the global subscriber. A second call returns timing that receives nothing.
pub(crate) fn install() -> &'static Timing {
    let timing: &'static Timing = Box::leak(Box::default());
    // Fails only if there is a subscriber already.
    let _ = tracing::subscriber::set_global_default(Recorder(timing));
    timing
}

impl Timing {
    fn lock(&self) -> MutexGuard<'_, Stages> {
        lock(&self.table)
    }

    /// Adds a frame time that was measured elsewhere, ms, and ends the frame.
    pub(crate) fn take_frame(&self, name: &'static str, milliseconds: f64) {
        let mut table = self.lock();
        let frame = table.frames;
        let sample = Sample::new(frame, milliseconds);
        match table.stages.iter_mut().find(|s| s.name == name) {
            Some(stage) => stage.samples.push(sample),
            None => table.stages.push(TimedStage {
                name,
                samples: vec![sample],
            }),
        }
        table.frames += 1;
    }

    /// Ends a frame on this thread: its sums become samples. A frame without measurements is not counted.
    pub(crate) fn end_frame(&self) {
        self.end(true);
    }

    /// Ends a message's round on this thread, outside of any frame: its sums become samples.
    pub(crate) fn end_round(&self) {
        self.end(false);
    }

    fn end(&self, is_frame: bool) {
        SUMS.with_borrow_mut(|sums| {
            if is_frame {
                let shared = std::mem::take(&mut *lock(&self.shared));
                for (stage, ns) in shared.into_iter().enumerate() {
                    ns.into_iter().for_each(|ns| add(sums, stage, ns));
                }
            }
            if sums.iter().all(Option::is_none) {
                return;
            }
            let mut table = self.lock();
            let frame = table.frames;
            for (stage, sum) in table.stages.iter_mut().zip(sums) {
                if let Some(ns) = sum.take() {
                    stage.samples.push(Sample::new(frame, ns as f64 * 1e-6));
                }
            }
            table.frames += usize::from(is_frame);
        });
    }

    /// Clears all measurements, for another pass in the same process.
    pub(crate) fn restart(&self) {
        SUMS.with_borrow_mut(Vec::clear);
        lock(&self.shared).clear();
        let mut table = self.lock();
        table.frames = 0;
        for stage in &mut table.stages {
            stage.samples.clear();
        }
    }

    pub(crate) fn name(&self, stage: usize) -> &'static str {
        self.lock().stages.get(stage).map_or("?", |s| s.name)
    }

    /// Statistics per stage in ms, in the order in which the stages first ran.
    pub(crate) fn statistics(&self) -> Vec<(&'static str, Stats)> {
        let table = self.lock();
        let stages = table.stages.iter().filter(|s| !s.samples.is_empty());
        stages
            .map(|s| {
                let ms: Vec<f64> = s.samples.iter().map(|sample| sample.ms()).collect();
                (s.name, Stats::of(&ms))
            })
            .collect()
    }

    /// A stage's time in every frame, ms; NaN where it did not run.
    pub(crate) fn per_frame(&self, name: &str) -> Vec<f64> {
        let table = self.lock();
        let mut all = vec![f64::NAN; table.frames];
        for stage in table.stages.iter().filter(|s| s.name == name) {
            for sample in &stage.samples {
                if let Some(of_frame) = all.get_mut(sample.frame as usize) {
                    *of_frame = sample.ms();
                }
            }
        }
        all
    }
}

/// Feeds [`Timing`] and prints events. A span's id is its stage, so that entering needs no look-up by instance.
struct Recorder(&'static Timing);

impl Subscriber for Recorder {
    fn register_callsite(&self, metadata: &'static Metadata<'static>) -> Interest {
        if self.enabled(metadata) {
            Interest::always()
        } else {
            Interest::never()
        }
    }

    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_span() || *metadata.level() <= event_level()
    }

    fn new_span(&self, attributes: &Attributes<'_>) -> Id {
        let metadata = attributes.metadata();
        let site = std::ptr::from_ref(metadata) as u64;
        let stage = self.0.lock().stage_of(site, metadata.name());
        let id = stage as u64 + 1;
        if metadata.name() == APART {
            self.0.apart.store(id, Ordering::Relaxed);
        }
        Id::from_u64(id)
    }

    fn enter(&self, span: &Id) {
        let id = span.into_u64();
        if id == self.0.apart.load(Ordering::Relaxed) {
            self.0.open_apart.fetch_add(1, Ordering::Relaxed);
        }
        OPEN.with_borrow_mut(|open| open.push((id, Instant::now())));
    }

    fn exit(&self, span: &Id) {
        let now = Instant::now();
        let id = span.into_u64();
        let apart = self.0.apart.load(Ordering::Relaxed);
        if id == apart {
            self.0.open_apart.fetch_sub(1, Ordering::Relaxed);
        }
        let left = OPEN.with_borrow_mut(|open| {
            let at = open.iter().rposition(|(s, _)| *s == id)?;
            let (_, entered) = open.remove(at);
            // Inside another span of the same name the outer one counts this time.
            let counts = open.iter().all(|(s, _)| *s != id && *s != apart);
            Some((entered, counts))
        });
        let Some((entered, counts)) = left else {
            return;
        };
        let stage = id as usize - 1;
        self.0.trace.add(stage, entered, now);
        if counts {
            let ns = now.duration_since(entered).as_nanos() as u64;
            if workers::is_one() {
                // During a retrace the workers serve that thread.
                if self.0.open_apart.load(Ordering::Relaxed) == 0 {
                    add(&mut lock(&self.0.shared), stage, ns);
                }
            } else {
                SUMS.with_borrow_mut(|sums| add(sums, stage, ns));
            }
        }
    }

    fn event(&self, event: &Event<'_>) {
        let mut text = Text::default();
        event.record(&mut text);
        let level = match *event.metadata().level() {
            Level::ERROR => "error: ",
            Level::WARN => "warning: ",
            // Messages at this level are sentences.
            Level::INFO => "",
            Level::DEBUG => "debug: ",
            Level::TRACE => "trace: ",
        };
        console::line(&format!("{level}{}{}", text.message, text.fields));
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}
}

fn event_level() -> Level {
    match console::verbosity() {
        0 => Level::ERROR,
        1 => Level::WARN,
        2 => Level::INFO,
        _ => Level::TRACE,
    }
}

/// An event's message and its fields as ` key=value`.
#[derive(Default)]
struct Text {
    message: String,
    fields: String,
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        // Writing to a String cannot fail.
        let _ = if field.name() == "message" {
            write!(self.message, "{value:?}")
        } else {
            write!(self.fields, " {}={value:?}", field.name())
        };
    }
}

#[cfg(test)]
mod tests;
