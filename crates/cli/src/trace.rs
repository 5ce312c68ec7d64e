//! Every span of every thread, kept for `--trace`.
//!
//! Spans stay in memory until the code that writes the file fetches them, at every frame, so that no stage waits for
//! a disk. When nobody fetches them for long, further ones are left out and counted.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Spans that wait to be fetched, at most: some 10 MB, and minutes of a run.
pub(crate) const MOST: usize = 1 << 18;

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
pub(crate) struct Span {
    /// Its number among the stages that are timed.
    pub(crate) stage: usize,
    /// The number of its thread.
    pub(crate) thread: usize,
    pub(crate) entered: Instant,
    pub(crate) left: Instant,
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

    /// From now on somebody wants spans, or nobody any more.
    pub(crate) fn want(&self, wanted: bool) {
        self.wanted.store(wanted, Ordering::Relaxed);
    }

    /// Takes what was kept since the last time, and the names of the threads but the first so many.
    pub(crate) fn take(&self, named: usize) -> (Vec<Span>, Vec<String>) {
        let mut kept = self.lock();
        let new = kept.threads[named..].to_vec();
        (std::mem::take(&mut kept.spans), new)
    }

    /// Spans for which there was no room.
    pub(crate) fn left_out(&self) -> u64 {
        self.lock().left_out
    }
}
