//! Compares the masks of `run --masks` with those of the library: both use the same filter.

#![allow(clippy::print_stdout)] // Prints figures for docs/evidence/people.md.

use crate::common::{check, files, program, simulate};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use stillpoint::datasets::{Dataset, FrameOptions, OpenOptions, trajectory};
use stillpoint::detection::{Detector, ScriptedDetector};
use stillpoint::geometry::{Camera, Se3, Vec3};
use stillpoint::imaging::{FrameSource, RgbdFrame, Simd};
use stillpoint::slam::{Config, DynamicMask, System};

/// Enough for a person to start walking and cross the image, and for map corrections.
const FRAMES: usize = 60;
/// Stamps of colour and depth drift against each other as those of a real camera, so that association may leave a frame out.
const LEAST: usize = FRAMES - 2;

/// A recording with walking people, and the results of `run`.
struct Recording {
    camera: Camera,
    frames: Vec<Arc<RgbdFrame>>,
    script: String,
    /// `world_from_camera` of each frame as the run reported it at the time.
    poses: Vec<Se3>,
    /// The mask of each frame, as the run wrote it.
    masks: Vec<Vec<u8>>,
}

static RECORDING: LazyLock<Recording> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let [room, out, masks] = ["room", "out", "masks"].map(|name| dir.path().join(name));
    simulate(&room, "walking_xyz", FRAMES);
    let script = room.join("detections.csv");
    run(&room, &script, &out, &masks);
    let dataset = Dataset::open(&room, &OpenOptions::default()).unwrap();
    let mut source = dataset.frames(&FrameOptions::default()).unwrap();
    let next = || Some(Arc::new(source.next_frame()?.unwrap()));
    let frames: Vec<Arc<RgbdFrame>> = std::iter::from_fn(next).collect();
    let poses = trajectory::read(&out.join("trajectory_online.txt")).unwrap();
    let masks = files(&masks);
    assert!(frames.len() >= LEAST, "{} frames", frames.len());
    // Every frame has its mask and its pose.
    assert_eq!([poses.len(), masks.len()], [frames.len(); 2]);
    for ((frame, pose), mask) in frames.iter().zip(&poses).zip(&masks) {
        assert!((frame.stamp - pose.stamp).abs() < 1e-5);
        assert!(mask.ends_with(format!("{:.6}.png", frame.stamp)));
    }
    let pixels = |path: &PathBuf| image::open(path).unwrap().into_luma8().into_raw();
    Recording {
        camera: dataset.camera().camera,
        frames,
        script: std::fs::read_to_string(&script).unwrap(),
        poses: poses.iter().map(|p| p.world_from_camera).collect(),
        masks: masks.iter().map(pixels).collect(),
    }
});

fn run(room: &Path, script: &Path, out: &Path, masks: &Path) {
    let mut command = program();
    command.args(["-q", "run"]).arg(room);
    command.arg("--out").arg(out).arg("--masks").arg(masks);
    let detector = format!("scripted:{}", script.display());
    let output = command.args(["--detector", &detector]).output().unwrap();
    check(&output, 0, &[]);
}

impl Recording {
    fn detector(&self) -> ScriptedDetector {
        ScriptedDetector::parse("script", &self.script).unwrap()
    }

    /// Differences between the run's masks and those of a [`DynamicMask`] with its boxes and poses, where the poses are shifted alternately
    /// by half of `jump` (m) along the camera's x axis.
    fn difference(&self, jump: f64) -> Difference {
        let config = Config::default();
        let mut filter = DynamicMask::new(&config, self.camera, Simd::detect()).unwrap();
        let mut detector = self.detector();
        let mut difference = Difference::default();
        for (i, (frame, pose)) in self.frames.iter().zip(&self.poses).enumerate() {
            let x = if i % 2 == 0 { 0.5 } else { -0.5 } * jump;
            let aside = Se3 {
                translation: Vec3::new(x, 0.0, 0.0),
                ..Se3::identity()
            };
            filter.detections(detector.detect(frame).unwrap());
            let found = filter.step(frame, Some(&(*pose * aside))).unwrap();
            difference.add(&self.masks[i], found.mask().data());
        }
        println!(
            "poses that jump by {jump} m: {:.3} % of the pixels differ, at most {:.2} % of a frame, overlap {:.3}",
            100.0 * difference.share(),
            100.0 * difference.worst,
            difference.overlap()
        );
        difference
    }
}

#[derive(Debug, Default)]
struct Difference {
    pixels: usize,
    differ: usize,
    both: usize,
    /// Maximum share of differing pixels in a frame.
    worst: f64,
}

impl Difference {
    fn add(&mut self, a: &[u8], b: &[u8]) {
        assert_eq!(a.len(), b.len());
        let pairs = || a.iter().zip(b);
        let differ = pairs().filter(|(a, b)| a != b).count();
        self.pixels += a.len();
        self.differ += differ;
        self.both += pairs().filter(|(a, b)| **a > 0 && **b > 0).count();
        self.worst = self.worst.max(differ as f64 / a.len() as f64);
    }

    fn share(&self) -> f64 {
        self.differ as f64 / self.pixels as f64
    }

    /// Intersection over union.
    fn overlap(&self) -> f64 {
        self.both as f64 / (self.both + self.differ).max(1) as f64
    }
}

#[test]
fn command_line_masks_equal_the_library_masks() {
    let recording = &*RECORDING;
    let mut system = System::new(Config::default(), recording.camera, Simd::detect())
        .unwrap()
        .with_detector(Box::new(recording.detector()));
    let mut masked = 0;
    for (frame, mask) in recording.frames.iter().zip(&recording.masks) {
        let events = system.step(RgbdFrame::clone(frame));
        let event = events.iter().find_map(|e| e.as_frame()).unwrap();
        let own = event.report.segments.mask(frame);
        assert!(own.data() == mask.as_slice(), "{}", frame.stamp);
        masked += mask.iter().filter(|v| **v > 0).count();
    }
    assert!(masked > 0, "nobody walks");
}

#[test]
fn standalone_masks_with_run_poses_match_the_run() {
    let given = RECORDING.difference(0.0);
    // The rest is due to the order of processing: a run judges a frame before its final pose is measured.
    assert!(given.share() < 0.002 && given.worst < 0.01, "{given:?}");
    assert!(given.overlap() > 0.98, "{given:?}");
    // Control: wrong poses give other masks.
    let off = RECORDING.difference(0.1);
    assert!(off.share() > 0.02 && off.overlap() < 0.8, "{off:?}");
}
