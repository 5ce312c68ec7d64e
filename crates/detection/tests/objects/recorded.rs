//! The tracker on people with limbs and ragged depth: simulated, and real if the data set is available.
// Tests may read data sets; the library reads no files.
#![allow(clippy::disallowed_methods)]

use super::score::{Score, judge};
use super::world::{normal, person, uniform};
use std::collections::BTreeMap;
use std::path::Path;
use stillpoint_datasets::{Dataset, FrameOptions, OpenOptions, StampedPose};
use stillpoint_detection::{
    BoundingBox, Detections, Object, ObjectId, ObjectState, ObjectTracker, ObjectsConfig,
};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{CoarseDepth, FrameId, FrameSource};
use stillpoint_simulator::{Simulator, SimulatorConfig};

/// Input of the tracker, and true boxes of the visible part of each person.
struct Recorded {
    stamp: f64,
    pose: Se3,
    depth: CoarseDepth,
    people: BTreeMap<u32, BoundingBox>,
}

/// Runs the tracker; `missed(frame, person)` selects missed detections. Sides are off by 4 % of the box's size.
fn follow(camera: Camera, frames: &[Recorded], missed: impl Fn(u64, u32) -> bool) -> Score {
    let mut tracker = ObjectTracker::new(ObjectsConfig::default(), camera);
    let mut score = Score::default();
    let mut known: BTreeMap<u32, Option<ObjectId>> = BTreeMap::new();
    for (n, frame) in frames.iter().enumerate() {
        let n = n as u64;
        let seen = frame.people.iter().filter(|(id, _)| !missed(n, **id));
        let detections = Detections {
            frame: FrameId(n as u32),
            stamp: frame.stamp,
            items: seen
                .map(|(id, b)| person(jittered(b, &camera, n, u64::from(*id))))
                .collect(),
        };
        tracker.update(&detections, &frame.pose, &frame.depth);
        let objects: Vec<Object> = tracker
            .predict(frame.stamp, &frame.pose)
            .into_iter()
            .filter(|o| o.state != ObjectState::Tentative)
            .collect();
        let in_view = objects.iter().filter(|o| o.bounds.area() > 0.0).count();
        score.surplus += in_view.saturating_sub(frame.people.len());
        for o in &objects {
            if !score.ids.contains(&o.id) {
                score.ids.push(o.id);
            }
        }
        for id in frame.people.keys() {
            known.entry(*id).or_default();
        }
        for (id, known) in &mut known {
            let truth = frame.people.get(id).map(|b| (*b, 1.0));
            judge(&mut score, known, truth, &objects, &detections, n);
        }
    }
    println!("{score}");
    score
}

fn jittered(b: &BoundingBox, camera: &Camera, frame: u64, person: u64) -> BoundingBox {
    let e = |i: u64, size: f64| normal(5, [frame, 10 * person + i]) * 0.04 * size;
    let (w, h) = (b.width(), b.height());
    BoundingBox {
        x0: b.x0 + e(0, w),
        y0: b.y0 + e(1, h),
        x1: b.x1 + e(2, w),
        y1: b.y1 + e(3, h),
    }
    .clipped(camera.width as usize, camera.height as usize)
}

fn third(frame: u64, person: u32) -> bool {
    uniform(3, [frame, u64::from(person), 1]) < 0.3
}

fn gap(frame: u64, _: u32) -> bool {
    frame % 60 >= 35
}

fn simulated(scene: &str, frames: usize) -> (Camera, Vec<Recorded>) {
    let camera = Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]);
    let config = SimulatorConfig {
        scene: scene.to_owned(),
        frames: Some(frames),
        camera,
        ..SimulatorConfig::default()
    };
    let simulator = Simulator::new(&config).unwrap();
    let least = 320 * 240 / 50;
    let frame = |i: usize| Recorded {
        stamp: simulator.stamp(i),
        pose: simulator.world_from_camera(simulator.stamp(i)),
        depth: CoarseDepth::new(&simulator.depth(i), 4),
        people: simulator
            .truth(i)
            .boxes
            .iter()
            .filter(|b| b.class == "person" && b.visible_px > least)
            .map(|b| {
                let (x0, y0, x1, y1) = (b.x0, b.y0, b.x1, b.y1);
                (b.mover, BoundingBox { x0, y0, x1, y1 })
            })
            .collect(),
    };
    (camera, (0..frames).map(frame).collect())
}

#[test]
fn simulated_people_are_tracked() {
    for scene in ["walking_xyz", "walking_rpy", "walking_halfsphere"] {
        let (camera, frames) = simulated(scene, 300);
        let s = follow(camera, &frames, third);
        assert!(s.switches <= 2 && s.mean() > 0.8, "{scene}: {s}");
        let s = follow(camera, &frames, gap);
        assert!(s.switches <= 2 && s.mean() > 0.5, "{scene}: {s}");
    }
}

fn pose_at(truth: &[StampedPose], stamp: f64) -> Option<Se3> {
    let after = truth.partition_point(|p| p.stamp < stamp);
    let (a, b) = (truth.get(after.checked_sub(1)?)?, truth.get(after)?);
    let share = (stamp - a.stamp) / (b.stamp - a.stamp);
    Some(a.world_from_camera.interpolate(&b.world_from_camera, share))
}

/// `timestamp,walker,x0,y0,x1,y1,visible_px`, by stamp in microseconds.
fn boxes(path: &Path) -> BTreeMap<u64, BTreeMap<u32, BoundingBox>> {
    let mut found: BTreeMap<u64, BTreeMap<u32, BoundingBox>> = BTreeMap::new();
    for line in std::fs::read_to_string(path).unwrap().lines().skip(1) {
        let v: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let (x0, y0, x1, y1) = (v[2], v[3], v[4], v[5]);
        if v[6] > 6000.0 {
            let frame = found.entry((v[0] * 1e6).round() as u64).or_default();
            frame.insert(v[1] as u32, BoundingBox { x0, y0, x1, y1 });
        }
    }
    found
}

fn real() -> Option<(Camera, Vec<Recorded>)> {
    let path = stillpoint_testdata::recording("fr1_xyz_walkers")?;
    let data = Dataset::open(&path, &OpenOptions::default()).unwrap();
    let truth = data.ground_truth().unwrap().unwrap();
    let mut people = boxes(&path.join("boxes.csv"));
    let mut source = data.frames(&FrameOptions::default()).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = source.next_frame() {
        let frame = frame.unwrap();
        let Some(pose) = pose_at(&truth, frame.stamp) else {
            continue;
        };
        frames.push(Recorded {
            stamp: frame.stamp,
            pose,
            depth: CoarseDepth::new(&frame.depth, 8),
            people: people
                .remove(&((frame.stamp * 1e6).round() as u64))
                .unwrap_or_default(),
        });
    }
    Some((data.camera().camera, frames))
}

#[test]
fn recorded_people_are_tracked() {
    let Some((camera, frames)) = real() else {
        return;
    };
    assert!(frames.len() > 250);
    // Two people who alternately fill half of the image and hide each other; boxes are of the visible parts.
    let s = follow(camera, &frames, third);
    assert!(s.switches <= 7 && s.mean() > 0.7, "{s}");
    assert!(s.held > 20 * s.missed, "{s}");
    let s = follow(camera, &frames, gap);
    assert!(s.mean() > 0.45 && s.held > 5 * s.missed, "{s}");
}
