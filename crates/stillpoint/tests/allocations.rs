//! Tracking allocates nothing in steady state, except for the data of frame reports.

use crate::counting::{self, Asked, Spans};
use stillpoint::imaging::{RgbdFrame, Simd};
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, System};

/// Allocations per report: feature verdicts and labels of moving regions.
const HANDED_OVER: u64 = 2;
/// Frames until the depth history, 3.2 s, is full and its memory is reused.
const STEADY: usize = 110;

/// Allocations per frame that makes no keyframe, after `STEADY` frames. A few rendered frames are played back and
/// forth.
fn steady_frames(config: Config) -> Vec<u64> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "walking_xyz".to_owned(),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let rendered: Vec<RgbdFrame> = (0..20).map(|i| simulator.frame(i)).collect();
    let way = (0..20).chain((1..19).rev()).cycle();
    let mut system = System::new(config, *simulator.camera(), Simd::detect()).unwrap();
    let mut counts = Vec::new();
    for (i, shown) in way.take(STEADY + 60).enumerate() {
        let mut frame = rendered[shown].clone();
        frame.id.0 = i as u32;
        (frame.stamp, frame.depth_stamp) = (i as f64 / 30.0, i as f64 / 30.0);
        counting::take();
        let events = tracing::subscriber::with_default(Spans, || system.step(frame));
        let calls = counting::take().values().map(|a: &Asked| a.calls).sum();
        let mapped = events.iter().any(|e| matches!(e, Event::Mapped { .. }));
        let tracked = |e: &Event| match e {
            Event::Frame(f) => f.report.world_from_camera.is_some(),
            _ => false,
        };
        assert!(events.iter().any(tracked), "frame {i}");
        if i >= STEADY && !mapped {
            counts.push(calls);
        }
    }
    counts
}

#[test]
fn non_keyframes_allocate_only_their_report() {
    let counts = steady_frames(Config::default());
    assert!(counts.len() > 40, "{counts:?}");
    let mut sorted = counts.clone();
    sorted.sort_unstable();
    assert_eq!(sorted[0], HANDED_OVER, "{counts:?}");
    assert_eq!(sorted[counts.len() / 2], HANDED_OVER, "{counts:?}");
    // Lists grow, by doubling, when a frame contains more than any before.
    let grown: u64 = counts.iter().map(|c| c - HANDED_OVER).sum();
    assert!(grown <= counts.len() as u64, "{counts:?}");
}

/// Control: allocations within a frame's span are counted, others and those of other threads are not.
#[test]
fn allocations_within_a_frame_span_are_counted() {
    let count = |work: &dyn Fn()| {
        counting::take();
        tracing::subscriber::with_default(Spans, || {
            let _outside = Vec::<u8>::with_capacity(10);
            let _frame = tracing::info_span!("frame").entered();
            let _part = tracing::info_span!("part").entered();
            work();
        });
        counting::take()
    };
    let three = count(&|| drop([vec![1_u8; 10], vec![2; 20], vec![3; 30]]));
    let (calls, bytes) = (3, 60);
    assert_eq!(three["part"], Asked { calls, bytes });
    assert_eq!(three["frame"], Asked::default());
    let large = 1 << 20;
    let by_others = count(&|| {
        let other = std::thread::spawn(move || vec![1_u8; large].len());
        assert_eq!(other.join().unwrap(), large);
    });
    assert!(by_others["part"].bytes < large as u64);
}
