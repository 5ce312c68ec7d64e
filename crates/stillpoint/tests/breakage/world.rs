//! Recordings, disturbances, and results of the system.

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::{Arc, OnceLock};
use stillpoint_datasets::{Disturbance, Disturbed};
use stillpoint_detection::{
    BoundingBox, ClassId, Detection, Detector, ScriptRow, ScriptedDetector,
};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{FrameId, FrameSource, RgbdFrame, Simd, SourceError};
use stillpoint_map::{MapView, SubmapId};
use stillpoint_simulator::{DetectionNoise, Simulator, SimulatorConfig};
use stillpoint_slam::{Config, Event, FrameReport, LostReason, Outcome, RefusedFrame, System};
use stillpoint_testdata::ate::{self, Figures};

/// A recording rendered once for several runs.
pub(crate) struct Recording {
    pub(crate) camera: Camera,
    pub(crate) frames: Vec<RgbdFrame>,
    truth: Vec<Se3>,
    script: Vec<ScriptRow>,
}

pub(crate) fn small(focal: f64) -> Camera {
    Camera::pinhole(320, 240, [focal, focal, 159.5, 119.5])
}

pub(crate) fn simulator(scene: &str, camera: Camera) -> Simulator {
    Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        frames: Some(600),
        camera,
        ..SimulatorConfig::default()
    })
    .unwrap()
}

impl Recording {
    /// The frames `range` of a scene, with detections.
    pub(crate) fn new(scene: &str, range: Range<usize>, camera: Camera) -> Self {
        Self::of(scene, range.collect(), camera)
    }

    /// Likewise with the given frames of a scene, in this order.
    fn of(scene: &str, shown: Vec<usize>, camera: Camera) -> Self {
        let simulator = simulator(scene, camera);
        let noise = DetectionNoise {
            min_visible_px: 100,
            drop: 0.1,
            ..DetectionNoise::default()
        };
        let rows = shown
            .iter()
            .flat_map(|i| simulator.detections(*i, &noise))
            .map(|d| ScriptRow {
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
        let truth = simulator.ground_truth();
        Self {
            camera,
            script: rows.collect(),
            truth: shown.iter().map(|i| truth[*i].1).collect(),
            frames: shown
                .iter()
                .enumerate()
                .map(|(k, i)| RgbdFrame {
                    id: FrameId(k as u32),
                    ..simulator.frame(*i)
                })
                .collect(),
        }
    }

    pub(crate) fn detector(&self) -> Box<dyn Detector> {
        Box::new(ScriptedDetector::new("the simulator's", self.script.clone()).unwrap())
    }

    pub(crate) fn play(&self, range: Range<usize>) -> Vec<RgbdFrame> {
        self.frames[range].to_vec()
    }

    pub(crate) fn disturbed(&self, range: Range<usize>, what: Disturbance) -> Vec<RgbdFrame> {
        let ids = range.start as u32..range.end as u32;
        let source = Frames::of(self.play(range));
        let mut source = Disturbed::new(source, vec![(ids, what)]).unwrap();
        let frames = std::iter::from_fn(|| source.next_frame());
        frames.map(Result::unwrap).collect()
    }

    /// Position error of a pose relative to the true one of frame `of`, m. The map begins at frame 0.
    pub(crate) fn off(&self, of: usize, pose: &Se3) -> f64 {
        let real = self.truth[0].inverse() * self.truth[of];
        (pose.translation - real.translation).norm()
    }
}

/// A hand-held camera in a room.
pub(crate) fn room() -> &'static Recording {
    static ROOM: OnceLock<Recording> = OnceLock::new();
    ROOM.get_or_init(|| Recording::new("xyz", 0..130, small(267.5)))
}

/// A camera carried through two rooms: 75 frames, and 40 taken 3 s later.
pub(crate) fn walk() -> &'static Recording {
    static WALK: OnceLock<Recording> = OnceLock::new();
    WALK.get_or_init(|| {
        let shown = (0..75).chain(160..200).collect();
        Recording::of("loop_two_rooms", shown, small(267.5))
    })
}

/// The digest of an undisturbed run; also checks its errors, as the reference for the other runs.
#[track_caller]
pub(crate) fn undisturbed(what: &str, recording: &Recording) -> u64 {
    let mut session = Session::new(recording, config());
    let reports = session.feed(recording.frames.clone());
    assert!(losses(&reports).is_empty());
    session.hold(what, recording, &reports);
    session.digest()
}

pub(crate) struct Frames(pub(crate) VecDeque<Result<RgbdFrame, SourceError>>);

impl Frames {
    pub(crate) fn of(frames: Vec<RgbdFrame>) -> Self {
        Self(frames.into_iter().map(Ok).collect())
    }
}

impl FrameSource for Frames {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        self.0.pop_front()
    }
}

/// Few features, for small images.
pub(crate) fn config() -> Config {
    let mut config = Config::default();
    config.features.features = 500;
    config
}

pub(crate) struct Session {
    pub(crate) system: System,
    pub(crate) events: Vec<Event>,
    /// Frame of the recording shown by each frame, and the last stamp.
    shows: BTreeMap<FrameId, usize>,
    stamp: f64,
}

impl Session {
    pub(crate) fn new(recording: &Recording, config: Config) -> Self {
        Self {
            system: System::new(config, recording.camera, Simd::detect()).unwrap(),
            events: Vec::new(),
            shows: BTreeMap::new(),
            stamp: 0.0,
        }
    }

    pub(crate) fn with_detector(mut self, detector: Box<dyn Detector>) -> Self {
        self.system = self.system.with_detector(detector);
        self
    }

    /// Feeds frames; returns the reports of those processed.
    pub(crate) fn feed(&mut self, frames: Vec<RgbdFrame>) -> Vec<FrameReport> {
        let before = self.events.len();
        for frame in frames {
            self.stamp = frame.stamp;
            self.shows.entry(frame.id).or_insert(frame.id.0 as usize);
            self.events.extend(self.system.step(frame));
        }
        reports(&self.events[before..])
    }

    /// Feeds frames in any order as successors of the last one, `gap` seconds later than usual.
    pub(crate) fn go_on(&mut self, frames: Vec<RgbdFrame>, gap: f64) -> Vec<FrameReport> {
        let next = self.shows.last_key_value().map_or(0, |(id, _)| id.0 + 1);
        let (mut id, mut stamp) = (next, self.stamp + gap);
        let mut renumbered = Vec::new();
        for mut frame in frames {
            stamp += 1.0 / 30.0;
            self.shows.insert(FrameId(id), frame.id.0 as usize);
            frame.depth_stamp += stamp - frame.stamp;
            (frame.id, frame.stamp) = (FrameId(id), stamp);
            renumbered.push(frame);
            id += 1;
        }
        self.feed(renumbered)
    }

    /// The maximum error of a reported pose in the first submap, m.
    pub(crate) fn worst(&self, recording: &Recording, reports: &[FrameReport]) -> f64 {
        let off = |r: &FrameReport| {
            let pose = r
                .world_from_camera
                .filter(|_| r.submap == Some(SubmapId(0)))?;
            Some(recording.off(self.shows[&r.frame], &pose))
        };
        reports.iter().filter_map(off).fold(0.0, f64::max)
    }

    /// Compares the maximum error of these frames, and the number of poses in the first submap, with the table of
    /// errors.
    #[track_caller]
    pub(crate) fn hold(&self, what: &str, recording: &Recording, reports: &[FrameReport]) {
        let found = Figures {
            error_mm: 1e3 * self.worst(recording, reports),
            frames: reports.len(),
            posed: at_home(reports),
        };
        println!("{what}: {found:?}");
        let sequence = format!("sim:small {what}: largest error");
        ate::hold(&sequence, "none", "default", found);
    }

    pub(crate) fn reports(&self) -> Vec<FrameReport> {
        reports(&self.events)
    }

    pub(crate) fn refused(&self) -> Vec<RefusedFrame> {
        let refused = |e: &Event| match e {
            Event::Refused(refused) => Some(*refused),
            _ => None,
        };
        self.events.iter().filter_map(refused).collect()
    }

    /// A hash, equal for runs that are equal bit for bit.
    pub(crate) fn digest(&self) -> u64 {
        self.system.trajectory().digest(&self.system.view())
    }

    pub(crate) fn view(&self) -> Arc<MapView> {
        self.system.view()
    }
}

pub(crate) fn reports(events: &[Event]) -> Vec<FrameReport> {
    let report = |e: &Event| match e {
        Event::Frame(frame) => Some(frame.report.clone()),
        _ => None,
    };
    events.iter().filter_map(report).collect()
}

/// Loss reason of each frame without a pose.
pub(crate) fn losses(reports: &[FrameReport]) -> Vec<LostReason> {
    let loss = |r: &FrameReport| match r.outcome {
        Outcome::Lost { reason, .. } => Some(reason),
        _ => None,
    };
    reports.iter().filter_map(loss).collect()
}

/// Number of frames with a pose in the first submap.
pub(crate) fn at_home(reports: &[FrameReport]) -> usize {
    let home = |r: &&FrameReport| r.submap == Some(SubmapId(0));
    reports.iter().filter(home).count()
}

/// Number of frames until the next pose; all of them if there is none.
pub(crate) fn until_pose(reports: &[FrameReport]) -> usize {
    let found = reports.iter().position(|r| r.world_from_camera.is_some());
    found.unwrap_or(reports.len())
}

/// The old map is preserved: all keyframes, live or as tombstones, and the usual number of landmarks that two of them
/// observe, some replaced by better ones.
pub(crate) fn assert_kept(before: &MapView, after: &MapView) {
    for k in before.keyframes() {
        assert!(after.world_from_keyframe(k.id).is_some(), "{}", k.id);
    }
    let there = |(id, _): &(_, _)| after.resolve_landmark(*id).is_some();
    let (all, kept) = (
        before.landmark_count(),
        before.landmarks().filter(there).count(),
    );
    let share = kept as f64 / all.max(1) as f64;
    let confirmed = |view: &MapView| view.landmarks().filter(|(_, l)| l.observers > 1).count();
    let [then, now] = [before, after].map(confirmed);
    println!(
        "{kept} of {all} landmarks are kept ({share:.2}), of {} now; of {then} confirmed ones {now}",
        after.landmark_count()
    );
    assert!(all > 100 && share > 0.4 && now >= then * 9 / 10);
}

/// The result of `work`. Fails after two minutes instead of hanging.
pub(crate) fn within<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    let (sender, receiver) = std::sync::mpsc::channel();
    let thread = std::thread::spawn(move || sender.send(work()));
    match receiver.recv_timeout(std::time::Duration::from_secs(120)) {
        Ok(result) => result,
        Err(_) if thread.is_finished() => match thread.join() {
            Err(panic) => std::panic::resume_unwind(panic),
            Ok(_) => unreachable!("it sends before it ends"),
        },
        Err(_) => panic!("the run hangs"),
    }
}
