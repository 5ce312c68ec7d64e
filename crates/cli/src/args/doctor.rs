//! Arguments of `doctor`.

use crate::args::TopicArgs;
use clap::Args;
use std::path::PathBuf;

/// Look at a few seconds of a recording and say what is wrong with it and what to do.
///
/// In order of harm: lens model, depth scale, mirrored images, registration of depth to colour, focal length, synchronisation,
/// stamps, images that stand still, exposure, blur, holes in the depth, dropped frames. What these seconds do not show, such as
/// the focal length while the camera does not turn, is listed as not judged.
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
    /// Data set folder or recording, or live: the RealSense camera that is connected, see live realsense --help.
    #[arg(value_name = "PATH|live")]
    pub(crate) path: PathBuf,
    /// With live: have librealsense play a recording of its own (.bag, .db3) in place of a camera.
    #[arg(long, value_name = "FILE")]
    pub(crate) playback: Option<PathBuf>,
    /// Camera file or preset [default: as for run].
    #[arg(long, value_name = "FILE|PRESET")]
    pub(crate) camera: Option<String>,
    /// Leave out this many frames at the start.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) start: usize,
    /// How much to look at, s: 0.5 to 30.
    #[arg(long, value_name = "S", default_value_t = 3.0, value_parser = seconds)]
    pub(crate) seconds: f64,
    /// Print it as JSON.
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
