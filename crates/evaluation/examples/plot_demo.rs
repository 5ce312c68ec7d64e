//! Draws the figures of a made-up trajectory into a folder: `plot_demo DIR`.

use std::error::Error;
use std::path::PathBuf;
use stillpoint_evaluation::plot::{
    Series, drift_figure, poses_figure, timing_figure, trajectory_figure,
};
use stillpoint_evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint_geometry::{Se3, Vec3, so3};

fn main() -> Result<(), Box<dyn Error>> {
    let dir = PathBuf::from(std::env::args().nth(1).ok_or("expected a folder")?);
    let at = |i: usize, noise: f64| {
        let s = i as f64 / 30.0;
        let wobble = noise * libm::sin(3.7 * s) * libm::sin(0.4 * s + 11.0 * noise * s);
        let p = Vec3::new(
            1.6 * libm::sin(0.9 * s) + wobble,
            0.25 * libm::cos(1.3 * s),
            1.1 * libm::cos(0.55 * s) - 0.7 * wobble,
        );
        TimedPose {
            stamp: 100.0 + s,
            world_from_camera: Se3::new(so3::exp(&Vec3::zeros()), p),
        }
    };
    let truth: Vec<TimedPose> = (0..600).map(|i| at(i, 0.0)).collect();
    let estimate: Vec<TimedPose> = (0..600)
        .filter(|i| !(300..340).contains(i))
        .map(|i| at(i, 0.02))
        .collect();
    let evaluation = evaluate(&truth, &estimate, &EvalOptions::default())?;
    let figure = trajectory_figure("made-up trajectory", &evaluation.ate);
    std::fs::write(dir.join("trajectory.svg"), figure.to_svg())?;
    std::fs::write(dir.join("trajectory.png"), figure.to_png()?)?;
    std::fs::write(
        dir.join("poses.png"),
        poses_figure("no ground truth", &estimate).to_png()?,
    )?;
    std::fs::write(
        dir.join("drift.png"),
        drift_figure("fixed camera", &estimate).to_png()?,
    )?;
    let track: Vec<f64> = (0..600u32)
        .map(|i| 9.0 + f64::from(i.wrapping_mul(2_654_435_761) >> 24) / 60.0)
        .collect();
    let map: Vec<f64> = (0..600u32)
        .map(|i| if i % 12 == 0 { 30.0 } else { f64::NAN })
        .map(|v: f64| if v.is_nan() { 0.5 } else { v })
        .collect();
    let figure = timing_figure(
        "Time per frame",
        &[
            Series {
                name: "tracking",
                milliseconds: &track,
            },
            Series {
                name: "mapping",
                milliseconds: &map,
            },
        ],
    );
    std::fs::write(dir.join("timing.svg"), figure.to_svg())?;
    std::fs::write(dir.join("timing.png"), figure.to_png()?)?;
    Ok(())
}
