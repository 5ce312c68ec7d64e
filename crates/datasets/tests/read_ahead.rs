//! Reading ahead, with a scripted source.

use crate::layouts::frame;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use stillpoint_datasets::ReadAhead;
use stillpoint_imaging::{FrameSource, RgbdFrame, SourceError};

/// Yields frames and errors by a script: `f`rame, `r`ecoverable error, `e`nd with error, `p`anic.
struct Scripted {
    script: std::vec::IntoIter<char>,
    read: Arc<AtomicUsize>,
}

impl FrameSource for Scripted {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        let i = self.read.fetch_add(1, Ordering::SeqCst) as u32;
        let error = |recoverable| {
            Some(Err(SourceError {
                message: "scripted".into(),
                recoverable,
            }))
        };
        match self.script.next()? {
            'f' => Some(Ok(frame(i, false))),
            'r' => error(true),
            'e' => error(false),
            _ => panic!("scripted panic"),
        }
    }

    fn remaining(&self) -> Option<usize> {
        Some(self.script.len())
    }
}

fn scripted(script: &str) -> (Scripted, Arc<AtomicUsize>) {
    let read = Arc::new(AtomicUsize::new(0));
    let script = script.chars().collect::<Vec<_>>().into_iter();
    (
        Scripted {
            script,
            read: read.clone(),
        },
        read,
    )
}

/// The output: `f`, `r`, or the message of the error that ends the stream.
fn drain(mut source: impl FrameSource) -> Vec<String> {
    let mut all = Vec::new();
    while let Some(item) = source.next_frame() {
        all.push(match item {
            Ok(f) => format!("f{}", f.id),
            Err(e) if e.recoverable => "r".into(),
            Err(e) => e.message,
        });
    }
    assert_eq!(source.remaining(), Some(0));
    assert!(source.next_frame().is_none());
    all
}

#[test]
fn read_ahead_forwards_everything_in_order() {
    for n in [1, 2, 8] {
        let out = |script| drain(ReadAhead::with_capacity(scripted(script).0, n));
        assert_eq!(out("ffrf"), ["f0", "f1", "r", "f3"]);
        assert_eq!(out("feff"), ["f0", "scripted"]);
        let panicked = out("ffp");
        assert_eq!(panicked[..2], ["f0", "f1"]);
        assert!(
            panicked[2].contains("panicked: scripted panic"),
            "{}",
            panicked[2]
        );
        assert!(out("").is_empty());
    }
    let source = ReadAhead::new(scripted("ffff").0);
    assert_eq!(source.remaining(), Some(4));
}

#[test]
fn read_ahead_is_bounded_and_stops_when_dropped() {
    let (source, read) = scripted(&"f".repeat(1000));
    let mut ahead = ReadAhead::with_capacity(source, 3);
    ahead.next_frame().unwrap().unwrap();
    drop(ahead);
    // One taken, three ready, one or two in progress; the rest was never read.
    let n = read.load(Ordering::SeqCst);
    assert!((1..=6).contains(&n), "{n}");
}
