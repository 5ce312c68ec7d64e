//! Buffers of the static filter, reused from frame to frame.

use super::history::{History, Spent};
use super::rigid::Votes;
use super::surfaces::{self, Surfaces};
use super::{FeatureVerdict, StaticFilter};
use std::sync::Arc;

#[derive(Default)]
pub(crate) struct Memory {
    history: History,
    pub(super) surfaces: Option<Arc<Surfaces>>,
    pub(super) judging: surfaces::Memory,
    pub(super) spent: Spent,
    pub(super) votes: Votes,
    pub(super) verdicts: Vec<FeatureVerdict>,
}

impl Memory {
    pub(super) fn copy(&mut self, filter: &StaticFilter) -> StaticFilter {
        let mut history = std::mem::take(&mut self.history);
        history.become_like(&filter.history);
        StaticFilter {
            rules: Arc::clone(&filter.rules),
            objects: filter.objects.clone(),
            waiting: filter.waiting.clone(),
            unused: filter.unused,
            detected: filter.detected,
            history,
            surfaces: Arc::clone(&filter.surfaces),
            movers: Arc::clone(&filter.movers),
            present: filter.present.clone(),
        }
    }

    /// Takes the memory of a discarded filter.
    pub(crate) fn give(&mut self, filter: StaticFilter) {
        self.surfaces = Some(filter.surfaces);
        self.history = filter.history;
        // Releases frames shared with the current history.
        self.history.clear();
    }
}
