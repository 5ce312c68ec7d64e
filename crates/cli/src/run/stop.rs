//! The wish of a listener that the run ends, since it cannot go on.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What becomes true when a listener cannot go on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    pub(crate) fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub(crate) fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
