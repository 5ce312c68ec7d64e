//! Arguments of `live`: sources that run at camera rate.

use crate::args::run::{LiveChoice, RunArgs, budget_ms};
use crate::args::{ConfigArgs, DetectorArgs, InputArgs};
use crate::sinks::OutputArgs;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Run SLAM at camera rate, with a thread per stage.
#[derive(Debug, Subcommand)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint live realsense --record walk.mcap
  stillpoint live file rgbd_dataset_freiburg1_xyz --all"
)]
pub(crate) enum LiveCommand {
    Realsense(LiveRealsenseArgs),
    File(LiveFileArgs),
}

/// Run on an Intel RealSense camera until Ctrl-C.
///
/// librealsense 2.50 or later is loaded at run time: from the folders of ROS and of the system, or from the file or folder that
/// STILLPOINT_REALSENSE names. Intrinsics and extrinsics are the factory calibration, time stamps are those of the device. When the camera
/// is unplugged, the run waits for it.
///
/// The result folder, its log and the exit codes are those of run, see run --help.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint live realsense
  stillpoint live realsense --serial 923322071234 --record walk.mcap --save-map hall.spmap
  stillpoint live realsense --emitter off --exposure-ms 8 --localize hall.spmap
  stillpoint live realsense --view 192.168.1.7:8080
  stillpoint live realsense --playback d435.bag

Exit codes as those of run."
)]
pub(crate) struct LiveRealsenseArgs {
    /// Serial number of the camera, where several are connected.
    #[arg(long, value_name = "NUMBER")]
    pub(crate) serial: Option<String>,
    /// Have librealsense play one of its own recordings (.bag, .db3) instead of a camera.
    #[arg(long, value_name = "FILE", conflicts_with = "serial")]
    pub(crate) playback: Option<PathBuf>,
    /// Width and height of colour and depth images, px.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size)]
    pub(crate) size: (u32, u32),
    /// Frames per second.
    #[arg(long, value_name = "HZ", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=300))]
    pub(crate) rate: u32,
    /// Projector of the depth camera [default: unchanged].
    #[arg(long, value_name = "WHICH")]
    pub(crate) emitter: Option<Switch>,
    /// Exposure of the colour camera, ms [default: automatic, at most one frame period].
    #[arg(long, value_name = "MS", value_parser = exposure)]
    pub(crate) exposure_ms: Option<f64>,
    /// Do not use the camera's inertial sensor (D435i, D455).
    #[arg(long)]
    pub(crate) no_imu: bool,
    /// End after this many frames.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=u64::from(u32::MAX)))]
    max_frames: Option<u64>,
    /// Write the run log to this file [default: run.log in the result folder].
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Time budget per frame, ms, kept by doing less; the time of each frame is measured.
    #[arg(long, value_name = "N", value_parser = budget_ms)]
    budget_ms: Option<f64>,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
    /// Resume a map written by --save-map: its places are recognised, and it grows.
    #[arg(long, value_name = "FILE", conflicts_with = "localize")]
    load_map: Option<PathBuf>,
    /// Localise in a map written by --save-map; the map does not grow.
    #[arg(long, value_name = "FILE", conflicts_with = "save_map")]
    localize: Option<PathBuf>,
    #[command(flatten)]
    detector: DetectorArgs,
    #[command(flatten)]
    config: ConfigArgs,
}

/// On or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Switch {
    /// On.
    On,
    /// Off.
    Off,
}

/// Parses `640x480`.
fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once('x');
    sides
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)))
        .filter(|(w, h)| (16..=4096).contains(w) && (16..=4096).contains(h))
        .ok_or_else(|| "expected width x height, such as 640x480".to_owned())
}

fn exposure(text: &str) -> Result<f64, String> {
    let ms = text.parse().ok();
    ms.filter(|ms| (0.1..=1000.0).contains(ms))
        .ok_or_else(|| "expected 0.1 to 1000 milliseconds".to_owned())
}

impl LiveRealsenseArgs {
    /// The equivalent arguments of `run`.
    pub(crate) fn as_run(&self) -> RunArgs {
        RunArgs {
            // Names the result folder.
            path: PathBuf::from("realsense"),
            live: Some(LiveChoice::Newest),
            log: self.log.clone(),
            budget_ms: self.budget_ms,
            output: self.output.clone(),
            load_map: self.load_map.clone(),
            localize: self.localize.clone(),
            input: InputArgs {
                max_frames: self.max_frames,
                detector: self.detector.clone(),
                ..InputArgs::default()
            },
            config: self.config.clone(),
        }
    }
}

/// Play a recording or data set folder as a camera.
///
/// Frames arrive at their time stamps; tracking, detection, mapping and loop closing run on separate threads. Same as run PATH --live: the
/// result folder, its log and the exit codes are those of run, see run --help.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint live file walk.mcap
  stillpoint live file rgbd_dataset_freiburg1_xyz --all --out result
  stillpoint live file d435.bag --save-map desk.spmap --trace trace.json

Exit codes as those of run."
)]
pub(crate) struct LiveFileArgs {
    /// Data set folder or recording.
    #[arg(value_name = "FILE")]
    path: PathBuf,
    /// Track every frame: when tracking is late, later frames wait. Without this option such a frame is dropped and counted.
    #[arg(long)]
    all: bool,
    /// Write the run log to this file [default: run.log in the result folder].
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Time budget per frame, ms, kept by doing less; the time of each frame is measured.
    #[arg(long, value_name = "N", value_parser = budget_ms)]
    budget_ms: Option<f64>,
    #[command(flatten)]
    output: OutputArgs,
    /// Resume a map written by --save-map: its places are recognised, and it grows.
    #[arg(long, value_name = "FILE", conflicts_with = "localize")]
    load_map: Option<PathBuf>,
    /// Localise in a map written by --save-map; the map does not grow.
    #[arg(long, value_name = "FILE", conflicts_with = "save_map")]
    localize: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    config: ConfigArgs,
}

impl LiveFileArgs {
    /// The equivalent arguments of `run`, so that both share one code path.
    pub(crate) fn as_run(&self) -> RunArgs {
        let choice = if self.all {
            LiveChoice::All
        } else {
            LiveChoice::Newest
        };
        RunArgs {
            path: self.path.clone(),
            live: Some(choice),
            log: self.log.clone(),
            budget_ms: self.budget_ms,
            output: self.output.clone(),
            load_map: self.load_map.clone(),
            localize: self.localize.clone(),
            input: self.input.clone(),
            config: self.config.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::args::live::LiveCommand;
    use crate::args::{Arguments, Command};
    use clap::Parser;

    #[test]
    fn live_file_equals_run_live() {
        let rest = "room --log a.log --budget-ms 20 --out o --load-map m --start 3 --seed 7";
        for (live, run) in [("", "--live"), ("--all", "--live=all")] {
            let parse = |line: String| Arguments::try_parse_from(line.split_whitespace()).unwrap();
            let file = parse(format!("stillpoint live file {rest} {live}"));
            let Command::Live(LiveCommand::File(file)) = file.command else {
                panic!("expected live file");
            };
            let run = parse(format!("stillpoint run {rest} {run}"));
            let Command::Run(run) = run.command else {
                panic!("expected run");
            };
            assert_eq!(format!("{:?}", file.as_run()), format!("{run:?}"));
        }
    }
}
