//! Export of frames and poses for other programs.

use super::{Scene, chosen};
use crate::Failure;
use crate::experiments::shared::pose_at;
use std::path::Path;
use stillpoint::geometry::{Camera, Se3, Vec2};
use stillpoint::imaging::FrameSource;
use stillpoint::recordings;

/// `camera.txt` (width height fx fy cx cy), `poses.txt` (16 numbers a line, camera to world), and per frame `N.depth` (16 bits, 5000 per
/// metre) and `N.rgb`.
struct Dump<'a> {
    dir: &'a Path,
    poses: String,
    count: usize,
}

impl Dump<'_> {
    fn add(&mut self, depth: &[f32], rgb: &[u8], pose: &Se3) -> Result<(), Failure> {
        let units = depth.iter().map(|z| (z * 5000.0 + 0.5).min(65535.0) as u16);
        let bytes: Vec<u8> = units.flat_map(u16::to_le_bytes).collect();
        std::fs::write(self.dir.join(format!("{}.depth", self.count)), bytes)?;
        std::fs::write(self.dir.join(format!("{}.rgb", self.count)), rgb)?;
        let row: Vec<String> = pose
            .to_matrix()
            .transpose()
            .iter()
            .map(f64::to_string)
            .collect();
        self.poses += &(row.join(" ") + "\n");
        self.count += 1;
        Ok(())
    }

    fn finish(self, camera: &Camera) -> Result<(), Failure> {
        let c = camera;
        let text = format!(
            "{} {} {} {} {} {}\n",
            c.width, c.height, c.fx, c.fy, c.cx, c.cy
        );
        std::fs::write(self.dir.join("camera.txt"), text)?;
        std::fs::write(self.dir.join("poses.txt"), self.poses)?;
        Ok(())
    }
}

pub(super) fn dump_simulated(scene: &Scene, dir: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(dir)?;
    let sim = scene.simulator()?;
    let mut dump = Dump {
        dir,
        poses: String::new(),
        count: 0,
    };
    for i in chosen(&sim) {
        let mask = sim.truth(i).mask;
        let depth = sim.depth(i);
        let still = depth.data().iter().zip(mask.data());
        let depth: Vec<f32> = still.map(|(z, m)| if *m > 0 { 0.0 } else { *z }).collect();
        let pose = sim.world_from_camera(sim.depth_stamp(i));
        dump.add(&depth, sim.colour(i).data(), &pose)?;
    }
    dump.finish(sim.camera())
}

/// Exports a recording with ground truth, with lens distortion removed.
pub(super) fn dump_recorded(folder: &Path, dir: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(dir)?;
    let input = recordings::open(folder, &Default::default())?;
    let truth = input.ground_truth()?.ok_or("no ground truth")?;
    let camera = input.camera().camera;
    let mut dump = Dump {
        dir,
        poses: String::new(),
        count: 0,
    };
    let (w, h) = (camera.width as usize, camera.height as usize);
    let source = |i: usize| {
        let raw = camera.distort(Vec2::new((i % w) as f64, (i / w) as f64));
        let (x, y) = ((raw.x + 0.5).floor(), (raw.y + 0.5).floor());
        let inside = x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64;
        inside.then(|| y as usize * w + x as usize)
    };
    let table: Vec<Option<usize>> = (0..w * h).map(source).collect();
    let mut frames = input.frames(&stillpoint::datasets::FrameOptions {
        start: 0,
        max_frames: None,
        keep_colour: true,
    })?;
    while let Some(frame) = frames.next_frame() {
        let frame = frame?;
        let Some(pose) = pose_at(&truth, frame.depth_stamp).filter(|_| frame.id.0 % 2 == 0) else {
            continue;
        };
        let depth: Vec<f32> = table
            .iter()
            .map(|s| s.map_or(0.0, |s| frame.depth.data()[s]))
            .collect();
        let colour = frame.colour.as_ref().ok_or("no colour")?;
        let rgb: Vec<u8> = table
            .iter()
            .flat_map(|s| s.map_or([0; 3], |s| colour.at(s % w, s / w)))
            .collect();
        dump.add(&depth, &rgb, &pose)?;
    }
    dump.finish(&camera.rectified())
}
