//! Lost cameras: relocalisation, new submaps, and joining of submaps.

#![allow(clippy::print_stdout)] // Measurements are printed.

mod health;
mod real;

use std::cell::RefCell;
use std::collections::BTreeMap;
use stillpoint_evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint_geometry::Se3;
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame, Simd};
use stillpoint_map::SubmapId;
use stillpoint_simulator::{Simulator, SimulatorConfig};
use stillpoint_slam::{
    Config, Event, FrameReport, LoopOutcome, LoopReport, MapUse, Outcome, System, join_maps,
};
use stillpoint_testdata::ate::{self, Figures};

const PERIOD: f64 = 1.0 / 30.0;

/// A simulation with cached frames, since rendering is slower than tracking.
struct Room {
    simulator: Simulator,
    rendered: RefCell<BTreeMap<usize, RgbdFrame>>,
}

impl std::ops::Deref for Room {
    type Target = Simulator;

    fn deref(&self) -> &Simulator {
        &self.simulator
    }
}

impl Room {
    fn frame(&self, index: usize) -> RgbdFrame {
        let mut rendered = self.rendered.borrow_mut();
        let frame = rendered.entry(index);
        frame.or_insert_with(|| self.simulator.frame(index)).clone()
    }
}

fn simulator(scene: &str, frames: usize) -> Room {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: scene.into(),
        frames: Some(frames),
        ..SimulatorConfig::default()
    });
    Room {
        simulator: simulator.unwrap(),
        rendered: RefCell::default(),
    }
}

/// A sequence of simulated frames in any order, and of frames with a covered lens.
#[derive(Clone)]
struct Play(Vec<Option<usize>>);

impl Play {
    fn frames(frames: impl IntoIterator<Item = usize>) -> Self {
        Self(frames.into_iter().map(Some).collect())
    }

    fn covered(mut self, frames: usize) -> Self {
        self.0.extend(vec![None; frames]);
        self
    }

    fn then(mut self, frames: impl IntoIterator<Item = usize>) -> Self {
        self.0.extend(frames.into_iter().map(Some));
        self
    }
}

struct Run {
    system: System,
    reports: Vec<FrameReport>,
}

fn go_on(mut system: System, simulator: &Room, play: &Play) -> Run {
    let first = simulator.frame(0);
    let (w, h) = (first.gray.width(), first.gray.height());
    let dark = RgbdFrame {
        gray: GrayImage::new(w, h),
        colour: None,
        depth: DepthImage::from_vec(w, h, vec![0.0; w * h]).unwrap(),
        ..first
    };
    let mut reports = Vec::new();
    for (i, shown) in play.0.iter().enumerate() {
        let stamp = i as f64 * PERIOD;
        let mut frame = match shown {
            Some(k) => simulator.frame(*k),
            None => dark.clone(),
        };
        frame.depth_stamp += stamp - frame.stamp;
        frame.stamp = stamp;
        frame.id = FrameId(i as u32);
        for event in system.step(frame) {
            if let Event::Frame(frame) = event {
                reports.push(frame.report.clone());
            }
        }
    }
    system.finish();
    Run { system, reports }
}

fn run(simulator: &Room, config: &Config, play: &Play) -> Run {
    let system = System::new(config.clone(), *simulator.camera(), Simd::detect()).unwrap();
    go_on(system, simulator, play)
}

impl Run {
    /// Final poses of one submap, with the truth.
    fn poses(&self, simulator: &Simulator, play: &Play, submap: SubmapId) -> [Vec<TimedPose>; 2] {
        let view = self.system.view();
        let truth = simulator.ground_truth();
        let (mut estimate, mut real) = (Vec::new(), Vec::new());
        for (entry, pose) in self.system.trajectory().resolve(&view) {
            let Some(k) = play.0[entry.frame.0 as usize] else {
                continue;
            };
            if view.submap_of(entry.pose.reference) != Some(submap) {
                continue;
            }
            let at = |world_from_camera| TimedPose {
                stamp: entry.stamp,
                world_from_camera,
            };
            estimate.push(at(pose));
            real.push(at(truth[k].1));
        }
        [estimate, real]
    }

    fn ate_mm(&self, simulator: &Simulator, play: &Play, submap: SubmapId) -> f64 {
        let [estimate, real] = self.poses(simulator, play, submap);
        let score = evaluate(&real, &estimate, &EvalOptions::default()).unwrap();
        score.ate.statistics.rmse * 1e3
    }

    /// Compares the ATE of the first submap with the table of errors. Frames of a covered lens are not counted.
    #[track_caller]
    fn hold(&self, sequence: &str, simulator: &Simulator, play: &Play) {
        let found = Figures {
            error_mm: self.ate_mm(simulator, play, SubmapId(0)),
            frames: play.0.iter().flatten().count(),
            posed: self.poses(simulator, play, SubmapId(0))[0].len(),
        };
        println!("{sequence}: {found:?}");
        ate::hold(sequence, "none", "default", found);
    }

    fn tell(&self) {
        let mut last = String::new();
        for r in &self.reports {
            let state = match r.outcome {
                Outcome::Lost { reason, .. } => format!("lost: {reason}"),
                Outcome::Relocalised { since, with } => format!("found, since {since} with {with}"),
                Outcome::Initialised => "begins".into(),
                Outcome::Carried { since } => format!("carried since {since}"),
                Outcome::Tracked => format!("tracked in {:?}", r.submap),
            };
            if state != last {
                println!("{}: {state} ({:?})", r.frame, r.counts.inliers);
            }
            last = state;
        }
        println!("submaps {:?}", self.system.view().submaps());
        for l in self.system.loops() {
            println!("{l:?}");
        }
    }
}

#[test]
fn returning_camera_relocalises_at_once() {
    let simulator = simulator("loop_two_rooms", 200);
    // Every other frame: 1.8 m/s.
    let play = Play::frames((0..200).step_by(2)).covered(30).then(20..40);
    let run = run(&simulator, &Config::default(), &play);
    run.tell();
    assert!(matches!(run.reports[129].outcome, Outcome::Lost { since, .. } if since.0 == 100));
    let found = &run.reports[130];
    let Outcome::Relocalised { since, with } = found.outcome else {
        panic!("{:?}", found.outcome);
    };
    // Relocalised by place recognition: neither at the last keyframe nor near it.
    assert!(since.0 == 100 && with.0 < 30, "{with}");
    assert_eq!(found.submap, Some(SubmapId(0)));
    let lost = |r: &&FrameReport| matches!(r.outcome, Outcome::Lost { .. });
    assert_eq!(run.reports.iter().filter(lost).count(), 30);
    run.hold("sim:loop_two_rooms covered and back", &simulator, &play);
}

/// Two rooms with equal furniture: no loop is closed between them, and a camera that is blind for a moment, at the
/// worst place, gets lost rather than relocalised in the other room.
#[test]
fn identical_rooms_are_not_confused() {
    let simulator = simulator("equal_rooms", 824);
    let play = Play::frames((0..780).step_by(4))
        .covered(3)
        .then((780..824).step_by(4));
    let run = run(&simulator, &Config::default(), &play);
    run.tell();
    let closed = |l: &&LoopReport| l.outcome == LoopOutcome::Closed;
    assert_eq!(run.system.loops().iter().filter(closed).count(), 0);
    assert!(
        run.system
            .loops()
            .iter()
            .any(|l| l.outcome == LoopOutcome::Elsewhere)
    );
    assert_eq!(run.system.view().submaps().len(), 1);
    let [poses, real] = run.poses(&simulator, &play, SubmapId(0));
    assert!(poses.len() >= 195, "{}", poses.len());
    let begin = real[0].world_from_camera;
    for (pose, real) in poses.iter().zip(&real) {
        let real = begin.inverse() * real.world_from_camera;
        let off = (pose.world_from_camera.translation - real.translation).norm();
        assert!(off < 0.5, "{off} m at {}", pose.stamp);
    }
}

#[test]
fn new_submap_is_joined_on_return() {
    let simulator = simulator("loop_two_rooms", 230);
    // The lens is covered, uncovered in an unknown place, and the camera returns.
    let covered = Play::frames((0..60).step_by(2)).covered(5);
    let play = covered.clone().then((40..230).rev().step_by(2));
    let mut config = Config::default();
    config.tracking.new_submap_seconds = 0.33;
    let run = run(&simulator, &config, &play);
    run.tell();
    let begun = |r: &&FrameReport| r.outcome == Outcome::Initialised;
    assert_eq!(run.reports.iter().filter(begun).count(), 2);
    let joined: Vec<_> = run.system.loops().iter().filter_map(|l| l.joined).collect();
    assert_eq!(joined.len(), 1);
    assert_eq!(run.system.view().submaps().len(), 1);
    run.hold("sim:loop_two_rooms in two submaps", &simulator, &play);
    let again = self::run(&simulator, &config, &play);
    let bits = |run: &Run| format!("{:?}", run.poses(&simulator, &play, SubmapId(0)));
    assert!(bits(&run) == bits(&again), "two runs differ");
    // Control: without the return there are two submaps with unknown relative pose.
    let play = covered.then((190..230).rev().step_by(2));
    let apart = self::run(&simulator, &config, &play);
    assert_eq!(apart.system.view().submaps().len(), 2);
    assert_eq!(apart.reports[54].submap, Some(SubmapId(44)));
}

#[test]
fn localize_mode_gives_poses_without_growing_the_map() {
    let simulator = simulator("xyz", 120);
    let made = run(&simulator, &Config::default(), &Play::frames(0..80));
    let bytes = made.system.map().to_bytes(&[]).unwrap();
    let play = Play::frames(60..120);
    let localize = |map| {
        let system = System::new(Config::default(), *simulator.camera(), Simd::detect()).unwrap();
        let system = system.with_map(map, MapUse::Localize).unwrap();
        go_on(system, &simulator, &play)
    };
    let bits = |run: &Run| {
        let poses = run.reports.iter().map(|r| r.world_from_camera);
        format!("{:?}", poses.collect::<Vec<_>>())
    };
    let loaded = localize(stillpoint_map::Map::from_bytes(&bytes).unwrap());
    loaded.tell();
    let lost = |r: &&FrameReport| matches!(r.outcome, Outcome::Lost { .. });
    assert_eq!(loaded.reports.iter().filter(lost).count(), 0);
    assert!(loaded.reports.iter().all(|r| !r.is_keyframe));
    // In the map's frame of reference, without alignment.
    let truth = simulator.ground_truth();
    let worst = loaded.reports.iter().zip(60..).map(|(r, k): (_, usize)| {
        let pose: Se3 = truth[0].1.inverse() * truth[k].1;
        (r.world_from_camera.unwrap().translation - pose.translation).norm()
    });
    let found = Figures::all_posed(1e3 * worst.fold(0.0, f64::max), 60);
    let sequence = "sim:xyz 60 frames in a map: largest error";
    ate::hold(sequence, "none", "default", found);
    // A map that was never saved gives the same poses.
    let kept = localize(made.system.into_map());
    assert!(bits(&loaded) == bits(&kept), "saving changed the poses");
    // The map is unchanged except for its version.
    assert_eq!(
        kept.system.view().keyframe_count(),
        loaded.system.view().keyframe_count()
    );
}

#[test]
fn saved_map_is_resumed() {
    let simulator = simulator("loop_two_rooms", 140);
    let made = run(&simulator, &Config::default(), &Play::frames(0..60));
    let keyframes = made.system.view().keyframe_count();
    let next = made.system.view().keyframe_bound() as u32;
    let play = Play::frames((40..140).step_by(2));
    let system = System::new(Config::default(), *simulator.camera(), Simd::detect()).unwrap();
    let system = system
        .with_map(made.system.into_map(), MapUse::Grow)
        .unwrap();
    let run = go_on(system, &simulator, &play);
    run.tell();
    assert!(matches!(
        run.reports[0].outcome,
        Outcome::Relocalised { .. }
    ));
    assert!(run.reports.iter().any(|r| r.is_keyframe));
    let view = run.system.view();
    assert!(view.keyframe_count() > keyframes);
    assert!(view.keyframes().any(|k| k.id.0 >= next));
    assert_eq!(view.submaps().len(), 1);
    run.hold("sim:loop_two_rooms resumed", &simulator, &play);
}

/// Slow: a map reaches 50 keyframes only after some hundred frames, and there is a run without the limit too.
#[test]
fn map_with_a_keyframe_limit_stays_accurate() {
    let simulator = simulator("loop_two_rooms", 420);
    let play = Play::frames((0..420).step_by(3)).then((0..420).rev().step_by(3));
    let walk = |max_keyframes: usize| {
        let mut config = Config::default();
        config.mapping.max_keyframes = max_keyframes;
        // Without culling of redundant keyframes, and with small view angles, the limit is reached.
        config.mapping.redundant_share = 1.0;
        config.keyframes.max_view_angle = 0.05;
        run(&simulator, &config, &play)
    };
    let (free, bound) = (walk(0), walk(50));
    let view = bound.system.view();
    assert!(
        free.system.view().keyframe_count() > 60,
        "{}",
        free.system.view().keyframe_count()
    );
    assert!(view.keyframe_count() <= 50, "{}", view.keyframe_count());
    assert_eq!(bound.system.map().check(), Ok(()));
    let lost = |r: &&FrameReport| matches!(r.outcome, Outcome::Lost { .. });
    assert_eq!(bound.reports.iter().filter(lost).count(), 0);
    // Every frame has a pose, also those of culled keyframes.
    let [poses, _] = bound.poses(&simulator, &play, SubmapId(0));
    assert_eq!(poses.len(), play.0.len());
    for (run, what) in [(&free, "no limit"), (&bound, "50 keyframes")] {
        let sequence = format!("sim:loop_two_rooms there and back with {what}");
        run.hold(&sequence, &simulator, &play);
    }
    let [free, bound] = [&free, &bound].map(|r| r.ate_mm(&simulator, &play, SubmapId(0)));
    assert!(bound < free + 10.0, "{bound} mm, without a limit {free} mm");
}

#[test]
fn overlapping_maps_are_joined() {
    let simulator = simulator("loop_two_rooms", 130);
    let map = |frames: std::ops::Range<usize>| {
        let play = Play::frames(frames.step_by(2));
        run(&simulator, &Config::default(), &play).system.into_map()
    };
    let (first, second) = (map(0..70), map(20..130));
    let count = first.view().keyframe_count() + second.view().keyframe_count();
    let added = first.view().keyframe_bound() as u32;
    let joined = join_maps(&Config::default(), first, &second).unwrap();
    assert_eq!(joined.submaps, [2, 1]);
    assert_eq!(joined.map.check(), Ok(()));
    let view = joined.map.view();
    assert_eq!(view.keyframe_count(), count);
    // All in the first map's frame of reference.
    let truth = simulator.ground_truth();
    let mut worst: f64 = 0.0;
    for k in view.keyframes() {
        let frame = match k.id.0.checked_sub(added) {
            Some(own) => 20 + 2 * own as usize,
            None => 2 * k.id.0 as usize,
        };
        let real = truth[0].1.inverse() * truth[frame].1;
        worst = worst.max((k.centre() - real.translation).norm());
    }
    let sequence = "sim:loop_two_rooms as two maps of 90 frames: largest error";
    let found = Figures::all_posed(1e3 * worst, 90);
    ate::hold(sequence, "none", "default", found);
    // Likewise the world of the second map, which starts at its first frame.
    let real = truth[0].1.inverse() * truth[20].1;
    let placed = joined.placed.map(|p| p.unwrap());
    for found in [
        joined.first_from_second().unwrap(),
        placed[1].joined_from_map,
    ] {
        let off = (found.inverse() * real).log().norm();
        assert!(off < 0.03 && real.log().norm() > 0.1, "{off}");
    }
    assert!(placed.iter().all(|p| p.bent < 0.05), "{placed:?}");
    // Control: maps of disjoint places stay separate.
    let apart = join_maps(&Config::default(), map(0..30), &map(100..130)).unwrap();
    assert_eq!(apart.submaps, [2, 2]);
    assert_eq!((apart.first_from_second(), apart.placed[1]), (None, None));
}
