//! What `eval` is asked.

use crate::args::positive;
use clap::Args;
use std::path::PathBuf;
use stillpoint::evaluation::Delta;

/// Score a trajectory against ground truth: ATE and RPE; score tracked objects.
///
/// Both trajectories are in the TUM format: timestamp tx ty tz qx qy qz qw. Poses within 0.02 s belong
/// together. In place of the ground truth's file stands a data set folder, or a recording with the
/// --truth-topic of its poses. ATE is taken after alignment by SE(3), with --scale by Sim(3). RPE is taken over
/// --delta: seconds as the TUM script with a fixed delta, or frames as evo over all pairs.
///
/// Stamps in ms, us or ns are recognised, and so is EuRoC's data.csv. Where another offset between both
/// clocks fits far better, that is said; --time-offset applies one, --find-offset the best.
///
/// --objects compares the table of run --objects with boxes.csv by HOTA, MOTA and IDF1 as trackeval
/// does, and says for each class how fast its tracks are. Tracks that were seen once do not count.
/// With both trajectories it also compares velocities and positions, not speeds alone.
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
    /// Ground truth: TUM format, or a data set folder or recording that holds it.
    #[arg(
        value_name = "GROUNDTRUTH",
        required_unless_present = "objects",
        requires = "estimate"
    )]
    pub(crate) ground_truth: Option<PathBuf>,
    /// Estimated trajectory, TUM format.
    #[arg(value_name = "ESTIMATE", required_unless_present = "objects")]
    pub(crate) estimate: Option<PathBuf>,
    /// Topic of poses or odometry that is ground truth, where that is a recording
    /// [default: that of recordings of our own].
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
    /// Add this to the stamps of the estimate, s.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        value_parser = offset,
        requires = "ground_truth"
    )]
    pub(crate) time_offset: f64,
    /// Find the offset with which the estimate fits best, and score it with that.
    #[arg(long, requires = "ground_truth", conflicts_with = "time_offset")]
    pub(crate) find_offset: bool,
    /// What RPE is taken over: seconds (1s) or frames (30f).
    #[arg(long, value_name = "DELTA", default_value = "1s")]
    pub(crate) delta: Delta,
    /// Print JSON (metres, degrees) instead of a table.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write a plot: top view coloured by error, x/y/z and error over time. SVG or PNG by the name.
    #[arg(long, value_name = "FILE.svg|png", requires = "ground_truth")]
    pub(crate) plot: Option<PathBuf>,
    /// Table of run --objects, and the true boxes of what moves; without these only what the tracks say
    /// of themselves.
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
    /// Boxes of what is there and in no list of movers, as a table like boxes.csv: tracks there do not count.
    #[arg(long, value_name = "FILE.csv", requires = "objects")]
    pub(crate) ignore: Option<PathBuf>,
    /// Overlap from which MOTA and IDF1 take a box for the right one: intersection over union.
    #[arg(long, value_name = "IOU", default_value_t = 0.5, value_parser = overlap, requires = "objects")]
    pub(crate) iou: f64,
    /// Things of which fewer pixels are seen need not be found.
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = 1500.0,
        value_parser = positive,
        requires = "objects"
    )]
    pub(crate) min_visible: f64,
    /// Speed above which a track is too fast, m/s.
    #[arg(long, value_name = "M/S", default_value_t = 2.5, value_parser = positive, requires = "objects")]
    pub(crate) max_speed: f64,
}

/// A finite number of seconds.
fn offset(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| x.is_finite());
    number.ok_or_else(|| "expected a number of seconds".to_owned())
}

/// A number above 0 up to 1.
fn overlap(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| *x > 0.0 && *x <= 1.0);
    number.ok_or_else(|| "expected a number above 0 up to 1".to_owned())
}
