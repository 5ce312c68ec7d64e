//! Who is at the other ends of a node's writers and readers.

use rustdds::GUID;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How many are at the other ends of a writer or reader.
#[derive(Clone, Debug, Default)]
pub struct Others(Arc<AtomicUsize>);

impl Others {
    /// As of now.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

/// The ends here, and who is at the others.
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
        // The node itself is nobody else.
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
