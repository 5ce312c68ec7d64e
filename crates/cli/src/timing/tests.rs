use super::*;

fn spin(us: u128) {
    let start = Instant::now();
    while start.elapsed().as_micros() < us {}
}

#[test]
fn retrace_spans_do_not_count_for_the_current_frame() {
    let timing: &'static Timing = Box::leak(Box::default());
    tracing::subscriber::with_default(Recorder(timing), || {
        tracing::info_span!("frame").in_scope(|| spin(10));
        tracing::info_span!("retrace").in_scope(|| {
            tracing::info_span!("part").in_scope(|| spin(10));
        });
        timing.end_frame();
    });
    let counted = |name| !timing.per_frame(name)[0].is_nan();
    assert!(counted("frame") && counted("retrace") && !counted("part"));
}

#[test]
fn equal_spans_add_up_per_frame_and_nesting_counts_once() {
    let timing: &'static Timing = Box::leak(Box::default());
    tracing::subscriber::with_default(Recorder(timing), || {
        for frame in 0..3 {
            let _outer = tracing::info_span!("outer").entered();
            for _ in 0..2 {
                tracing::info_span!("part").in_scope(|| {
                    tracing::info_span!("part").in_scope(|| spin(1000));
                });
            }
            if frame == 0 {
                tracing::debug_span!("rare").in_scope(|| spin(10));
            }
            drop(_outer);
            timing.end_frame();
        }
    });
    let all = timing.statistics();
    let names: Vec<&str> = all.iter().map(|s| s.0).collect();
    assert_eq!(names, ["outer", "part", "rare"]);
    assert_eq!([all[0].1.n, all[1].1.n, all[2].1.n], [3, 3, 1]);
    let parts = timing.per_frame("part");
    for part in &parts {
        assert!(*part >= 2.0, "two calls of 1 ms each, found {part} ms");
    }
    for (outer, part) in timing.per_frame("outer").iter().zip(parts) {
        assert!(
            *outer >= part,
            "the inner part counted twice: {part} of {outer} ms"
        );
    }
    let rare = timing.per_frame("rare");
    assert!(rare[0] > 0.0 && rare[1].is_nan() && rare[2].is_nan());
}

#[test]
fn worker_spans_count_for_the_frame() {
    let timing: &'static Timing = Box::leak(Box::default());
    let dispatch = tracing::Dispatch::new(Recorder(timing));
    let pool = workers::Workers::new(2).unwrap();
    for _ in 0..3 {
        tracing::dispatcher::with_default(&dispatch, || {
            tracing::info_span!("whole").in_scope(|| {
                pool.run(|| {
                    tracing::dispatcher::with_default(&dispatch, || {
                        tracing::info_span!("piece").in_scope(|| spin(200));
                    });
                });
            });
        });
        // A thread that ends a round but no frame leaves the workers' times alone.
        std::thread::scope(|scope| scope.spawn(|| timing.end_round()).join().unwrap());
        timing.end_frame();
    }
    for name in ["whole", "piece"] {
        let times = timing.per_frame(name);
        assert!(
            times.len() == 3 && times.iter().all(|ms| *ms >= 0.2),
            "{name}: {times:?}"
        );
    }
}

#[test]
fn threads_are_measured_in_separate_rounds() {
    let timing: &'static Timing = Box::leak(Box::default());
    let subscriber = tracing::Dispatch::new(Recorder(timing));
    let work = |rounds: usize, is_frame: bool| {
        tracing::dispatcher::with_default(&subscriber, || {
            for _ in 0..rounds {
                tracing::info_span!("work").in_scope(|| spin(10));
                // Nothing was measured between the two.
                timing.end(is_frame);
                timing.end(is_frame);
            }
        });
    };
    std::thread::scope(|scope| {
        scope.spawn(|| work(5, false));
        work(3, true);
    });
    assert_eq!(timing.statistics()[0].1.n, 8);
    assert_eq!(timing.per_frame("work").len(), 3);
}

#[test]
fn open_span_gives_no_sample() {
    let timing: &'static Timing = Box::leak(Box::default());
    tracing::subscriber::with_default(Recorder(timing), || {
        let _open = tracing::info_span!("open").entered();
        timing.end_frame();
        assert!(timing.statistics().is_empty());
    });
    timing.end_frame();
    assert_eq!(timing.statistics().len(), 1);
}
