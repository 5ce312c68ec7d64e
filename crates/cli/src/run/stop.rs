//! A flag by which a sink ends the run.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// True once a sink has failed.
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
