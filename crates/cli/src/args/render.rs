//! Arguments of `render`.

use crate::args::positive;
use clap::Args;
use std::path::PathBuf;

/// Make an animation of a run.
///
/// On the left the camera image, with moving regions tinted, used features in green and rejected ones in red; on the right the growing
/// surface with the trajectory, the true one where it is known, and those given by --also, each with its ATE. The run is repeated from the
/// log in its result folder, so its input must still exist. The file extension selects the format: .webp and .gif are animated, .png is the
/// last image.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint render out/desk -o desk.webp
  stillpoint render out/walking -o walking.gif --max-mb 2
  stillpoint render out/walking -o walking.webp --also ORB-SLAM3=orbslam3.txt --also without=out/off/trajectory.txt
  stillpoint render out/demo -o demo.png

Exit code 1 when the picture does not fit into --max-mb, when Ctrl-C ended it, or when the input is not that of the run;
2 when the folder, the input, a trajectory or the file cannot be used."
)]
pub(crate) struct RenderArgs {
    /// Result folder of run, live or demo.
    #[arg(value_name = "RESULT")]
    pub(crate) result: PathBuf,
    /// File to write: .webp, .gif or .png.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Data set folder or recording of the run [default: its path at that time].
    #[arg(long, value_name = "PATH")]
    pub(crate) input: Option<PathBuf>,
    /// Another trajectory and its name, TUM format; aligned by a rigid motion. May be given several times.
    #[arg(long, value_name = "NAME=FILE", value_parser = also)]
    pub(crate) also: Vec<Also>,
    /// Maximum file size, MB (10^6 bytes); kept by fewer and smaller images.
    #[arg(long, value_name = "MB", default_value_t = 3.0, value_parser = positive)]
    pub(crate) max_mb: f64,
}

/// Another trajectory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Also {
    pub(crate) name: String,
    pub(crate) file: PathBuf,
}

fn also(text: &str) -> Result<Also, String> {
    match text.split_once('=') {
        Some((name, file)) if !name.trim().is_empty() && !file.is_empty() => Ok(Also {
            name: name.trim().to_owned(),
            file: PathBuf::from(file),
        }),
        _ => Err("expected a name, = and a file, such as ORB-SLAM3=trajectory.txt".to_owned()),
    }
}
