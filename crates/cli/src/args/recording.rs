//! Arguments of `recording`.

use crate::args::TopicArgs;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Inspect, convert and cut recordings.
#[derive(Debug, Subcommand)]
#[command(after_help = "Examples:
  stillpoint recording info walk.mcap
  stillpoint recording convert walk.bag walk
  stillpoint recording cut walk.mcap part.mcap --start-time 10 --end-time 25")]
pub(crate) enum RecordingCommand {
    Info(RecordingInfoArgs),
    Convert(RecordingConvertArgs),
    Cut(RecordingCutArgs),
}

/// List the topics, types and message counts of a recording, and the topics that a run would use.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint recording info walk.mcap
  stillpoint recording info rosbag2_2026_05_04 --json

Exit code 2 when it is no recording, or cannot be read."
)]
pub(crate) struct RecordingInfoArgs {
    /// Recording: MCAP, rosbag2 folder or database, or ROS 1 bag.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
}

/// Write the frames of a recording or data set as MCAP or as a data set folder.
///
/// A name that ends with .mcap gives an MCAP file: raw colour, depth in metres, camera and ground truth, lossless. Any other name gives a
/// folder in the TUM layout, whose depth has 5000 values per metre and ends at 13.1 m.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint recording convert rgbd_dataset_freiburg1_xyz xyz.mcap
  stillpoint recording convert walk.bag walk --truth-topic /odom

Exit code 1 when frames could not be read and were left out; 2 when the input cannot be used, or the output not be written."
)]
pub(crate) struct RecordingConvertArgs {
    /// Recording or data set folder.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    /// File or folder to write; must not exist yet.
    #[arg(value_name = "OUT")]
    pub(crate) out: PathBuf,
    /// Camera file or preset [default: as for run].
    #[arg(long, value_name = "FILE|PRESET")]
    pub(crate) camera: Option<String>,
    /// Skip this many frames at the start.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) start: usize,
    /// Write at most this many frames.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=u64::from(u32::MAX)))]
    pub(crate) max_frames: Option<u64>,
    /// Print a summary of the output as JSON.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
}

/// Write a part of a recording or data set as MCAP.
///
/// The part is given by time, by frames, or by one of each. The output is that of convert: raw colour, depth in metres, camera and ground
/// truth of the part, lossless; other topics are left out.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint recording cut walk.mcap part.mcap --start-time 10 --end-time 25
  stillpoint recording cut walk.bag part.mcap --start 300 --max-frames 100

Exit code 1 when frames could not be read and were left out; 2 when the input cannot be used, the part has no frames, or the
output cannot be written."
)]
pub(crate) struct RecordingCutArgs {
    /// Recording or data set folder.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    /// MCAP file to write; must not exist yet.
    #[arg(value_name = "OUT")]
    pub(crate) out: PathBuf,
    /// Begin at the first frame at least this many seconds after the first of the recording.
    #[arg(long, value_name = "S", conflicts_with = "start", value_parser = seconds)]
    pub(crate) start_time: Option<f64>,
    /// End before the first frame at least this many seconds after the first of the recording.
    #[arg(long, value_name = "S", conflicts_with = "max_frames", value_parser = seconds)]
    pub(crate) end_time: Option<f64>,
    /// Skip this many frames at the start.
    #[arg(long, value_name = "N")]
    pub(crate) start: Option<usize>,
    /// Write at most this many frames.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=u64::from(u32::MAX)))]
    pub(crate) max_frames: Option<u64>,
    /// Camera file or preset [default: as for run].
    #[arg(long, value_name = "FILE|PRESET")]
    pub(crate) camera: Option<String>,
    /// Print a summary of the output as JSON.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
}

fn seconds(text: &str) -> Result<f64, String> {
    let value = text
        .parse()
        .ok()
        .filter(|s: &f64| s.is_finite() && *s >= 0.0);
    value.ok_or_else(|| "expected seconds, at least 0".to_owned())
}
