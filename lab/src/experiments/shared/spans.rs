//! Time in spans, by name and enclosing span.

use crate::experiments::shared::process;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::LazyLock;
use std::time::Instant;
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

/// Seconds by (name of the enclosing span, or empty; name), including nested spans.
pub(crate) type Times = BTreeMap<(&'static str, &'static str), f64>;

/// The clock of a measurement.
pub(crate) enum Spans {
    /// Wall-clock time.
    Clock,
    /// CPU time of the thread.
    Computed,
}

#[derive(Default)]
struct Running {
    names: Vec<&'static str>,
    /// Open spans, innermost last, and their start times.
    open: Vec<(&'static str, f64)>,
    times: Times,
}

thread_local! {
    static RUNNING: RefCell<Running> = RefCell::default();
}

/// The times of this thread since the last call.
pub(crate) fn take() -> Times {
    RUNNING.with_borrow_mut(|running| std::mem::take(&mut running.times))
}

impl Spans {
    /// Starts measuring, on all threads.
    ///
    /// # Errors
    /// A subscriber is already installed.
    pub(crate) fn start(self) -> Result<(), crate::Failure> {
        Ok(tracing::subscriber::set_global_default(self)?)
    }

    fn now(&self) -> f64 {
        static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
        match self {
            Self::Clock => BEGIN.elapsed().as_secs_f64(),
            Self::Computed => process::computed(),
        }
    }
}

impl Subscriber for Spans {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_span()
    }

    fn new_span(&self, attributes: &Attributes<'_>) -> Id {
        let name = attributes.metadata().name();
        RUNNING.with_borrow_mut(|running| {
            // Identified by name, since times of one name are summed anyway.
            let known = running.names.iter().position(|n| *n == name);
            let place = known.unwrap_or_else(|| {
                running.names.push(name);
                running.names.len() - 1
            });
            Id::from_u64(place as u64 + 1)
        })
    }

    fn enter(&self, span: &Id) {
        let now = self.now();
        RUNNING.with_borrow_mut(|running| {
            let name = running.names.get(span.into_u64() as usize - 1).copied();
            running.open.push((name.unwrap_or_default(), now));
        });
    }

    fn exit(&self, _: &Id) {
        let now = self.now();
        RUNNING.with_borrow_mut(|running| {
            let Some((name, begun)) = running.open.pop() else {
                return;
            };
            let around = running.open.last().map_or("", |(name, _)| *name);
            *running.times.entry((around, name)).or_default() += now - begun;
        });
    }

    fn event(&self, _: &Event<'_>) {}

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_summed_by_enclosing_span() {
        take();
        tracing::subscriber::with_default(Spans::Clock, || {
            for _ in 0..2 {
                let _frame = tracing::info_span!("frame").entered();
                let _part = tracing::info_span!("part").entered();
                std::thread::sleep(std::time::Duration::from_millis(5));
            }
            let _part = tracing::info_span!("part").entered();
        });
        let times = take();
        let keys: Vec<_> = times.keys().copied().collect();
        assert_eq!(keys, [("", "frame"), ("", "part"), ("frame", "part")]);
        assert!(times[&("frame", "part")] >= 0.01, "{times:?}");
        assert!(times[&("", "frame")] >= times[&("frame", "part")]);
        assert!(times[&("", "part")] < 0.005);
        assert!(take().is_empty());
    }
}
