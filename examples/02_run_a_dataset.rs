//! Converts a data set folder to a trajectory file.
//!
//! `cargo run --release -p stillpoint --example 02_run_a_dataset -- FOLDER [TRAJECTORY]`

use std::error::Error;
use std::io::Write;
use std::path::Path;
use stillpoint::datasets::{
    Dataset, FrameOptions, OpenOptions, ReadAhead, StampedPose, trajectory,
};
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::slam::{Config, System};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let folder = args.next().ok_or("expected a data set folder")?;
    let target = args.next().unwrap_or_else(|| "trajectory.txt".to_owned());

    // Layout and camera are guessed; check the printed guesses.
    let dataset = Dataset::open(Path::new(&folder), &OpenOptions::default())?;
    let mut out = std::io::stdout().lock();
    for guess in dataset.guesses() {
        writeln!(out, "{guess}")?;
    }
    let camera = dataset.camera().camera;
    let mut system = System::new(Config::default(), camera, Simd::detect())?;

    // Images are read and decoded in a separate thread.
    let mut frames = ReadAhead::new(dataset.frames(&FrameOptions::default())?);
    while let Some(frame) = frames.next_frame() {
        match frame {
            Ok(frame) => drop(system.step(frame)),
            Err(e) if e.recoverable => writeln!(out, "skipped: {e}")?,
            Err(e) => return Err(e.into()),
        }
    }
    system.finish();

    // Poses are stored relative to keyframes, so the final map gives the final poses.
    let view = system.view();
    let poses: Vec<StampedPose> = system
        .trajectory()
        .resolve(&view)
        .map(|(entry, world_from_camera)| StampedPose {
            stamp: entry.stamp,
            world_from_camera,
        })
        .collect();
    trajectory::write(Path::new(&target), &poses)?;
    writeln!(out, "{} poses in {target}", poses.len())?;
    Ok(())
}
