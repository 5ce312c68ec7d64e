//! Arguments of the commands that run the system on a data set.

use crate::args::map::direction;
use crate::args::{ConfigArgs, InputArgs};
use crate::run::overlay::Labels;
use crate::serve::Place;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Which frames of a live run are tracked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LiveChoice {
    /// A frame that comes too late gives way to the next one.
    Newest,
    /// All.
    All,
}

impl LiveChoice {
    /// As it is written on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Newest => "newest",
            Self::All => "all",
        }
    }
}

/// What is written, and where to.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct OutputArgs {
    /// Result folder [default: out/ and the name of PATH; with _live after a run at camera rate, _replay after replay].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Write what the static filter said of every keypoint: timestamp,u,v,verdict,reasons (raw pixels).
    #[arg(long, value_name = "FILE.csv")]
    pub(crate) verdicts: Option<PathBuf>,
    /// Write the objects of every frame: number, class, state, motion (moving, parked, unknown), box (raw pixels), position (m),
    /// velocity (m/s) and their covariance, in the world of trajectory_online.txt; what is not known is left empty.
    #[arg(long, value_name = "FILE.csv", verbatim_doc_comment)]
    pub(crate) objects: Option<PathBuf>,
    /// Write a mask of every frame as PNG of 8 bits, named by its timestamp: 255 where the scene moves, 0 where it stands
    /// still. A live run leaves out those that it has no time for.
    #[arg(long, value_name = "DIR", verbatim_doc_comment)]
    pub(crate) masks: Option<PathBuf>,
    /// Write frames as PNG, and an animation of them as GIF, with features, objects and state drawn over them. A legend
    /// in each picture says what the marks mean. Boxes are dashed where an object is predicted without a detection; a
    /// speed is shown only where the object moves and the speed is above its own standard deviation.
    #[arg(long, value_name = "DIR", verbatim_doc_comment)]
    pub(crate) overlay: Option<PathBuf>,
    /// Draw every N-th frame only.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "overlay", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) overlay_every: u32,
    /// Which objects are labelled: every one, only those of classes that move by themselves or are seen moving, or none.
    #[arg(long, value_name = "WHICH", value_enum, default_value_t = Labels::Movers, requires = "overlay")]
    pub(crate) overlay_labels: Labels,
    /// Write the map to this file when the run ends, also when Ctrl-C or an error ends it: see map --help. An older file is replaced only
    /// by a whole one.
    #[arg(long, value_name = "FILE", verbatim_doc_comment)]
    pub(crate) save_map: Option<PathBuf>,
    /// Write what is found to this file, as messages of ROS 2 with the axes of REP-103: transforms map -> odom -> camera_link, odometry,
    /// path, landmarks, objects, health, and frames with what the static filter said of them. Foxglove, Rerun, PlotJuggler
    /// and ros2 bag play open it. live realsense writes the camera's frames into it too; run and replay read them.
    #[arg(long, value_name = "FILE.mcap", verbatim_doc_comment)]
    pub(crate) record: Option<PathBuf>,
    /// Write no pictures into the file of --record.
    #[arg(long, requires = "record")]
    pub(crate) no_record_images: bool,
    /// Fuse what stands still into a surface: mesh.ply and mesh.glb in the result folder, and a floor plan for ROS 2's map_server
    /// (grid.pgm, grid.yaml) where the floor was seen. What moves is not in it. --save-map keeps it in the map, for map mesh,
    /// map grid and map octomap.
    #[arg(long, verbatim_doc_comment)]
    pub(crate) dense: bool,
    /// Distance between the points at which the surface is stored, m [default: 0.02].
    #[arg(long, value_name = "M", requires = "dense", value_parser = voxel)]
    pub(crate) voxel: Option<f64>,
    /// Direction away from the floor in the map, roughly [default: as the inertial sensor knows it for --dense, else as the map knows it
    /// that the run begins with, else that of a camera that was held upright at first]. --save-map keeps it.
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
    /// Gather what stands in the room: chairs, tables, screens and whatever else the detector knows and stands still, people never. Writes
    /// things.json; --save-map keeps them in the map, for map objects. Needs a detector.
    #[arg(long, verbatim_doc_comment)]
    pub(crate) things: bool,
    /// Write no report.html into the result folder.
    #[arg(long)]
    pub(crate) no_report: bool,
    /// Show the run in a browser while it goes on: the frames with verdicts and boxes, the map, health and latency. The address to open is
    /// printed; without ADDR only this machine reaches it. It takes nothing and ends with the run. PATH goes before it.
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, default_missing_value = "", verbatim_doc_comment)]
    pub(crate) view: Option<Place>,
    /// Print the summary as JSON, as it stands in summary.json, and nothing else on stdout.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write what every thread did when, for ui.perfetto.dev or chrome://tracing.
    #[arg(long, value_name = "FILE.json")]
    pub(crate) trace: Option<PathBuf>,
}

/// Run SLAM on a data set folder or a recording.
///
/// The layout of a folder (TUM, Bonn, ICL-NUIM, 7-Scenes), the topics of a recording (MCAP,
/// rosbag2, ROS 1 bag) and the camera are guessed, and each guess is printed. With ground truth the score is printed too.
///
/// The result folder holds trajectory.txt (final poses of the frames that were tracked with at
/// least 30 inliers; TUM format), trajectory_online.txt (the poses as known at each frame),
/// keyframes.txt, config.toml (the resolved configuration), summary.json, report.html (all of it to
/// look at, in one page: see report --help), and plots. An older
/// result in it is replaced only when the run has ended. Ctrl-C ends the run after the frame at
/// hand and writes what there is; a second Ctrl-C ends it at once.
///
/// With --live the data set is played as a camera: frames arrive at their stamps, and tracking,
/// detection, mapping and loops run on threads of their own.
///
/// run.log in the result folder says in which order the stages took their messages, which depends on
/// threads and clocks in a live run, and what the detector said: see replay --help.
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
    /// Play the data set as a camera. A frame that tracking has not taken when the next one arrives is dropped, and counted;
    /// with --live=all tracking takes every frame, and frames arrive later when it is late.
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
    /// Write the log of the run to this file [default: run.log in the result folder].
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Option<PathBuf>,
    /// Keep to so many milliseconds per frame by doing less: fewer keypoints, less mapping, and the detector asked more rarely. A live run
    /// measures what frames take; any other plans with a fixed table, and stays the same on every machine.
    #[arg(long, value_name = "N", value_parser = budget_ms, verbatim_doc_comment)]
    pub(crate) budget_ms: Option<f64>,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
    /// Resume a map that --save-map wrote: places in it are recognised, and it grows.
    #[arg(long, value_name = "FILE", conflicts_with = "localize")]
    pub(crate) load_map: Option<PathBuf>,
    /// Find the camera in a map that --save-map wrote, in that map's frame of reference. The map is only read: it does not grow.
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

/// A distance between voxels, m.
pub(crate) fn voxel(text: &str) -> Result<f64, String> {
    let m = text.parse().ok();
    m.filter(|m| (0.005..=0.2).contains(m))
        .ok_or_else(|| "expected 0.005 to 0.2 metres".to_owned())
}

/// A time per frame, ms.
pub(crate) fn budget_ms(text: &str) -> Result<f64, String> {
    let ms = text.parse().ok();
    ms.filter(|ms| (1.0..=1000.0).contains(ms))
        .ok_or_else(|| "expected 1 to 1000 milliseconds".to_owned())
}

/// Repeat a run, bit for bit.
///
/// LOG is the run.log that run left, live or not, and PATH the data set that it was run on. The stages take
/// the same frames, detections and messages in the same order as then, whatever threads and clocks there
/// are now: trajectories, frames.csv and the map are the same to the byte, as long as data set,
/// loaded map and program are. Configuration, camera and map file are those in the log, unless other ones
/// are named. The detector is not needed: what it said is in the log.
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
    /// Where the map lies now that the run resumed.
    #[arg(long, value_name = "FILE", conflicts_with = "localize")]
    pub(crate) load_map: Option<PathBuf>,
    /// Where the map lies now that the run found the camera in.
    #[arg(long, value_name = "FILE", conflicts_with = "save_map")]
    pub(crate) localize: Option<PathBuf>,
    /// Camera file or preset [default: as in the run].
    #[arg(long, value_name = "FILE|PRESET")]
    pub(crate) camera: Option<String>,
    #[command(flatten)]
    pub(crate) config: ConfigArgs,
}
