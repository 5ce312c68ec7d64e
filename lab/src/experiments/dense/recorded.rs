//! The surface of a recording at its true poses.

use crate::Failure;
use crate::experiments::shared::pose_at;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use stillpoint::datasets::FrameOptions;
use stillpoint::dense::{Dense, DenseConfig, FinalPose, MeshOptions};
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::recordings;
use stillpoint::slam::{Config, Subscriber, System};

/// Runs on a recording, and fuses its frames at the true poses.
pub(super) fn fuse(folder: &Path, file: &Path) -> Result<(), Failure> {
    let input = recordings::open(folder, &Default::default())?;
    let truth = input.ground_truth()?.ok_or("no ground truth")?;
    let camera = input.camera().camera;
    let mut system = System::new(Config::default(), camera, Simd::detect())?;
    let mut dense = Dense::new(&DenseConfig::default(), &camera, Simd::detect())?;
    let mut poses = Vec::new();
    let mut frames = input.frames(&FrameOptions {
        start: 0,
        max_frames: None,
        keep_colour: true,
    })?;
    while let Some(frame) = frames.next_frame() {
        let frame = frame?;
        let pose = pose_at(&truth, frame.stamp);
        poses.extend(pose.map(|world_from_camera| FinalPose {
            frame: frame.id,
            stamp: frame.stamp,
            world_from_camera,
        }));
        dense.receive_all(&system.step(frame));
    }
    dense.receive_all(&system.finish());
    let mesh = dense.finish(&poses).mesh(&MeshOptions::default());
    println!("{} triangles, {:.2} m2", mesh.triangles.len(), mesh.area());
    mesh.write_ply(&mut BufWriter::new(File::create(file)?))?;
    Ok(())
}
