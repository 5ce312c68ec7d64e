//! Arguments of the commands that run the system on a data set.

use crate::args::{ConfigArgs, InputArgs};
use crate::sinks::OutputArgs;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Which frames of a live run are tracked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LiveChoice {
    /// A late frame is dropped in favour of the next one.
    Newest,
    /// All.
    All,
}

impl LiveChoice {
    /// The name on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Newest => "newest",
            Self::All => "all",
        }
    }
}

/// Run SLAM on a data set folder or a recording.
///
/// The layout of a folder (TUM, Bonn, ICL-NUIM, 7-Scenes), the topics of a recording (MCAP, rosbag2, ROS 1 bag) and the camera are guessed,
/// and each guess is printed. With ground truth the score is printed too.
///
/// The result folder holds trajectory.txt (final poses of all frames that were not lost; TUM format),
/// trajectory_covariance.txt and trajectory_covariance_in_map.txt (their uncertainty), trajectory_online.txt (the poses as known at each
/// frame), keyframes.txt, config.toml (the resolved configuration), summary.json, report.html (an interactive page of all this: see report
/// --help), and plots. An older result in the folder is replaced only when the run has ended. Ctrl-C ends the run after the current frame
/// and writes its results; a second Ctrl-C ends it at once.
///
/// With --live the data set is played as a camera: frames arrive at their time stamps, and tracking, detection, mapping and loop closing
/// run on separate threads.
///
/// run.log in the result folder records the order in which the stages took their messages, which depends on threads and clocks in a live
/// run, and the detections: see replay --help.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint run rgbd_dataset_freiburg1_xyz
  stillpoint run walk.mcap
  stillpoint run two_cameras.bag --color-topic /front/color/image_raw --truth-topic /odom
  stillpoint run recording --camera camera.toml --out result
  stillpoint run rgbd_dataset_freiburg3_long_office_household --start 100 --max-frames 500
  stillpoint run recording --camera tum_fr1 --config my.toml --set tracking.min_inliers=40
  stillpoint run recording --detector yolox_nano_416.onnx --verdicts verdicts.csv
  stillpoint run recording --overlay pictures --overlay-every 3
  stillpoint run recording --save-map desk.spmap
  stillpoint run another --load-map desk.spmap --save-map desk.spmap
  stillpoint run another --localize desk.spmap
  stillpoint run recording --dense --save-map desk.spmap
  stillpoint run recording --dense --things --save-map desk.spmap
  stillpoint run recording --set static_filter.preset=off
  stillpoint run recording --json
  stillpoint run recording --live --trace trace.json
  stillpoint run recording --live=all
  stillpoint run recording --live --view

Exit code 1 when a frame was lost, more than one in ten could not be read, fewer than two poses were found,
Ctrl-C ended the run, or a thread of a live run did not come to its end (frames that a live run dropped are
no reason); 2 when the input cannot be used, or the output folder, or another file to be written."
)]
pub(crate) struct RunArgs {
    /// Data set folder or recording.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    /// Play the data set as a camera. A frame that tracking has not taken when the next one arrives is dropped and counted; with --live=all
    /// tracking takes every frame, and later frames wait when it is late.
    #[arg(
        long,
        value_name = "newest|all",
        value_enum,
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "newest",
        hide_possible_values = true,
        verbatim_doc_comment
    )]
    pub(crate) live: Option<LiveChoice>,
    /// Write the run log to this file [default: run.log in the result folder].
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Option<PathBuf>,
    /// Time budget per frame, ms, kept by doing less: fewer keypoints, less mapping, and fewer detector calls. A live run measures the time
    /// of each frame; any other run plans with a fixed table, and gives the same result on every machine.
    #[arg(long, value_name = "N", value_parser = budget_ms, verbatim_doc_comment)]
    pub(crate) budget_ms: Option<f64>,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
    /// Resume a map written by --save-map: its places are recognised, and it grows.
    #[arg(long, value_name = "FILE", conflicts_with = "localize")]
    pub(crate) load_map: Option<PathBuf>,
    /// Localise in a map written by --save-map, in that map's frame of reference. The map is only read: it does not grow.
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with = "save_map",
        verbatim_doc_comment
    )]
    pub(crate) localize: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) input: InputArgs,
    #[command(flatten)]
    pub(crate) config: ConfigArgs,
}

/// Parses a time per frame, ms.
pub(crate) fn budget_ms(text: &str) -> Result<f64, String> {
    let ms = text.parse().ok();
    ms.filter(|ms| (1.0..=1000.0).contains(ms))
        .ok_or_else(|| "expected 1 to 1000 milliseconds".to_owned())
}

/// Repeat a run, bit for bit.
///
/// LOG is the run.log that a run left, live or not, and PATH its data set. The stages take the same frames, detections and messages in the
/// same order as in that run, independent of threads and clocks: trajectories, frames.csv and the map are the same to the byte, provided
/// that data set, loaded map and program are. Configuration, camera and map file are those in the log, unless others are given. No detector
/// is needed: its output is in the log.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint replay out/recording/run.log recording
  stillpoint replay out/recording/run.log recording --verdicts verdicts.csv --overlay pictures
  stillpoint replay run.log /data/recording --load-map maps/desk.spmap --save-map again.spmap

Exit code 1 as that of run, and when another trajectory came out;
2 when the log or the input cannot be used, or does not belong together."
)]
pub(crate) struct ReplayArgs {
    /// Log of a run.
    #[arg(value_name = "LOG")]
    pub(crate) log: PathBuf,
    /// Data set folder or recording.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
    /// New path of the map that the run resumed.
    #[arg(long, value_name = "FILE", conflicts_with = "localize")]
    pub(crate) load_map: Option<PathBuf>,
    /// New path of the map that the run localised in.
    #[arg(long, value_name = "FILE", conflicts_with = "save_map")]
    pub(crate) localize: Option<PathBuf>,
    /// Camera file or preset [default: as in the run].
    #[arg(long, value_name = "FILE|PRESET")]
    pub(crate) camera: Option<String>,
    #[command(flatten)]
    pub(crate) config: ConfigArgs,
}
