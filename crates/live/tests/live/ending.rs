//! How runs end: panics, early stops, dropped runs.

use super::*;

#[test]
fn other_stages_finish_when_one_panics() {
    for stage in [Stage::Tracking, Stage::Mapping, Stage::Looping] {
        let calls = AtomicU32::new(0);
        let hook: Hook = Arc::new(move |s| {
            let third = || calls.fetch_add(1, Ordering::Relaxed) == 2;
            assert!(s != stage || !third(), "on purpose");
        });
        let options = LiveOptions {
            hook: Some(hook),
            ..unhurried()
        };
        let (result, received) = run(Some(scripted()), options, 2);
        let failures: Vec<_> = result.ended.failures().collect();
        let end = WorkerEnd::Panicked("on purpose".to_owned());
        assert_eq!(failures, [(stage, &end)]);
        let expected = if stage == Stage::Tracking {
            2
        } else {
            frames().len()
        };
        assert_eq!(result.statistics.frames.len(), expected);
        assert!(result.map.as_ref().is_some_and(|m| m.check().is_ok()));
        assert!(result.view.keyframe_count() > 0);
        assert_reproduced(&result, &received);
    }
}

#[test]
fn stopping_early_keeps_map_and_trajectory() {
    let (result, received, played) = within(|| {
        let mut live = LiveSystem::start(stages(), Some(scripted()), unhurried()).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let received = live.subscribe("test", Delivery::until_full(1000), Received::default());
        let (mut frames, stops) = (0, Arc::clone(&stop));
        let tenth = OnEvent(move |event: &Event| {
            frames += u32::from(event.as_frame().is_some());
            stops.store(frames >= 10, Ordering::Relaxed);
        });
        let tenth = live.subscribe("tenth", Delivery::until_full(1000), tenth);
        let mut source = Frames::all();
        let played = live.play(&mut source, &stop, |e| panic!("{e}"));
        let result = live.finish();
        assert!(tenth.unwrap().join().is_ok());
        (result, received.unwrap().join().unwrap(), played)
    });
    assert!(matches!(played, Played::Stopped), "{played:?}");
    assert_all_finished(&result);
    let tracked = result.trajectory.entries().len();
    assert!((10..frames().len()).contains(&tracked), "{tracked}");
    assert!(result.view.landmark_count() > 100);
    assert_reproduced(&result, &received);
}

#[test]
fn dropped_run_ends_its_threads() {
    within(|| {
        let alive = Arc::new(());
        let witness = Arc::clone(&alive);
        let hook: Hook = Arc::new(move |_| {
            let _ = &witness;
        });
        let options = LiveOptions {
            hook: Some(hook),
            ..unhurried()
        };
        let mut live = LiveSystem::start(stages(), Some(scripted()), options).unwrap();
        live.push(frames()[0].clone());
        drop(live);
        // Every thread holds the hook until it ends.
        while Arc::strong_count(&alive) > 1 {
            std::thread::sleep(Duration::from_millis(1));
        }
    });
}
