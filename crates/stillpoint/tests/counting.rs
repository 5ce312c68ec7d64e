//! Counts allocations per thread and tracing span.
//!
//! A binary that includes this file gets its allocator. Counts are per thread.
// Required to implement an allocator; all calls are forwarded to the system's.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

/// The system's allocator with a count of allocations.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

thread_local! {
    /// Calls and bytes requested by this thread.
    static ASKED: Cell<(u64, u64)> = const { Cell::new((0, 0)) };
    static RUNNING: RefCell<Running> = RefCell::default();
}

fn note(bytes: usize) {
    // The count of an ending thread may be gone.
    let _ = ASKED.try_with(|asked| {
        let (calls, sum) = asked.get();
        asked.set((calls + 1, sum + bytes as u64));
    });
}

// SAFETY: every call is forwarded unchanged; counting touches no memory of the allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size);
        unsafe { System.realloc(memory, layout, size) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Asked {
    pub(crate) calls: u64,
    pub(crate) bytes: u64,
}

#[derive(Default)]
struct Running {
    names: Vec<&'static str>,
    /// Open spans: index of the name, and the counts before and in inner spans.
    open: Vec<(usize, Asked, Asked)>,
    own: BTreeMap<&'static str, Asked>,
}

fn asked() -> Asked {
    ASKED.with(|a| Asked {
        calls: a.get().0,
        bytes: a.get().1,
    })
}

/// Allocations of this thread's spans since the last call, by name, excluding inner spans.
pub(crate) fn take() -> BTreeMap<&'static str, Asked> {
    RUNNING.with_borrow_mut(|running| std::mem::take(&mut running.own))
}

/// A thread-local subscriber that counts within the span `frame`.
pub(crate) struct Spans;

impl Subscriber for Spans {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_span()
    }

    fn new_span(&self, span: &Attributes<'_>) -> Id {
        let before = ASKED.get();
        let name = span.metadata().name();
        let place = RUNNING.with_borrow_mut(|running| {
            let known = running.names.iter().position(|n| *n == name);
            known.unwrap_or_else(|| {
                running.names.push(name);
                running.names.len() - 1
            })
        });
        ASKED.set(before);
        Id::from_u64(place as u64 + 1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, _: &Event<'_>) {}

    fn enter(&self, span: &Id) {
        let before = ASKED.get();
        let place = (span.into_u64() - 1) as usize;
        RUNNING.with_borrow_mut(|r| r.open.push((place, asked(), Asked::default())));
        ASKED.set(before);
    }

    fn exit(&self, _: &Id) {
        let before = ASKED.get();
        RUNNING.with_borrow_mut(|running| {
            let Some((place, begun, within)) = running.open.pop() else {
                return;
            };
            let whole = Asked {
                calls: before.0 - begun.calls,
                bytes: before.1 - begun.bytes,
            };
            let name = running.names[place];
            let in_frame = |(p, ..): &(usize, Asked, Asked)| running.names[*p] == "frame";
            if name == "frame" || running.open.iter().any(in_frame) {
                let own = running.own.entry(name).or_default();
                own.calls += whole.calls - within.calls;
                own.bytes += whole.bytes - within.bytes;
            }
            if let Some((_, _, within)) = running.open.last_mut() {
                within.calls += whole.calls;
                within.bytes += whole.bytes;
            }
        });
        ASKED.set(before);
    }
}
