//! Ctrl-C: the first asks the loop to end after the frame at hand, the second ends the process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Says whether the user asked to stop.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Begins to listen for Ctrl-C (SIGINT) and SIGTERM. Where that is not possible, Ctrl-C ends the process at once, as usual.
    pub(crate) fn listen() -> Self {
        use signal_hook::consts::{SIGINT, SIGTERM};
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // Order matters: the shutdown sees the flag as it was before this signal, so only a second one ends the process.
            let armed = signal_hook::flag::register_conditional_shutdown(signal, 130, flag.clone())
                .and_then(|_| signal_hook::flag::register(signal, flag.clone()));
            if let Err(e) = armed {
                crate::console::warn(&format!("Ctrl-C will end the program at once: {e}"));
            }
        }
        Self(flag)
    }

    /// What becomes true once the user asked to stop.
    pub(crate) fn flag(&self) -> &AtomicBool {
        &self.0
    }

    /// True once the user asked to stop.
    pub(crate) fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
