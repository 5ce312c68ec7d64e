//! Arguments of the commands that use the simulator: `demo` and `simulate`.

use crate::args::ConfigArgs;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Source of the demo's detections.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DemoDetector {
    /// The simulator's own.
    Simulated,
    /// No detector.
    None,
}

/// Simulate a room with people in it, run SLAM on it without and with the static filter, and compare.
///
/// Needs no input and no download. Writes demo.webp to the result folder: the camera image, the surface as it grows without the people, and
/// both trajectories. The results, as those of `run`, are in off/ and on/ beside it, and so are side_by_side.png, animation.gif,
/// comparison.svg and .png. With -v a table has every figure of both.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint demo
  stillpoint demo --detector none
  stillpoint demo --scene walking_halfsphere --frames 600 --out /tmp/demo
  stillpoint demo --set static_filter.preset=paper

Exit code 1 when the run with the filter lost a frame or exceeds its bound: 10 mm with detections, 15 mm without;
or when Ctrl-C ended it."
)]
pub(crate) struct DemoArgs {
    /// Scene to simulate: any of those of simulate.
    #[arg(long, value_name = "NAME", default_value = "walking_xyz")]
    pub(crate) scene: String,
    /// Source of detections: the simulator, with 30 % missing, or none.
    #[arg(
        long,
        value_name = "simulated|none",
        value_enum,
        default_value = "simulated",
        hide_possible_values = true
    )]
    pub(crate) detector: DemoDetector,
    /// Number of frames (30 per second).
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..=u64::from(u32::MAX)))]
    pub(crate) frames: u64,
    /// Result folder.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) config: ConfigArgs,
}

/// Write a simulated data set with exact ground truth, in the TUM layout.
///
/// Where something moves, mask/ labels the pixels of each mover (0: none), boxes.csv holds their bounding boxes
/// (timestamp,mover,x0,y0,x1,y1,visible_px) with position (m) and velocity (m/s) in the world (px,py,pz,vx,vy,vz), and detections.csv holds
/// simulated detections of a small network (30 % missed, borders off by 4 px), for run --detector scripted:FILE.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint simulate --scene xyz --out xyz
  stillpoint simulate --scene halfsphere --frames 60 --seed 7 --jpeg --out small
  stillpoint simulate --scene walking_xyz --out walking
  stillpoint run walking --detector scripted:walking/detections.csv
  stillpoint simulate --scene xyz --furniture --out desk
  stillpoint simulate --scene blocked_turn --imu --out blocked
  stillpoint simulate --scene blocked_turn --odometry --slip 4 --out wheels
  stillpoint simulate --scene rpy_150 --readout 0 --exposure 0 --out sharp"
)]
pub(crate) struct SimulateArgs {
    #[arg(long, value_name = "NAME", help = scenes_in_words())]
    pub(crate) scene: String,
    /// New or empty folder to write to.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Number of frames (30 per second) [default: the scene's own length].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=u64::from(u32::MAX)))]
    pub(crate) frames: Option<u64>,
    /// Seed of room, textures and noise.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Ideal images: no noise, no holes, no exposure change; no missed detections.
    #[arg(long)]
    pub(crate) ideal: bool,
    /// Include furniture in detections.csv: chairs, desks (dining table), screens (tv), keyboards, books and cups. Without this option it
    /// holds people only, and is written only for scenes in which something moves.
    #[arg(long, verbatim_doc_comment)]
    pub(crate) furniture: bool,
    /// Add an inertial sensor, a Bosch BMI055 at 200 Hz: imu.csv, and its mounting in camera.toml.
    #[arg(long)]
    pub(crate) imu: bool,
    /// Add wheel odometry of a base that carries the camera, at 50 Hz: odometry.csv, and the camera's pose on the base in camera.toml.
    #[arg(long, verbatim_doc_comment)]
    pub(crate) odometry: bool,
    /// Time at which the wheels spin for half a second, at 0.5 m/s and without moving the base, s; may be given several times.
    #[arg(long, value_name = "S", requires = "odometry")]
    pub(crate) slip: Vec<f64>,
    /// Write colour images as JPEG instead of PNG: a third of the size.
    #[arg(long)]
    pub(crate) jpeg: bool,
    /// Rolling shutter: readout time of the colour image, first row to last, s [default: the scene's own].
    #[arg(long, value_name = "S")]
    pub(crate) readout: Option<f64>,
    /// Readout time of the depth image, s [default: the scene's own].
    #[arg(long, value_name = "S")]
    pub(crate) depth_readout: Option<f64>,
    /// Motion blur: exposure time of each row of the colour image, s [default: the scene's own].
    #[arg(long, value_name = "S")]
    pub(crate) exposure: Option<f64>,
    /// Depth error model: independent noise per pixel, or a structured-light camera [default: the scene's own].
    #[arg(long, value_name = "MODEL", value_parser = ["independent", "structured-light"])]
    pub(crate) depth_model: Option<String>,
}

/// Help text of `--scene`: all scenes, in lines of at most a hundred characters.
fn scenes_in_words() -> String {
    let mut lines = vec![
        "Scene; people are in walking_*, crowd_*, sitting_*, *_carried and blocked_*. One of"
            .to_owned(),
    ];
    let names = stillpoint::simulator::scene_names();
    for (i, name) in names.iter().enumerate() {
        let word = match i + 1 {
            n if n == names.len() => format!("{name}."),
            _ => format!("{name},"),
        };
        match lines.last_mut() {
            Some(line) if line.len() + word.len() < 90 => *line += &format!(" {word}"),
            _ => lines.push(word),
        }
    }
    lines.join("\n")
}
