//! Time of each stage, from its spans.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

/// Seconds that this process has computed, or that have passed where the system does not tell.
pub(crate) fn computed() -> f64 {
    static BEGIN: Mutex<Option<Instant>> = Mutex::new(None);
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let ns = text
        .split_whitespace()
        .next()
        .and_then(|w| w.parse::<f64>().ok());
    ns.map(|ns| 1e-9 * ns).unwrap_or_else(|| {
        let mut begin = BEGIN.lock().unwrap_or_else(PoisonError::into_inner);
        begin
            .get_or_insert_with(Instant::now)
            .elapsed()
            .as_secs_f64()
    })
}

#[derive(Default)]
struct Table {
    names: Vec<&'static str>,
    open: Vec<(u64, f64)>,
    seconds: BTreeMap<&'static str, f64>,
}

static TABLE: Mutex<Option<Table>> = Mutex::new(None);

fn with<T>(f: impl FnOnce(&mut Table) -> T) -> T {
    let mut table = TABLE.lock().unwrap_or_else(PoisonError::into_inner);
    f(table.get_or_insert_default())
}

/// What was measured since it was asked for last, by the spans' names.
pub(crate) fn take() -> BTreeMap<&'static str, f64> {
    with(|t| std::mem::take(&mut t.seconds))
}

/// Feeds the table. One thread works here.
pub(crate) struct Stages;

impl Subscriber for Stages {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_span()
    }

    fn new_span(&self, attributes: &Attributes<'_>) -> Id {
        let name = attributes.metadata().name();
        let known = with(|t| {
            let at = t.names.iter().position(|n| *n == name);
            at.unwrap_or_else(|| {
                t.names.push(name);
                t.names.len() - 1
            })
        });
        Id::from_u64(known as u64 + 1)
    }

    fn enter(&self, span: &Id) {
        let now = computed();
        with(|t| t.open.push((span.into_u64(), now)));
    }

    fn exit(&self, span: &Id) {
        let now = computed();
        with(|t| {
            let Some((id, entered)) = t.open.pop() else {
                return;
            };
            debug_assert_eq!(id, span.into_u64());
            let name = t.names[id as usize - 1];
            *t.seconds.entry(name).or_default() += now - entered;
        });
    }

    fn event(&self, _: &Event<'_>) {}

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}
}
