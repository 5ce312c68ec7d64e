//! Matched remote endpoints of a node's writers and readers.

use rustdds::GUID;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of remote endpoints matched with a writer or reader.
#[derive(Clone, Debug, Default)]
pub struct Others(Arc<AtomicUsize>);

impl Others {
    /// The current number.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

/// Local endpoints with their matched remote endpoints.
#[derive(Default)]
pub(crate) struct Matches {
    of: BTreeMap<GUID, (BTreeSet<GUID>, Others)>,
}

impl Matches {
    pub(crate) fn track(&mut self, own: GUID) -> Others {
        let others = Others::default();
        self.of.insert(own, (BTreeSet::new(), others.clone()));
        others
    }

    pub(crate) fn matched(&mut self, own: GUID, other: GUID) {
        // Ignores the node's own endpoints.
        if own.prefix == other.prefix {
            return;
        }
        if let Some((all, count)) = self.of.get_mut(&own) {
            all.insert(other);
            count.0.store(all.len(), Ordering::Relaxed);
        }
    }

    pub(crate) fn lost(&mut self, other: GUID) {
        for (all, count) in self.of.values_mut() {
            if all.remove(&other) {
                count.0.store(all.len(), Ordering::Relaxed);
            }
        }
    }
}
