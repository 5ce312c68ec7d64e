//! Keyframes of real and simulated recordings, with known view overlap.

use super::datasets::{Dataset, FrameOptions, OpenOptions, StampedPose};
use super::features::{Descriptor, Features, OrbConfig, OrbExtractor};
use super::geometry::{Camera, Se3, Vec2, Vec3};
use super::imaging::{DepthImage, FrameSource, GrayImage, RgbdFrame, Simd};
use super::simulator::{Simulator, SimulatorConfig};
use std::error::Error;
use std::path::Path;

/// Motion after which the next keyframe is made, m and rad.
const STEP: [f64; 2] = [0.2, 0.18];
/// Columns and rows of the grid on which views are compared.
const GRID: [usize; 2] = [64, 48];
/// Maximum depth difference of one surface in two views: a share of the depth, and m.
const SAME_DEPTH: [f64; 2] = [0.04, 0.06];

/// An image with its ground truth.
pub(crate) struct Keyframe {
    /// s.
    pub(crate) stamp: f64,
    /// Without features on moving objects.
    pub(crate) descriptors: Vec<Descriptor>,
    camera: Camera,
    world_from_camera: Se3,
    /// Depths on the grid, m; 0 where unknown.
    depths: Vec<f32>,
}

struct Recorder {
    camera: Camera,
    extractor: OrbExtractor,
    features: Features,
}

impl Recorder {
    fn new(camera: Camera) -> Self {
        Self {
            camera,
            extractor: OrbExtractor::new(&OrbConfig::default(), Simd::detect()),
            features: Features::default(),
        }
    }

    fn keyframe(
        &mut self,
        frame: &RgbdFrame,
        world_from_camera: Se3,
        mask: Option<&GrayImage>,
    ) -> Keyframe {
        self.extractor.extract(&frame.gray, &mut self.features);
        let moves = |x: f32, y: f32| {
            mask.is_some_and(|mask| {
                // Patches of features next to a person contain part of the person.
                [(0.0, 0.0), (-8.0, 0.0), (8.0, 0.0), (0.0, -8.0), (0.0, 8.0)]
                    .iter()
                    .any(|(dx, dy)| pixel(mask, x + dx, y + dy) != 0)
            })
        };
        let descriptors = self
            .features
            .keypoints
            .iter()
            .zip(&self.features.descriptors);
        let descriptors = descriptors
            .filter(|(k, _)| !moves(k.x, k.y))
            .map(|(_, d)| *d);
        Keyframe {
            stamp: frame.stamp,
            descriptors: descriptors.collect(),
            camera: self.camera,
            world_from_camera,
            depths: on_grid(&frame.depth, mask),
        }
    }
}

fn pixel(image: &GrayImage, x: f32, y: f32) -> u8 {
    let (x, y) = (x.round() as usize, y.round() as usize);
    image.at(x.min(image.width() - 1), y.min(image.height() - 1))
}

fn grid_point(camera: &Camera, cell: usize) -> Vec2 {
    let (column, row) = (cell % GRID[0], cell / GRID[0]);
    let along = |cell: usize, cells: usize, size: u32| {
        ((cell as f64 + 0.5) * f64::from(size) / cells as f64).floor()
    };
    Vec2::new(
        along(column, GRID[0], camera.width),
        along(row, GRID[1], camera.height),
    )
}

fn on_grid(depth: &DepthImage, mask: Option<&GrayImage>) -> Vec<f32> {
    let size = Camera::pinhole(depth.width() as u32, depth.height() as u32, [1.0; 4]);
    (0..GRID[0] * GRID[1])
        .map(|cell| {
            let at = grid_point(&size, cell);
            let moves = mask.is_some_and(|m| pixel(m, at.x as f32, at.y as f32) != 0);
            let z = depth.at(at.x as usize, at.y as usize);
            if moves || !z.is_finite() { 0.0 } else { z }
        })
        .collect()
}

impl Keyframe {
    /// Share of this keyframe's view that `other` sees as well, 0 to 1.
    fn seen_by(&self, other: &Keyframe) -> f64 {
        let other_from_this = other.world_from_camera.inverse() * self.world_from_camera;
        let (mut all, mut seen) = (0, 0);
        let even = |n: usize| n.is_multiple_of(2);
        let chosen = (0..self.depths.len()).filter(|c| even(*c) && even(*c / GRID[0]));
        for cell in chosen {
            let z = f64::from(self.depths[cell]);
            if z <= 0.0 {
                continue;
            }
            all += 1;
            let px = self.camera.undistort(grid_point(&self.camera, cell));
            let there = other_from_this.transform(&self.camera.backproject(px, z));
            seen += usize::from(other.sees(&there));
        }
        seen as f64 / f64::from(all.max(1)) * f64::from(u8::from(all > 50))
    }

    /// Whether a point (m, camera coordinates) is in the image and not occluded.
    fn sees(&self, point: &Vec3) -> bool {
        if point.z < 0.1 {
            return false;
        }
        let px = self.camera.project_distorted(point);
        if !self.camera.contains(px) {
            return false;
        }
        let cell = |at: f64, cells: usize, size: u32| {
            ((at * cells as f64 / f64::from(size)) as usize).min(cells - 1)
        };
        let column = cell(px.x.max(0.0), GRID[0], self.camera.width);
        let row = cell(px.y.max(0.0), GRID[1], self.camera.height);
        let z = f64::from(self.depths[row * GRID[0] + column]);
        // Without depth, points in the image count as seen.
        z == 0.0 || (z - point.z).abs() < SAME_DEPTH[0] * z + SAME_DEPTH[1]
    }

    /// The smaller of the two shares of view overlap, 0 to 1.
    pub(crate) fn overlap(&self, other: &Keyframe) -> f64 {
        let far = self.world_from_camera.translation - other.world_from_camera.translation;
        if far.norm() > 15.0 {
            return 0.0;
        }
        let first = self.seen_by(other);
        if first == 0.0 {
            0.0
        } else {
            first.min(other.seen_by(self))
        }
    }
}

fn choose(poses: &[(f64, Se3)]) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    for (i, (_, pose)) in poses.iter().enumerate() {
        let due = chosen.last().is_none_or(|last| {
            let before = &poses[*last].1;
            let way = (before.translation - pose.translation).norm();
            let turn = (before.inverse() * *pose).rotation.angle();
            way > STEP[0] || turn > STEP[1]
        });
        if due {
            chosen.push(i);
        }
    }
    chosen
}

#[allow(dead_code)] // Used by the laboratory only.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Simulated {
    pub(crate) scene: &'static str,
    pub(crate) seed: u64,
    /// `None` for the scene's own length.
    pub(crate) frames: Option<usize>,
}

#[allow(dead_code)] // Used by the laboratory only.
pub(crate) fn simulated(what: &Simulated) -> Result<Vec<Keyframe>, Box<dyn Error>> {
    let sim = Simulator::new(&SimulatorConfig {
        scene: what.scene.to_owned(),
        seed: what.seed,
        frames: what.frames,
        ..SimulatorConfig::default()
    })?;
    let people = what.scene.starts_with("walking") || what.scene.starts_with("sitting");
    let poses = sim.ground_truth();
    let mut recorder = Recorder::new(*sim.camera());
    let keyframe = |index: usize| {
        let mask = people.then(|| sim.truth(index).mask);
        recorder.keyframe(&sim.frame(index), poses[index].1, mask.as_ref())
    };
    Ok(choose(&poses).into_iter().map(keyframe).collect())
}

fn pose_at(poses: &[StampedPose], stamp: f64) -> Option<Se3> {
    let k = poses.partition_point(|p| p.stamp < stamp);
    let b = poses.get(k)?;
    if b.stamp == stamp {
        return Some(b.world_from_camera);
    }
    let a = poses.get(k.checked_sub(1)?)?;
    let share = (stamp - a.stamp) / (b.stamp - a.stamp);
    Some(a.world_from_camera.interpolate(&b.world_from_camera, share))
}

/// The keyframes of a recording: chosen by the camera's motion, or every `every`-th frame.
pub(crate) fn recorded(
    folder: &Path,
    every: Option<usize>,
) -> Result<Vec<Keyframe>, Box<dyn Error>> {
    let dataset = Dataset::open(folder, &OpenOptions::default())?;
    let truth = dataset.ground_truth()?.ok_or("no ground truth")?;
    let mut recorder = Recorder::new(dataset.camera().camera);
    let mut frames = dataset.frames(&FrameOptions::default())?;
    let stamps = dataset.entries().iter().map(|e| e.stamp);
    let poses: Vec<Option<(f64, Se3)>> = stamps.map(|s| Some((s, pose_at(&truth, s)?))).collect();
    let known: Vec<usize> = (0..poses.len()).filter(|i| poses[*i].is_some()).collect();
    let of_known: Vec<(f64, Se3)> = poses.iter().copied().flatten().collect();
    let chosen: Vec<usize> = match every {
        Some(every) => known.iter().copied().step_by(every).collect(),
        None => choose(&of_known).into_iter().map(|i| known[i]).collect(),
    };
    let mut keyframes = Vec::new();
    for (index, pose) in poses.iter().enumerate() {
        let Some(frame) = frames.next_frame() else {
            break;
        };
        let frame = frame?;
        if let (true, Some((_, pose))) = (chosen.binary_search(&index).is_ok(), pose) {
            keyframes.push(recorder.keyframe(&frame, *pose, None));
        }
    }
    Ok(keyframes)
}
