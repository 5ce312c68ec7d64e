//! Records the order in which the stages took their messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use stillpoint_slam::LogEntry;

/// The messages taken by one stage, with numbers from a counter shared by all stages. A sender gets the number of its own message before it
/// puts a result into a mailbox, and a receiver gets one after taking it out; so numbers respect causality.
pub(crate) struct Recorder {
    counter: Arc<AtomicU64>,
    keeps: bool,
    entries: Vec<(u64, LogEntry)>,
}

impl Recorder {
    /// A recorder that shares a counter.
    pub(crate) fn new(counter: &Arc<AtomicU64>, keeps: bool) -> Self {
        Self {
            counter: Arc::clone(counter),
            keeps,
            entries: Vec::new(),
        }
    }

    pub(crate) fn took(&mut self, entry: LogEntry) {
        if !self.keeps {
            return;
        }
        // The mailboxes' locks order the threads; the counter only has to be unique.
        let number = self.counter.fetch_add(1, Ordering::Relaxed);
        self.entries.push((number, entry));
    }

    /// Whether the log, and other data that grow with every frame, are kept.
    pub(crate) fn keeps(&self) -> bool {
        self.keeps
    }

    /// All entries of several stages, by number.
    pub(crate) fn merge(all: impl IntoIterator<Item = Self>) -> Vec<LogEntry> {
        let mut entries: Vec<(u64, LogEntry)> = all.into_iter().flat_map(|r| r.entries).collect();
        entries.sort_by_key(|(number, _)| *number);
        entries.into_iter().map(|(_, entry)| entry).collect()
    }
}
