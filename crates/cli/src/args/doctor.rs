//! Arguments of `doctor`.

use crate::args::TopicArgs;
use clap::Args;
use std::path::PathBuf;

/// Check a few seconds of a recording, and explain problems and their remedies.
///
/// In order of severity: lens model, depth scale, mirrored images, registration of depth to colour, focal length, synchronisation, time
/// stamps, frozen images, exposure, blur, depth holes, dropped frames; then, if there are any, inertial sensor and wheel odometry.
/// Checks that these seconds do not allow, such as that of the focal length while the camera does not turn, are listed as not judged.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint doctor rgbd_dataset_freiburg1_xyz
  stillpoint doctor walk.mcap --start 300 --seconds 5
  stillpoint doctor recording --camera camera.toml --json
  stillpoint doctor live --start 30

Exit code 1 when something is wrong; 2 when the input cannot be used."
)]
pub(crate) struct DoctorArgs {
    /// Data set folder or recording, or live for the connected RealSense camera: see live realsense --help.
    #[arg(value_name = "PATH|live")]
    pub(crate) path: PathBuf,
    /// With live: have librealsense play one of its own recordings (.bag, .db3) instead of a camera.
    #[arg(long, value_name = "FILE")]
    pub(crate) playback: Option<PathBuf>,
    /// Camera file or preset [default: as for run].
    #[arg(long, value_name = "FILE|PRESET")]
    pub(crate) camera: Option<String>,
    /// Skip this many frames at the start.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) start: usize,
    /// Duration to check, s: 0.5 to 30.
    #[arg(long, value_name = "S", default_value_t = 3.0, value_parser = seconds)]
    pub(crate) seconds: f64,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
}

fn seconds(text: &str) -> Result<f64, String> {
    let value = text.parse().ok();
    value
        .filter(|s: &f64| (0.5..=30.0).contains(s))
        .ok_or_else(|| "expected 0.5 to 30 s".to_owned())
}
