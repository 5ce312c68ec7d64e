//! In which order the stages took their messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use stillpoint_slam::LogEntry;

/// What one stage took, with numbers that all stages count together. A message is put into a mailbox after its sender got the
/// number of what it took itself, and taken out before its receiver gets one; so numbers never contradict what caused what.
pub(crate) struct Recorder {
    counter: Arc<AtomicU64>,
    /// Whether anybody wants the log.
    keeps: bool,
    entries: Vec<(u64, LogEntry)>,
}

impl Recorder {
    /// A recorder that counts with others.
    pub(crate) fn new(counter: &Arc<AtomicU64>, keeps: bool) -> Self {
        Self {
            counter: Arc::clone(counter),
            keeps,
            entries: Vec::new(),
        }
    }

    /// Notes that a message was taken.
    pub(crate) fn took(&mut self, entry: LogEntry) {
        if !self.keeps {
            return;
        }
        // The mailboxes' locks order the threads; the counter only has to give each number once.
        let number = self.counter.fetch_add(1, Ordering::Relaxed);
        self.entries.push((number, entry));
    }

    /// Whether the log is kept, and what else grows with every frame.
    pub(crate) fn keeps(&self) -> bool {
        self.keeps
    }

    /// All entries of several stages, in the order of taking.
    pub(crate) fn merge(all: impl IntoIterator<Item = Self>) -> Vec<LogEntry> {
        let mut entries: Vec<(u64, LogEntry)> = all.into_iter().flat_map(|r| r.entries).collect();
        entries.sort_by_key(|(number, _)| *number);
        entries.into_iter().map(|(_, entry)| entry).collect()
    }
}
