//! `--trace`: every span of every thread, as a file for Perfetto and `chrome://tracing`.
//!
//! Spans are kept in memory until whoever has the file fetches them, which happens at every frame, so that no stage ever waits for
//! a disk. When nobody fetches them for long, further ones are left out and counted. The format is Chrome's "Trace Event Format",
//! as an object: complete events (`X`) with microseconds, and names of threads as metadata (`M`). Crates that write it need
//! the registry of `tracing-subscriber`, which would measure everything a second time.

use crate::failure::Failure;
use crate::output::StreamedFile;
use crate::run::session::listeners::Writer;
use crate::timing::Timing;
use std::cell::Cell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use stillpoint::slam::Event;

const OPTION: &str = "--trace";
/// Spans that wait to be fetched, at most: some 10 MB, and minutes of a run.
const MOST: usize = 1 << 18;

/// Spans that wait to be fetched.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    wanted: AtomicBool,
    kept: Mutex<Kept>,
}

#[derive(Debug, Default)]
struct Kept {
    spans: Vec<Span>,
    /// Spans for which there was no room.
    left_out: u64,
    /// Names of the threads, by their numbers.
    threads: Vec<String>,
}

/// A span that was left.
#[derive(Clone, Copy, Debug)]
struct Span {
    stage: usize,
    thread: usize,
    entered: Instant,
    left: Instant,
}

thread_local! {
    /// The number of this thread in the trace.
    static THREAD: Cell<Option<usize>> = const { Cell::new(None) };
}

impl Kept {
    /// The number of the thread that asks.
    fn thread(&mut self) -> usize {
        THREAD.get().unwrap_or_else(|| {
            let thread = std::thread::current();
            let number = self.threads.len();
            let name = thread.name().map(str::to_owned);
            self.threads
                .push(name.unwrap_or_else(|| format!("thread {number}")));
            THREAD.set(Some(number));
            number
        })
    }
}

impl Trace {
    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps a span of this thread, if somebody wants it.
    pub(crate) fn add(&self, stage: usize, entered: Instant, left: Instant) {
        if !self.wanted.load(Ordering::Relaxed) {
            return;
        }
        let mut kept = self.lock();
        if kept.spans.len() >= MOST {
            kept.left_out += 1;
            return;
        }
        let thread = kept.thread();
        kept.spans.push(Span {
            stage,
            thread,
            entered,
            left,
        });
    }
}

/// The file in the making.
pub(crate) struct TraceFile {
    file: StreamedFile,
    path: PathBuf,
    timing: &'static Timing,
    start: Instant,
    /// Threads whose names are written.
    named: usize,
    spans: u64,
}

/// Every event is a chance to fetch what was kept.
impl Writer for TraceFile {
    fn write(&mut self, _: &Event) -> Result<(), Failure> {
        self.fetch()
    }
}

impl TraceFile {
    /// Begins to keep spans, and the file.
    pub(crate) fn create(path: &Path, timing: &'static Timing) -> Result<Self, Failure> {
        let mut file = StreamedFile::create(path, OPTION)?;
        file.write(|w| {
            w.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
            write!(w, "{}", named("process_name", 0, "stillpoint"))
        })?;
        timing.trace.wanted.store(true, Ordering::Relaxed);
        Ok(Self {
            file,
            path: path.to_owned(),
            timing,
            start: Instant::now(),
            named: 0,
            spans: 0,
        })
    }

    /// Writes what was kept since the last time.
    pub(crate) fn fetch(&mut self) -> Result<(), Failure> {
        let (spans, new_threads) = {
            let mut kept = self.timing.trace.lock();
            let new: Vec<String> = kept.threads[self.named..].to_vec();
            (std::mem::take(&mut kept.spans), new)
        };
        let (start, timing, first) = (self.start, self.timing, self.named);
        self.named += new_threads.len();
        self.spans += spans.len() as u64;
        self.file.write(|w| {
            for (i, name) in new_threads.iter().enumerate() {
                write!(w, ",\n{}", named("thread_name", first + i, name))?;
            }
            for span in &spans {
                // Whole nanoseconds as decimals of microseconds, exactly.
                let us = |from: Instant, to: Instant| {
                    let ns = to.saturating_duration_since(from).as_nanos();
                    format!("{}.{:03}", ns / 1000, ns % 1000)
                };
                write!(
                    w,
                    ",\n{{\"ph\":\"X\",\"pid\":1,\"tid\":{},\"name\":{},\"ts\":{},\"dur\":{}}}",
                    span.thread,
                    serde_json::Value::from(timing.name(span.stage)),
                    us(start, span.entered),
                    us(span.entered, span.left)
                )?;
            }
            Ok(())
        })
    }

    /// Puts the file where it belongs. Returns what there is, for the report.
    pub(crate) fn finish(mut self) -> Result<String, Failure> {
        self.timing.trace.wanted.store(false, Ordering::Relaxed);
        self.fetch()?;
        let left_out = self.timing.trace.lock().left_out;
        self.file
            .write(|w| writeln!(w, "\n],\"otherData\":{{\"left_out\":{left_out}}}}}"))?;
        self.file.finish()?;
        let missing = match left_out {
            0 => String::new(),
            n => format!(", {n} more were left out"),
        };
        Ok(format!(
            "{} spans in {}{missing} (to be opened with ui.perfetto.dev)\n",
            self.spans,
            self.path.display()
        ))
    }
}

/// A metadata event that names a process or a thread.
fn named(what: &str, thread: usize, name: &str) -> serde_json::Value {
    serde_json::json!({"ph": "M", "pid": 1, "tid": thread, "name": what, "args": {"name": name}})
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_without_room_are_counted_and_what_is_fetched_makes_room() {
        let timing: &'static Timing = Box::leak(Box::default());
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.json");
        let now = Instant::now();
        timing.trace.add(0, now, now);
        let mut file = TraceFile::create(&path, timing).unwrap();
        for _ in 0..MOST + 2 {
            timing.trace.add(0, now, now);
        }
        file.fetch().unwrap();
        timing.trace.add(0, now, now);
        let said = file.finish().unwrap();
        assert!(said.contains(&format!("{} spans", MOST + 1)), "{said}");
        assert!(said.contains("2 more were left out"), "{said}");
        timing.trace.add(0, now, now);
        assert!(timing.trace.lock().spans.is_empty());
        let all: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(all["otherData"]["left_out"], 2);
        // The process and one thread have names.
        assert_eq!(all["traceEvents"].as_array().unwrap().len(), MOST + 1 + 2);
    }
}
