//! Cost of fusing a frame.

use crate::Failure;
use std::path::Path;
use std::sync::Arc;
use stillpoint::dense::{DenseConfig, DenseMap, Fuser};
use stillpoint::geometry::{Camera, Se3, nalgebra::Matrix4};
use stillpoint::imaging::{ColourImage, DepthImage, FrameId, GrayImage, RgbdFrame, Simd};

/// Prints the user CPU time per frame.
pub(super) fn time(dir: &Path, voxel: f64, rounds: usize) -> Result<(), Failure> {
    let numbers = |name: &str| -> Result<Vec<f64>, Failure> {
        let text = std::fs::read_to_string(dir.join(name))?;
        Ok(text
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<_, _>>()?)
    };
    let c = numbers("camera.txt")?;
    let (w, h) = (c[0] as usize, c[1] as usize);
    let camera = Camera::pinhole(w as u32, h as u32, [c[2], c[3], c[4], c[5]]);
    let mut frames = Vec::new();
    for (i, m) in numbers("poses.txt")?.chunks_exact(16).enumerate() {
        let depth = std::fs::read(dir.join(format!("{i}.depth")))?;
        let depth = depth
            .chunks_exact(2)
            .map(|b| f32::from(u16::from_le_bytes([b[0], b[1]])) / 5000.0);
        let rgb = std::fs::read(dir.join(format!("{i}.rgb")))?;
        let colour = ColourImage::from_vec(w, h, rgb)?;
        let m = Matrix4::from_row_slice(m);
        let pose = Se3::from_matrix(
            &m.fixed_view::<3, 3>(0, 0).into(),
            m.fixed_view::<3, 1>(0, 3).into(),
        );
        let frame = RgbdFrame {
            id: FrameId(i as u32),
            stamp: i as f64,
            depth_stamp: i as f64,
            gray: GrayImage::new(w, h),
            colour: Some(Arc::new(colour)),
            depth: DepthImage::from_vec(w, h, depth.collect())?,
        };
        frames.push((frame, pose));
    }
    let config = DenseConfig {
        voxel,
        ..DenseConfig::default()
    };
    let before = user_seconds()?;
    let mut last: Option<DenseMap> = None;
    for _ in 0..rounds {
        let mut fuser = Fuser::new(&config, &camera, Simd::detect())?;
        for (frame, pose) in &frames {
            fuser.add(frame, &[], pose);
        }
        last = Some(fuser.map().clone());
    }
    let spent = user_seconds()? - before;
    let map = last.ok_or("no rounds")?;
    println!(
        "{:.3} ms of user time per frame ({} frames, {rounds} rounds, voxels of {voxel} m): {} blocks, {} MB",
        1e3 * spent / (frames.len() * rounds) as f64,
        frames.len(),
        map.blocks(),
        map.bytes() / 1_000_000
    );
    Ok(())
}

/// User CPU time of this process, s, from Linux's `/proc`.
fn user_seconds() -> Result<f64, Failure> {
    let text = std::fs::read_to_string("/proc/self/stat")?;
    let rest = text.rsplit(')').next().ok_or("no times")?;
    let ticks: f64 = rest.split_whitespace().nth(11).ok_or("no times")?.parse()?;
    Ok(ticks / 100.0)
}
