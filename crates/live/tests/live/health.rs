//! A watch observes a run from outside, whatever the threads do.

use super::detection::Odd;
use super::unhurried;
use super::world::{frames, scripted, stages, within};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;
use stillpoint_live::{Hook, LiveHealth, LiveOptions, LiveSystem, Stage, ThreadState, Watch};

/// Polls until the state is as wished.
fn wait_for(watch: &Watch, wished: impl Fn(&LiveHealth) -> bool) -> LiveHealth {
    loop {
        let health = watch.health();
        if wished(&health) {
            return health;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn hanging_thread_is_visible_while_others_run() {
    within(|| {
        let hangs = Odd(0, |_| {
            loop {
                std::thread::park();
            }
        });
        let options = LiveOptions {
            detector_patience: Duration::ZERO,
            ..unhurried()
        };
        let mut live = LiveSystem::start(stages(), Some(Box::new(hangs)), options).unwrap();
        let watch = live.watch();
        let at_start = watch.health();
        assert_eq!((&at_start.health, at_start.frame_age), (&None, None));
        assert_eq!(at_start.threads.len(), 4);
        for frame in frames() {
            live.push(frame.clone());
            std::thread::sleep(Duration::from_millis(2));
        }
        let last = frames()[frames().len() - 1].id;
        // The other threads may be late on a busy machine.
        let seen = wait_for(&watch, |h| {
            let newest = h.health.as_ref().map(|h| h.frame);
            let mut troubles = h.troubles().map(|t| t.0);
            newest == Some(last)
                && troubles.next() == Some(Stage::Detection)
                && troubles.next().is_none()
        });
        let Some((_, ThreadState::NotAnswering { seconds })) = seen.troubles().next() else {
            panic!("{:?}", seen.threads);
        };
        assert!(*seconds > 1.0 && seen.frame_age.is_some());
        let health = seen.health.as_ref().unwrap();
        assert!(health.quality.value() > 0.0, "{health}");
        assert_eq!(seen.timing.map(|t| t.frame), Some(last));
        let line = seen.to_string();
        let begins = format!("{health} | latency ");
        assert!(line.starts_with(&begins), "{line}");
        assert!(line.contains(" | detection: not answering for "), "{line}");
        let _ = live.finish();
        let over = watch.health();
        let finished = |t: &&(Stage, ThreadState)| t.1 == ThreadState::Finished;
        assert_eq!(over.threads.iter().filter(finished).count(), 3);
    });
}

#[test]
fn panicked_thread_is_visible_with_its_reason() {
    within(|| {
        let calls = AtomicU32::new(0);
        let hook: Hook = Arc::new(move |stage| {
            let second = || calls.fetch_add(1, Ordering::Relaxed) == 1;
            assert!(stage != Stage::Mapping || !second(), "on purpose");
        });
        let mut options = unhurried();
        options.hook = Some(hook);
        let mut live = LiveSystem::start(stages(), None, options).unwrap();
        let watch = live.watch();
        // The first keyframe waits for the second frame.
        for frame in &frames()[..2] {
            live.push(frame.clone());
        }
        let seen = wait_for(&watch, |h| h.troubles().count() > 0);
        assert_eq!(seen.threads.len(), 3, "{:?}", seen.threads);
        let panicked = ThreadState::Panicked("on purpose".to_owned());
        let troubles: Vec<_> = seen.troubles().cloned().collect();
        assert_eq!(troubles, [(Stage::Mapping, panicked)]);
        assert!(
            seen.to_string()
                .ends_with("| mapping: panicked: on purpose")
        );
        drop(live);
    });
}

#[test]
fn healthy_run_finishes() {
    within(|| {
        let mut live = LiveSystem::start(stages(), Some(scripted()), unhurried()).unwrap();
        let watch = live.watch();
        for frame in frames() {
            live.push(frame.clone());
            let panicked = |t: &&(Stage, ThreadState)| matches!(t.1, ThreadState::Panicked(_));
            assert_eq!(watch.health().threads.iter().filter(panicked).count(), 0);
        }
        let _ = live.finish();
        let over = watch.health();
        assert!(over.threads.iter().all(|t| t.1 == ThreadState::Finished));
        let health = over.health.unwrap();
        assert_eq!(health.frame, frames()[frames().len() - 1].id);
    });
}
