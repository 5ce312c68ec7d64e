//! Arguments of `eval`.

use crate::args::positive;
use clap::Args;
use std::path::PathBuf;
use stillpoint::evaluation::Delta;

/// Score a trajectory against ground truth (ATE and RPE), and tracked objects.
///
/// Both trajectories are in the TUM format: timestamp tx ty tz qx qy qz qw. Poses within 0.02 s are associated. Instead of a ground truth
/// file, give a data set folder, or a recording with the --truth-topic of its poses. ATE is computed after alignment by SE(3), with --scale
/// by Sim(3). RPE is computed over --delta: seconds as the TUM script with a fixed delta, or frames as evo over all pairs.
///
/// Time stamps in ms, us or ns are recognised, and so is EuRoC's data.csv. A message is printed where another clock offset fits far better;
/// --time-offset applies an offset, --find-offset the best one.
///
/// --objects compares the table of run --objects with boxes.csv by HOTA, MOTA and IDF1, as trackeval does, and reports the speeds of tracks
/// by class. Tracks that were seen only once are not counted. With both trajectories, velocities and positions are compared too, not speeds
/// alone.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint eval groundtruth.txt out/desk/trajectory.txt
  stillpoint eval groundtruth.txt trajectory.txt --delta 30f --json
  stillpoint eval groundtruth.txt trajectory.txt --plot errors.svg
  stillpoint eval groundtruth.txt trajectory.txt --time-offset -0.25
  stillpoint eval desk.bag out/desk/trajectory.txt --truth-topic /vrpn/camera/pose
  stillpoint eval --objects objects.csv walking/boxes.csv
  stillpoint eval groundtruth.txt trajectory.txt --objects objects.csv boxes.csv --json"
)]
pub(crate) struct EvalArgs {
    /// Ground truth: TUM format, or a data set folder or recording that contains it.
    #[arg(
        value_name = "GROUNDTRUTH",
        required_unless_present = "objects",
        requires = "estimate"
    )]
    pub(crate) ground_truth: Option<PathBuf>,
    /// Estimated trajectory, TUM format.
    #[arg(value_name = "ESTIMATE", required_unless_present = "objects")]
    pub(crate) estimate: Option<PathBuf>,
    /// Topic of ground truth poses or odometry in a recording [default: that of recordings by Stillpoint].
    #[arg(
        long,
        value_name = "TOPIC",
        requires = "ground_truth",
        verbatim_doc_comment
    )]
    pub(crate) truth_topic: Option<String>,
    /// Align with scale: Sim(3) instead of SE(3).
    #[arg(long)]
    pub(crate) scale: bool,
    /// Offset that is added to the time stamps of the estimate, s.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        value_parser = offset,
        requires = "ground_truth"
    )]
    pub(crate) time_offset: f64,
    /// Find the time offset at which the estimate fits best, and score with it.
    #[arg(long, requires = "ground_truth", conflicts_with = "time_offset")]
    pub(crate) find_offset: bool,
    /// Interval of RPE: seconds (1s) or frames (30f).
    #[arg(long, value_name = "DELTA", default_value = "1s")]
    pub(crate) delta: Delta,
    /// Print JSON (metres, degrees) instead of a table.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write a plot: top view coloured by error, x/y/z and error over time. SVG or PNG, by the file extension.
    #[arg(long, value_name = "FILE.svg|png", requires = "ground_truth")]
    pub(crate) plot: Option<PathBuf>,
    /// Table of run --objects, and the true boxes of moving objects; without the boxes only statistics of the tracks themselves.
    #[arg(long, num_args = 1..=2, value_names = ["TRACKS.csv", "BOXES.csv"])]
    pub(crate) objects: Option<Vec<PathBuf>>,
    #[command(flatten)]
    pub(crate) object_options: ObjectEvalArgs,
}

/// How tracks are compared with boxes.
#[derive(Debug, Args)]
pub(crate) struct ObjectEvalArgs {
    /// Class of the tracks that are compared with the boxes.
    #[arg(
        long,
        value_name = "NAME",
        default_value = "person",
        requires = "objects"
    )]
    pub(crate) class: String,
    /// Boxes of objects that are not in the list of movers, as a table like boxes.csv: tracks there are not counted.
    #[arg(long, value_name = "FILE.csv", requires = "objects")]
    pub(crate) ignore: Option<PathBuf>,
    /// Intersection over union from which MOTA and IDF1 accept a box as a match.
    #[arg(long, value_name = "IOU", default_value_t = 0.5, value_parser = overlap, requires = "objects")]
    pub(crate) iou: f64,
    /// Objects with fewer visible pixels need not be detected.
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = 1500.0,
        value_parser = positive,
        requires = "objects"
    )]
    pub(crate) min_visible: f64,
    /// Speed above which a track counts as too fast, m/s.
    #[arg(long, value_name = "M/S", default_value_t = 2.5, value_parser = positive, requires = "objects")]
    pub(crate) max_speed: f64,
}

/// Parses a finite number of seconds.
fn offset(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| x.is_finite());
    number.ok_or_else(|| "expected a number of seconds".to_owned())
}

/// Parses a number above 0 and up to 1.
fn overlap(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| *x > 0.0 && *x <= 1.0);
    number.ok_or_else(|| "expected a number above 0 up to 1".to_owned())
}
