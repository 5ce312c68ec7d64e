//! `--trace`: writes every span of every thread to a file for Perfetto and `chrome://tracing`.
//!
//! The format is Chrome's "Trace Event Format", as an object: complete events (`X`) in microseconds, and thread names as metadata (`M`).
//! Existing crates for it need the registry of `tracing-subscriber`, which would time everything a second time.

use crate::failure::Failure;
use crate::output::StreamedFile;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use crate::timing::Timing;
use clap::Args;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::Event;

const OPTION: &str = "--trace";

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct TraceOutput {
    /// Write a trace of all threads, for ui.perfetto.dev or chrome://tracing.
    #[arg(long, value_name = "FILE.json")]
    pub(crate) trace: Option<PathBuf>,
}

impl Output for TraceOutput {
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(path) = &self.trace else {
            return Ok(None);
        };
        Ok(Some(Box::new(TraceFile::create(path, start.timing)?)))
    }

    fn files(&self) -> Vec<(&'static str, &Path)> {
        self.trace.iter().map(|f| (OPTION, &**f)).collect()
    }
}

struct TraceFile {
    file: StreamedFile,
    path: PathBuf,
    timing: &'static Timing,
    start: Instant,
    /// Number of threads whose names are written.
    named: usize,
    spans: u64,
}

impl Sink for TraceFile {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_all("trace"))
    }

    /// Fetches the pending spans at every event.
    fn receive(&mut self, _: &Event) -> Result<(), Failure> {
        self.fetch()
    }

    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        ended.found.said += &self.close()?;
        Ok(())
    }
}

impl TraceFile {
    fn create(path: &Path, timing: &'static Timing) -> Result<Self, Failure> {
        let mut file = StreamedFile::create(path, OPTION)?;
        file.write(|w| {
            w.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
            write!(w, "{}", named("process_name", 0, "stillpoint"))
        })?;
        timing.trace.want(true);
        Ok(Self {
            file,
            path: path.to_owned(),
            timing,
            start: Instant::now(),
            named: 0,
            spans: 0,
        })
    }

    /// Writes the spans since the last call.
    fn fetch(&mut self) -> Result<(), Failure> {
        let (spans, new_threads) = self.timing.trace.take(self.named);
        let (start, timing, first) = (self.start, self.timing, self.named);
        self.named += new_threads.len();
        self.spans += spans.len() as u64;
        self.file.write(|w| {
            for (i, name) in new_threads.iter().enumerate() {
                write!(w, ",\n{}", named("thread_name", first + i, name))?;
            }
            for span in &spans {
                // Nanoseconds as exact decimals of microseconds.
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

    /// Moves the file into place. Returns a summary.
    fn close(mut self) -> Result<String, Failure> {
        self.timing.trace.want(false);
        self.fetch()?;
        let left_out = self.timing.trace.left_out();
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
    use crate::trace::MOST;

    #[test]
    fn overflowing_spans_are_counted_and_fetching_frees_space() {
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
        let said = file.close().unwrap();
        assert!(said.contains(&format!("{} spans", MOST + 1)), "{said}");
        assert!(said.contains("2 more were left out"), "{said}");
        timing.trace.add(0, now, now);
        assert!(timing.trace.take(1).0.is_empty());
        let all: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(all["otherData"]["left_out"], 2);
        // The process and one thread have names.
        assert_eq!(all["traceEvents"].as_array().unwrap().len(), MOST + 1 + 2);
    }
}
