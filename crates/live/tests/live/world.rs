//! A simulated walk with its frames in memory, and helpers to run and replay it.

use std::collections::{BTreeSet, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use stillpoint_detection::{
    BoundingBox, ClassId, Detection, Detector, ScriptRow, ScriptedDetector,
};
use stillpoint_geometry::Camera;
use stillpoint_imaging::{
    DepthImage, FrameId, FrameSource, GrayImage, RgbdFrame, Simd, SourceError,
};
use stillpoint_live::{Hook, Stage};
use stillpoint_simulator::{DetectionNoise, Simulator, SimulatorConfig};
use stillpoint_slam::{
    Config, Event, FrameReport, LoopOutcome, Replay, RunLog, Stages, Subscriber,
};

const FRAMES: usize = 45;

struct World {
    camera: Camera,
    frames: Vec<RgbdFrame>,
    script: Vec<ScriptRow>,
}

fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        let simulator = Simulator::new(&SimulatorConfig {
            scene: "walking_xyz".to_owned(),
            frames: Some(FRAMES),
            camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
            ..SimulatorConfig::default()
        })
        .unwrap();
        let noise = DetectionNoise {
            min_visible_px: 100,
            ..DetectionNoise::default()
        };
        let rows = (0..FRAMES).flat_map(|i| simulator.detections(i, &noise));
        let rows = rows.map(|d| ScriptRow {
            stamp: d.stamp,
            detection: Detection {
                class: ClassId::from_name(d.class).unwrap(),
                score: d.score,
                bounds: BoundingBox {
                    x0: d.x0,
                    y0: d.y0,
                    x1: d.x1,
                    y1: d.y1,
                },
            },
        });
        World {
            camera: *simulator.camera(),
            script: rows.collect(),
            frames: (0..FRAMES).map(|i| simulator.frame(i)).collect(),
        }
    })
}

pub(crate) fn frames() -> &'static [RgbdFrame] {
    &world().frames
}

/// Mapping waits at each step until tracking has taken `frames` more frames, or all; at most a minute.
pub(crate) fn mapping_falls_behind(frames: u64) -> Hook {
    let tracked = AtomicU64::new(0);
    Arc::new(move |stage| match stage {
        Stage::Tracking => {
            tracked.fetch_add(1, Ordering::Relaxed);
        }
        Stage::Mapping => {
            let goal = (tracked.load(Ordering::Relaxed) + frames).min(FRAMES as u64);
            let late = |_: &u32| tracked.load(Ordering::Relaxed) < goal;
            for _ in (0..12_000).take_while(late) {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        _ => {}
    })
}

/// The detector that plays the simulator's script.
pub(crate) fn scripted() -> Box<dyn Detector> {
    let script = world().script.clone();
    Box::new(ScriptedDetector::new("the simulator's", script).unwrap())
}

pub(crate) fn stages() -> Stages {
    stages_with(|_| {})
}

/// Stages for the world's camera, with modified settings.
pub(crate) fn stages_with(change: impl Fn(&mut Config)) -> Stages {
    let mut config = Config::default();
    config.features.features = 500;
    // Many keyframes in few frames.
    config.keyframes.min_tracked_share = 0.95;
    change(&mut config);
    Stages::new(config, world().camera, Simd::detect()).unwrap()
}

/// A walk whose lens is covered, then uncovered at an unknown place, and that returns to its start: a new submap begins, and a correction
/// joins it to the first.
pub(crate) fn there_and_back() -> (Camera, Vec<RgbdFrame>) {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "loop_two_rooms".to_owned(),
        frames: Some(230),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let seen = (0..60).step_by(2).map(Some);
    let back = (40..230).rev().step_by(2).map(Some);
    let shown = seen.chain([None; 5]).chain(back);
    let frame = |(i, shown): (usize, Option<usize>)| {
        let mut frame = simulator.frame(shown.unwrap_or_default());
        if shown.is_none() {
            let (w, h) = (frame.gray.width(), frame.gray.height());
            frame.gray = GrayImage::new(w, h);
            frame.depth = DepthImage::from_vec(w, h, vec![0.0; w * h]).unwrap();
        }
        let stamp = i as f64 / 30.0;
        frame.depth_stamp += stamp - frame.stamp;
        frame.stamp = stamp;
        frame.id = FrameId(i as u32);
        frame
    };
    let frames = shown.enumerate().map(frame).collect();
    (*simulator.camera(), frames)
}

/// A camera that is switched on among people, and off soon after it is decided which regions move.
pub(crate) fn crowd() -> (Camera, Vec<RgbdFrame>) {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "crowd_xyz".to_owned(),
        frames: Some(FRAMES),
        camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let frames = (0..FRAMES).map(|i| simulator.frame(i)).collect();
    (*simulator.camera(), frames)
}

pub(crate) fn stages_for(camera: Camera) -> Stages {
    Stages::new(Config::default(), camera, Simd::detect()).unwrap()
}

/// Stages that soon begin a new submap.
pub(crate) fn stages_for_submaps(camera: Camera) -> Stages {
    stages_for_submaps_with(camera, |_| {})
}

/// Stages that soon begin a new submap, with modified settings.
pub(crate) fn stages_for_submaps_with(camera: Camera, change: impl Fn(&mut Config)) -> Stages {
    let mut config = Config::default();
    config.tracking.new_submap_seconds = 0.33;
    change(&mut config);
    Stages::new(config, camera, Simd::detect()).unwrap()
}

pub(crate) struct Frames(pub(crate) VecDeque<RgbdFrame>);

impl Frames {
    pub(crate) fn all() -> Self {
        Self::of(frames())
    }

    pub(crate) fn of(frames: &[RgbdFrame]) -> Self {
        Self(frames.iter().cloned().collect())
    }
}

impl FrameSource for Frames {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        self.0.pop_front().map(Ok)
    }
}

/// The events of a run, by stage, with their order checked: only events of one stage are ordered.
#[derive(Debug, Default)]
pub(crate) struct Checked {
    pub(crate) reports: Vec<FrameReport>,
    tracking: Vec<String>,
    mapping: Vec<String>,
    looping: Vec<String>,
    order: Order,
}

/// References of an event have been reported before it.
#[derive(Debug, Default)]
struct Order {
    frames: BTreeSet<u32>,
    detected: BTreeSet<u32>,
    keyframes: BTreeSet<u32>,
    versions: BTreeSet<u64>,
    loops: usize,
    corrections: usize,
}

impl Order {
    /// Checks the order stated at `Event`, of a run that began without a map.
    fn check(&mut self, event: &Event) {
        match event {
            Event::Refused(_) | Event::DetectorFailed(_) => {}
            Event::Detected(d) => {
                self.detected.insert(d.frame.0);
            }
            Event::Frame(f) => {
                let version = f.report.map_version;
                assert!(
                    version == 0 || self.versions.contains(&version),
                    "{event:?}"
                );
                assert!(self.frames.insert(f.report.frame.0), "{event:?}");
                assert_eq!(f.report.frame, f.health.frame);
            }
            Event::Mapped { report, .. } => {
                assert!(self.frames.contains(&report.keyframe.0), "{event:?}");
                self.keyframes.insert(report.keyframe.0);
            }
            Event::Rejudged { report, .. } => {
                assert!(self.keyframes.contains(&report.keyframe.0), "{event:?}");
                assert!(self.detected.contains(&report.keyframe.0), "{event:?}");
            }
            Event::Revoked { report, .. } => {
                assert!(self.keyframes.contains(&report.first.0), "{event:?}");
            }
            Event::Looped(report) => {
                assert!(self.keyframes.contains(&report.keyframe.0), "{event:?}");
                self.loops += usize::from(report.outcome == LoopOutcome::Closed);
            }
            Event::Corrected { report, .. } => {
                self.corrections += 1;
                assert!(self.corrections <= self.loops, "{event:?}");
                assert!(self.versions.contains(&report.base_version), "{event:?}");
            }
        }
        if let Some(view) = event.view() {
            // Versions come in their order.
            assert!(Some(&view.version()) > self.versions.last(), "{event:?}");
            self.versions.insert(view.version());
        }
    }
}

impl Checked {
    pub(crate) fn take(&mut self, event: &Event) {
        self.order.check(event);
        let text = format!("{event:?}");
        match event {
            Event::Refused(_) => self.tracking.push(text),
            Event::Frame(frame) => {
                self.reports.push(frame.report.clone());
                self.tracking.push(text);
            }
            Event::Detected(_) | Event::DetectorFailed(_) => self.tracking.push(text),
            Event::Mapped { .. }
            | Event::Rejudged { .. }
            | Event::Revoked { .. }
            | Event::Corrected { .. } => {
                self.mapping.push(text);
            }
            Event::Looped(_) => self.looping.push(text),
        }
    }
}

impl Subscriber for Checked {
    fn receive(&mut self, event: &Event) {
        self.take(event);
    }
}

impl PartialEq for Checked {
    fn eq(&self, other: &Self) -> bool {
        self.tracking == other.tracking
            && self.mapping == other.mapping
            && self.looping == other.looping
    }
}

pub(crate) fn replay(stages: Stages, mut frames: Frames, log: RunLog) -> (Replay, Checked) {
    let mut replay = Replay::new(stages, log).unwrap();
    let mut checked = Checked::default();
    let run = replay.run(&mut frames, &mut checked);
    run.unwrap_or_else(|e| panic!("{e}"));
    (replay, checked)
}

/// Delays every thread before each of its messages, by up to `most_ms` milliseconds; by SplitMix64.
pub(crate) fn random_delays(seed: u64, most_ms: u64) -> Hook {
    let state = AtomicU64::new(seed);
    Arc::new(move |_| {
        let step = 0x9e37_79b9_7f4a_7c15;
        let mut z = state.fetch_add(step, Ordering::Relaxed).wrapping_add(step);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let micros = (z ^ (z >> 31)) % (1000 * most_ms);
        std::thread::sleep(Duration::from_micros(micros));
    })
}

/// Runs `work`; fails after minutes instead of hanging.
pub(crate) fn within<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    let (sender, receiver) = channel();
    let thread = std::thread::spawn(move || sender.send(work()));
    match receiver.recv_timeout(Duration::from_secs(120)) {
        Ok(result) => result,
        Err(_) if thread.is_finished() => match thread.join() {
            Err(panic) => std::panic::resume_unwind(panic),
            Ok(_) => unreachable!("it sends before it ends"),
        },
        Err(_) => panic!("the run hangs"),
    }
}
