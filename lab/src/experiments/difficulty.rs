//! Difficulty of the simulated scenes for a feature tracker, compared with freiburg1_xyz of the TUM RGB-D benchmark, if available.

use crate::Failure;
use crate::experiments::shared::{pose_at, scene};
use crate::inputs::data_folder;
use crate::table::{self, Table, figure};
use std::path::Path;
use std::process::ExitCode;
use stillpoint::datasets::{Dataset, FrameOptions, OpenOptions};
use stillpoint::features::kernels::Stages;
use stillpoint::features::{Features, OrbConfig, OrbExtractor, match_brute_force};
use stillpoint::geometry::{Camera, Se3, Vec2};
use stillpoint::imaging::{FrameSource, RgbdFrame, Simd};
use stillpoint::simulator::scene_names;

/// Measures how hard the simulated scenes are for a feature tracker, compared with a real recording
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Frames of each of the five windows in which sequences are measured; tracks end at a window's end
    #[arg(long, default_value_t = 60)]
    window: usize,
    /// Simulated scenes [default: all of them, and the recording]
    scenes: Vec<String>,
}

/// Windows per sequence.
const WINDOWS: usize = 5;

#[derive(Default)]
struct Figures {
    frames: f64,
    corners: f64,
    corners_level0: f64,
    holes: f64,
    grey: f64,
    pairs: f64,
    matches: f64,
    /// Matches with depth, and those within 2 and 4 px of the true motion.
    with_depth: f64,
    within: [f64; 2],
    tracks: f64,
    track_frames: f64,
}

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

    /// `first` begins a window. `pose` returns the true pose at a stamp.
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

    /// Matches two frames and extends tracks that agree with the true motion.
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
    "corners per frame, all levels",
    "corners per frame, finest level",
    "matches per pair of frames",
    "inlier ratio, 2 px of true motion",
    "inlier ratio, 4 px of true motion",
    "mean track length, frames",
    "share of pixels without depth",
    "mean grey level",
];

fn measure_real(folder: &Path, window: usize) -> Result<Vec<f64>, Failure> {
    let dataset = Dataset::open(folder, &OpenOptions::default())?;
    let poses = dataset.ground_truth()?.ok_or("no ground truth")?;
    let mut meter = Meter::new(dataset.camera().camera);
    let mut frames = dataset.frames(&FrameOptions::default())?;
    let mut index = 0;
    while let Some(frame) = frames.next_frame() {
        if index < WINDOWS * window {
            meter.add(frame?, index % window == 0, &|t| pose_at(&poses, t));
        }
        index += 1;
    }
    Ok(meter.finish())
}

fn measure_scene(name: &str, window: usize) -> Result<Vec<f64>, Failure> {
    let sim = scene(name, 0, None)?;
    let mut meter = Meter::new(*sim.camera());
    for start in (0..WINDOWS).map(|k| k * sim.len() / WINDOWS) {
        for k in 0..window {
            let pose = |t: f64| Some(sim.world_from_camera(t));
            meter.add(sim.frame(start + k), k == 0, &pose);
        }
    }
    Ok(meter.finish())
}

/// Features per 1000 px on movers and elsewhere, movers' share of features and of the image.
fn features_on_movers(name: &str) -> Result<[f64; 4], Failure> {
    let sim = scene(name, 0, None)?;
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

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let named: Vec<&str> = arguments.scenes.iter().map(String::as_str).collect();
    let scenes = if named.is_empty() {
        scene_names()
    } else {
        &named[..]
    };
    let mut columns = Vec::new();
    let folder = data_folder().join("fr1_xyz");
    if named.is_empty() && folder.is_dir() {
        columns.push(("fr1_xyz (real)", measure_real(&folder, arguments.window)?));
    } else if named.is_empty() {
        println!(
            "{} is not there: the real recording is left out.\n",
            folder.display()
        );
    }
    // Where people walk, the camera's motion does not predict the motion of points.
    let (still, people): (Vec<&str>, Vec<&str>) = scenes
        .iter()
        .partition(|name| !name.contains('_') || name.starts_with("loop"));
    for scene in &still {
        columns.push((*scene, measure_scene(scene, arguments.window)?));
    }
    let names = [""].into_iter().chain(columns.iter().map(|c| c.0));
    let mut table = Table::new(names);
    for (k, row) in ROWS.iter().enumerate() {
        let cells = columns
            .iter()
            .map(|(_, v)| figure(v[k], if v[k] < 10.0 { 2 } else { 0 }));
        table.row([(*row).to_owned()].into_iter().chain(cells));
    }
    table::print(&table);
    let mut table =
        Table::new(" | on movers | elsewhere | share of all | share of the image".split(" | "));
    for scene in people {
        let [on, off, share, cover] = features_on_movers(scene)?;
        let cells = [
            figure(on, 1),
            figure(off, 1),
            figure(share, 2),
            figure(cover, 2),
        ];
        table.row([format!("`{scene}`")].into_iter().chain(cells));
    }
    println!();
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}
