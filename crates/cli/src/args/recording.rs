//! Arguments of `recording`.

use crate::args::TopicArgs;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Look into recordings and convert them.
#[derive(Debug, Subcommand)]
#[command(after_help = "Examples:
  stillpoint recording info walk.mcap
  stillpoint recording convert walk.bag walk")]
pub(crate) enum RecordingCommand {
    Info(RecordingInfoArgs),
    Convert(RecordingConvertArgs),
}

/// Print what is in a recording: topics, types, messages, and what a run would take for its camera.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint recording info walk.mcap
  stillpoint recording info rosbag2_2026_05_04 --json

Exit code 2 when it is no recording, or cannot be read."
)]
pub(crate) struct RecordingInfoArgs {
    /// Recording: MCAP, folder or data base of rosbag2, or ROS 1 bag.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    /// Print it as JSON.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
}

/// Write the frames of a recording or data set as MCAP or as a data set folder.
///
/// A name that ends with .mcap becomes an MCAP file: raw colour, depth in metres, camera and ground truth, without loss. Any
/// other name becomes a folder in the TUM layout, whose depth has 5000 values per metre and ends at 13.1 m.
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
    /// File or folder to write; nothing may be there yet.
    #[arg(value_name = "OUT")]
    pub(crate) out: PathBuf,
    /// Camera file or preset [default: as for run].
    #[arg(long, value_name = "FILE|PRESET")]
    pub(crate) camera: Option<String>,
    /// Leave out this many frames at the start.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) start: usize,
    /// Write at most this many frames.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=u64::from(u32::MAX)))]
    pub(crate) max_frames: Option<u64>,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
}
