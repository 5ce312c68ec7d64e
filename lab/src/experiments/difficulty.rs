//! How hard the simulated scenes are for a feature tracker, beside a real recording (freiburg1_xyz of the TUM RGB-D
//! benchmark, when it is there: in the folder of the environment variable STILLPOINT_DATA, else in ../shared/data).
//!
//! Run: `cargo run --release -p stillpoint-simulator --example difficulty`. Prints a Markdown table.

use std::error::Error;
use std::path::PathBuf;
use stillpoint_datasets::{Dataset, FrameOptions, OpenOptions, StampedPose};
use stillpoint_features::kernels::Stages;
use stillpoint_features::{Features, OrbConfig, OrbExtractor, match_brute_force};
use stillpoint_geometry::{Camera, Se3, Vec2};
use stillpoint_imaging::{FrameSource, RgbdFrame, Simd};
use stillpoint_simulator::{Simulator, SimulatorConfig, scene_names};

/// Sequences are measured in this many windows of as many frames each; tracks end at a window's end.
const WINDOWS: usize = 5;
const WINDOW: usize = 60;

/// Sums over the frames of one sequence.
#[derive(Default)]
struct Figures {
    frames: f64,
    corners: f64,
    corners_level0: f64,
    holes: f64,
    grey: f64,
    pairs: f64,
    matches: f64,
    /// Matches with depth, and how many of them are within 2 and 4 px of where the true motion takes them.
    with_depth: f64,
    within: [f64; 2],
    tracks: f64,
    track_frames: f64,
}

/// One frame's features with the lengths of their tracks.
struct Seen {
    frame: RgbdFrame,
    features: Features,
    lengths: Vec<f64>,
}

struct Meter {
    camera: Camera,
    extractor: OrbExtractor,
    stages: Stages,
    last: Option<Seen>,
    figures: Figures,
}

impl Meter {
    fn new(camera: Camera) -> Self {
        let simd = Simd::detect();
        Self {
            camera,
            extractor: OrbExtractor::new(&OrbConfig::default(), simd),
            stages: Stages::new(simd),
            last: None,
            figures: Figures::default(),
        }
    }

    /// Takes the next frame; `first` when it begins a window. `pose` gives the true pose at a stamp.
    fn add(&mut self, frame: RgbdFrame, first: bool, pose: &dyn Fn(f64) -> Option<Se3>) {
        let mut features = Features::default();
        self.extractor.extract(&frame.gray, &mut features);
        let f = &mut self.figures;
        f.frames += 1.0;
        for level in 0..self.extractor.pyramid().levels() {
            let count = self.stages.fast(self.extractor.pyramid().level(level)) as f64;
            f.corners += count;
            f.corners_level0 += if level == 0 { count } else { 0.0 };
        }
        let pixels = frame.depth.data().len() as f64;
        f.holes += frame.depth.data().iter().filter(|z| **z == 0.0).count() as f64 / pixels;
        f.grey += frame.gray.data().iter().map(|v| f64::from(*v)).sum::<f64>() / pixels;
        let mut lengths = vec![1.0; features.len()];
        if first {
            self.end_window();
        } else if let Some(last) = self.last.take() {
            self.compare(&last, &frame, &features, &mut lengths, pose);
        }
        self.last = Some(Seen {
            frame,
            features,
            lengths,
        });
    }

    /// Matches two frames and extends the tracks of matches that agree with the true motion.
    fn compare(
        &mut self,
        last: &Seen,
        frame: &RgbdFrame,
        features: &Features,
        lengths: &mut [f64],
        pose: &dyn Fn(f64) -> Option<Se3>,
    ) {
        let (Some(from), Some(to)) = (pose(last.frame.stamp), pose(frame.stamp)) else {
            return;
        };
        let to_from_last = to.inverse() * from;
        let f = &mut self.figures;
        f.pairs += 1.0;
        let matched = match_brute_force(&last.features.descriptors, &features.descriptors, 64, 1.0);
        for (i, index) in matched.iter().enumerate() {
            let a = &last.features.keypoints[i];
            let z = f64::from(
                last.frame
                    .depth
                    .at(a.x.round() as usize, a.y.round() as usize),
            );
            let mut goes_on = false;
            if let Some(j) = index.map(|j| j as usize) {
                f.matches += 1.0;
                if z > 0.0 {
                    let b = &features.keypoints[j];
                    let px = |x: f32, y: f32| {
                        self.camera.undistort(Vec2::new(f64::from(x), f64::from(y)))
                    };
                    let there = to_from_last.transform(&self.camera.backproject(px(a.x, a.y), z));
                    let error = (self.camera.project(&there) - px(b.x, b.y)).norm();
                    f.with_depth += 1.0;
                    f.within[0] += f64::from(u8::from(error < 2.0));
                    f.within[1] += f64::from(u8::from(error < 4.0));
                    goes_on = error < 4.0;
                    if goes_on {
                        lengths[j] = last.lengths[i] + 1.0;
                    }
                }
            }
            if !goes_on && z > 0.0 {
                f.tracks += 1.0;
                f.track_frames += last.lengths[i];
            }
        }
    }

    fn end_window(&mut self) {
        if let Some(last) = self.last.take() {
            self.figures.tracks += last.lengths.len() as f64;
            self.figures.track_frames += last.lengths.iter().sum::<f64>();
        }
    }

    fn finish(mut self) -> Vec<f64> {
        self.end_window();
        let f = self.figures;
        vec![
            f.corners / f.frames,
            f.corners_level0 / f.frames,
            f.matches / f.pairs,
            f.within[0] / f.with_depth,
            f.within[1] / f.with_depth,
            f.track_frames / f.tracks,
            f.holes / f.frames,
            f.grey / f.frames,
        ]
    }
}

const ROWS: [&str; 8] = [
    "corners per frame, 8 levels",
    "corners per frame, finest level",
    "matches per pair of frames",
    "inlier ratio, 2 px of true motion",
    "inlier ratio, 4 px of true motion",
    "mean track length, frames",
    "share of pixels without depth",
    "mean grey level",
];

fn pose_at(poses: &[StampedPose], stamp: f64) -> Option<Se3> {
    let k = poses.partition_point(|p| p.stamp < stamp);
    let (a, b) = (poses.get(k.checked_sub(1)?)?, poses.get(k)?);
    let share = (stamp - a.stamp) / (b.stamp - a.stamp);
    Some(a.world_from_camera.interpolate(&b.world_from_camera, share))
}

fn measure_real(folder: PathBuf) -> Result<Vec<f64>, Box<dyn Error>> {
    let dataset = Dataset::open(&folder, &OpenOptions::default())?;
    let poses = dataset.ground_truth()?.ok_or("no ground truth")?;
    let mut meter = Meter::new(dataset.camera().camera);
    let mut frames = dataset.frames(&FrameOptions::default())?;
    let mut index = 0;
    while let Some(frame) = frames.next_frame() {
        if index < WINDOWS * WINDOW {
            meter.add(frame?, index % WINDOW == 0, &|t| pose_at(&poses, t));
        }
        index += 1;
    }
    Ok(meter.finish())
}

fn measure_scene(scene: &str) -> Result<Vec<f64>, Box<dyn Error>> {
    let sim = Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        ..SimulatorConfig::default()
    })?;
    let mut meter = Meter::new(*sim.camera());
    for window in 0..WINDOWS {
        let start = window * sim.len() / WINDOWS;
        for k in 0..WINDOW {
            meter.add(sim.frame(start + k), k == 0, &|t| {
                Some(sim.world_from_camera(t))
            });
        }
    }
    Ok(meter.finish())
}

/// Features per 1000 px on movers and elsewhere, the movers' share of all features and their share of the image.
fn features_on_movers(scene: &str) -> Result<[f64; 4], Box<dyn Error>> {
    let sim = Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        ..SimulatorConfig::default()
    })?;
    let mut extractor = OrbExtractor::new(&OrbConfig::default(), Simd::detect());
    // Features and pixels, elsewhere and on movers.
    let mut sums = [[0.0; 2]; 2];
    for index in (0..sim.len()).step_by(15) {
        let mut features = Features::default();
        extractor.extract(&sim.frame(index).gray, &mut features);
        let mask = sim.truth(index).mask;
        for k in &features.keypoints {
            let (u, v) = (k.x.round() as usize, k.y.round() as usize);
            let on = mask.at(u.min(mask.width() - 1), v.min(mask.height() - 1)) > 0;
            sums[usize::from(on)][0] += 1.0;
        }
        for m in mask.data() {
            sums[usize::from(*m > 0)][1] += 1.0;
        }
    }
    let [[off, off_px], [on, on_px]] = sums;
    let (share, cover) = (on / (on + off), on_px / (on_px + off_px));
    Ok([1e3 * on / on_px, 1e3 * off / off_px, share, cover])
}

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn Error>> {
    let data = std::env::var("STILLPOINT_DATA").map_or_else(
        |_| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let folder = data.join("fr1_xyz");
    let mut columns = Vec::new();
    if folder.is_dir() {
        columns.push(("fr1_xyz (real)", measure_real(folder)?));
    } else {
        println!(
            "No folder fr1_xyz in {}: the real recording is left out.\n",
            data.display()
        );
    }
    // Where people walk, the camera's motion does not tell where a point goes.
    let (still, people): (Vec<&str>, Vec<&str>) = scene_names()
        .iter()
        .partition(|name| !name.contains('_') || name.starts_with("loop"));
    for scene in &still {
        columns.push((*scene, measure_scene(scene)?));
    }
    let names: Vec<&str> = columns.iter().map(|c| c.0).collect();
    println!(
        "| | {} |\n|---|{}",
        names.join(" | "),
        "---|".repeat(names.len())
    );
    for (k, row) in ROWS.iter().enumerate() {
        let cells: Vec<String> = columns
            .iter()
            .map(|(_, v)| {
                if v[k] < 10.0 {
                    format!("{:.2}", v[k])
                } else {
                    format!("{:.0}", v[k])
                }
            })
            .collect();
        println!("| {row} | {} |", cells.join(" | "));
    }
    println!("\n| | on movers | elsewhere | share of all | share of the image |");
    println!("|---|---|---|---|---|");
    for scene in people {
        let [on, off, share, cover] = features_on_movers(scene)?;
        println!("| `{scene}` | {on:.1} | {off:.1} | {share:.2} | {cover:.2} |");
    }
    Ok(())
}
