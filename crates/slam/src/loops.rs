//! Collects the loop candidates of a run from its events.

use crate::event::Event;
use crate::report::{LoopOutcome, LoopReport};
use crate::subscriber::Subscriber;

/// Reports of loop candidates and their applied corrections.
#[derive(Clone, Debug, Default)]
pub struct Loops(Vec<LoopReport>);

impl Loops {
    /// All loop candidates and their outcomes, in the order of keyframes.
    #[must_use]
    pub fn reports(&self) -> &[LoopReport] {
        &self.0
    }

    /// The reports at the end of the run.
    #[must_use]
    pub fn into_reports(self) -> Vec<LoopReport> {
        self.0
    }
}

impl Subscriber for Loops {
    fn receive(&mut self, event: &Event) {
        match event {
            Event::Looped(report) => self.0.push(report.as_ref().clone()),
            Event::Corrected { report, .. } => {
                // Corrections are applied in the order of their loops.
                let waits =
                    |l: &&mut LoopReport| l.outcome == LoopOutcome::Closed && l.applied.is_none();
                if let Some(closed) = self.0.iter_mut().find(waits) {
                    closed.applied = Some(*report);
                }
            }
            _ => {}
        }
    }
}
