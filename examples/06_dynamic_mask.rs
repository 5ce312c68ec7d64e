//! Which pixels move? The static filter without SLAM, for use with another SLAM system: frames and boxes in, masks and verdicts out.
//!
//! `cargo run --release -p stillpoint --example 06_dynamic_mask -- [FOLDER]` writes the masks to a folder; moving pixels are 255.

use std::error::Error;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use stillpoint::detection::{BoundingBox, ClassId, Detection, Detections};
use stillpoint::imaging::{RgbdFrame, Simd};
use stillpoint::simulator::{DetectionNoise, Simulator, SimulatorConfig};
use stillpoint::slam::{Config, DynamicMask};
use stillpoint::view::write_mask;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    let room = Simulator::new(&SimulatorConfig {
        scene: "walking_xyz".to_owned(),
        frames: Some(60),
        ..SimulatorConfig::default()
    })?;
    let mut filter = DynamicMask::new(&Config::default(), *room.camera(), Simd::detect())?;
    let mut out = std::io::stdout().lock();
    for i in 0..room.len() {
        let frame = Arc::new(room.frame(i));
        // Boxes are optional, and may be some frames late.
        filter.detections(boxes(&room, &frame));
        // Your own pose, instead of `None`, replaces the filter's estimate of the camera's motion.
        let moving = filter.step(&frame, None)?;
        let mask = moving.mask();

        // Keypoints of your own system.
        let keypoints = [[320.0, 240.0], [100.0, 400.0]];
        let verdicts = filter.verdicts(&keypoints);
        let rejected = verdicts.iter().filter(|v| v.dynamic).count();
        if i % 10 == 0 {
            let moving_px = mask.data().iter().filter(|v| **v > 0).count();
            let share = 100.0 * moving_px as f64 / mask.data().len() as f64;
            write!(out, "{:.2} s: {share:.1} % moves, ", frame.stamp)?;
            writeln!(out, "{rejected} of {} keypoints", keypoints.len())?;
            for o in moving.objects.iter() {
                writeln!(out, "  {} {}: {:?}", o.class, o.id.0, o.motion)?;
            }
        }
        if let Some(folder) = &folder {
            std::fs::create_dir_all(folder)?;
            write_mask(
                &mask,
                std::fs::File::create(folder.join(format!("{:.6}.png", frame.stamp)))?,
            )?;
        }
    }
    Ok(())
}

/// Detections of a frame, here simulated ones.
fn boxes(room: &Simulator, frame: &RgbdFrame) -> Detections {
    let found = room.detections(frame.id.0 as usize, &DetectionNoise::default());
    let detection = |d: &stillpoint::simulator::ScriptedDetection| {
        let (x0, y0, x1, y1) = (d.x0, d.y0, d.x1, d.y1);
        Some(Detection {
            class: ClassId::from_name(d.class)?,
            score: d.score,
            bounds: BoundingBox { x0, y0, x1, y1 },
        })
    };
    Detections {
        frame: frame.id,
        stamp: frame.stamp,
        items: found.iter().filter_map(detection).collect(),
    }
}
