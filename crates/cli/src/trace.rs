//! Keeps every span of every thread for `--trace`.
//!
//! Spans stay in memory until they are fetched for writing, at every frame, so that no stage waits for the disk. If they are not fetched
//! for long, further ones are dropped and counted.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Maximum number of pending spans: some 10 MB, and minutes of a run.
pub(crate) const MOST: usize = 1 << 18;

#[derive(Debug, Default)]
pub(crate) struct Trace {
    wanted: AtomicBool,
    kept: Mutex<Kept>,
}

#[derive(Debug, Default)]
struct Kept {
    spans: Vec<Span>,
    left_out: u64,
    threads: Vec<String>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    pub(crate) stage: usize,
    pub(crate) thread: usize,
    pub(crate) entered: Instant,
    pub(crate) left: Instant,
}

thread_local! {
    /// The number of this thread in the trace.
    static THREAD: Cell<Option<usize>> = const { Cell::new(None) };
}

impl Kept {
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

    /// Keeps a span of this thread, if recording is on.
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

    /// Switches recording on or off.
    pub(crate) fn want(&self, wanted: bool) {
        self.wanted.store(wanted, Ordering::Relaxed);
    }

    /// Takes the spans since the last call, and the thread names from index `named` on.
    pub(crate) fn take(&self, named: usize) -> (Vec<Span>, Vec<String>) {
        let mut kept = self.lock();
        let new = kept.threads[named..].to_vec();
        (std::mem::take(&mut kept.spans), new)
    }

    pub(crate) fn left_out(&self) -> u64 {
        self.lock().left_out
    }
}
