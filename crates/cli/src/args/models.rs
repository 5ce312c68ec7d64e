//! Arguments of the commands about detectors, and those that the commands with a detector share.

use crate::args::TopicArgs;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// What runs networks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum RuntimeChoice {
    /// ONNX Runtime where its library is found, else rten.
    #[default]
    Auto,
    /// Built in.
    Rten,
    /// The library of ONNX Runtime.
    Onnxruntime,
}

impl RuntimeChoice {
    /// As it is written on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Rten => "rten",
            Self::Onnxruntime => "onnxruntime",
        }
    }
}

/// Which detector looks at the frames, and what runs its network.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct DetectorArgs {
    /// Object detector: none, scripted:FILE.csv (timestamp,class,score,x0,y0,x1,y1), a model as FILE.onnx (its card, where
    /// it needs one, is FILE.toml beside it), or the name of a model in the cache.
    /// [default: a model of the cache if there is one, else none]
    #[arg(
        long,
        value_name = "none|scripted:FILE.csv|FILE.onnx|NAME",
        verbatim_doc_comment
    )]
    pub(crate) detector: Option<String>,
    /// What runs networks: rten, which is built in, onnxruntime, whose library must be found and which is two to three
    /// times faster, or auto: onnxruntime where its library is found, else rten.
    #[arg(
        long,
        value_name = "auto|rten|onnxruntime",
        value_enum,
        default_value = "auto",
        hide_possible_values = true,
        verbatim_doc_comment
    )]
    pub(crate) runtime: RuntimeChoice,
    /// Threads of the network; the other cores are left to tracking and mapping.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub(crate) detector_threads: u8,
}

/// What runs a network on its own.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct NetworkArgs {
    /// What runs the network: rten, onnxruntime, or auto: onnxruntime where its library is found, else rten.
    #[arg(
        long,
        value_name = "auto|rten|onnxruntime",
        value_enum,
        default_value = "auto",
        hide_possible_values = true
    )]
    pub(crate) runtime: RuntimeChoice,
    /// Threads of the network.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub(crate) threads: u8,
}

/// Find objects in images.
///
/// PATH is an image (PNG, JPEG or WebP), a folder of images, taken in the order of their names, an
/// RGB-D data set folder or a recording, whose time stamps the detections then have.
///
/// With --out, detections.csv (timestamp,class,score,x0,y0,x1,y1; raw pixels) and a picture with boxes
/// for every image (boxes_NAME.png) are written. Of data sets and recordings, that table can be played back by
/// run --detector scripted:FILE. Images without time stamps get the number that is their file's name,
/// or their index.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint detect street.jpg --model yolox-nano
  stillpoint detect pictures --model picodet.onnx --score 0.4 --out found
  stillpoint detect rgbd_dataset_freiburg3_walking_xyz --model yolox-nano --out found
  stillpoint run rgbd_dataset_freiburg3_walking_xyz --detector scripted:found/detections.csv
  stillpoint detect desk.mcap --model yolox-nano --color-topic /camera/color/image_raw --out found

Exit code 1 when an image could not be read or looked at, or Ctrl-C ended it early;
2 when none could, or the model or the output folder cannot be used."
)]
pub(crate) struct DetectArgs {
    /// Image, folder of images, data set folder, or recording.
    #[arg(value_name = "IMAGE|FOLDER|FILE")]
    pub(crate) path: PathBuf,
    /// Model: FILE.onnx (its card, where it needs one, is FILE.toml beside it), or the name of a model in the cache.
    /// [default: the model of the cache that run uses]
    #[arg(long, value_name = "FILE.onnx|NAME", verbatim_doc_comment)]
    pub(crate) model: Option<String>,
    /// Folder to write the table and the pictures to.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Least score of a detection, over 0 to 1.
    #[arg(long, value_name = "SCORE", default_value_t = 0.25)]
    pub(crate) score: f32,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
    #[command(flatten)]
    pub(crate) network: NetworkArgs,
}

/// Models of detectors: those that are known, and those in the cache.
///
/// The cache is the folder that STILLPOINT_CACHE names, else the user's own (~/.cache/stillpoint). A model of
/// the cache is used by its name: --detector NAME, --model NAME.
#[derive(Debug, Subcommand)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint models list
  stillpoint models pull yolox-nano
  stillpoint models import yolov7-tiny.pt
  stillpoint models check yolox_nano.onnx"
)]
pub(crate) enum ModelsCommand {
    List(ListArgs),
    Pull(PullArgs),
    Import(ImportArgs),
    Check(CheckArgs),
}

/// List known models, those in the cache, and the runtimes that are found.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint models list"
)]
pub(crate) struct ListArgs {}

/// Get a known model from its makers' release into the cache.
///
/// A download that breaks off, or that Ctrl-C ends, is kept and resumed the next time. The file is
/// compared with its checksum; where that is not known, it is recorded, and later downloads are compared
/// with the record. A checkpoint (yolov7-tiny) is turned into ONNX; nothing in it is executed.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint models pull yolox-nano
  stillpoint models pull yolov7-tiny
  HTTPS_PROXY=http://proxy:3128 stillpoint models pull yolox-tiny

Without a network: get the file that the message names on another machine, and use models import.

Exit code 1 when Ctrl-C ended it; 2 when the model could not be had."
)]
pub(crate) struct PullArgs {
    /// Name of a known model: see models list.
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    /// Download it although it is here, or another model of that name, which is replaced.
    #[arg(long)]
    pub(crate) again: bool,
    /// Server with the same paths to get it from, instead of https://github.com.
    #[arg(long, value_name = "URL")]
    pub(crate) mirror: Option<String>,
}

/// Put a model file into the cache: ONNX as it is, a checkpoint of YOLOv7-tiny (.pt) turned into ONNX.
///
/// The model is run once first, and refused if it cannot be used. Where it needs a card, that is FILE.toml
/// beside it; the card of a checkpoint is made from what is in it. Nothing in a checkpoint is executed.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint models import yolov7-tiny.pt
  stillpoint models import office.onnx --name office
  stillpoint models import yolov7-tiny.pt --out yolov7-tiny.onnx"
)]
pub(crate) struct ImportArgs {
    /// Model: FILE.onnx or FILE.pt.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Name in the cache [default: that of the known model, else of the file].
    #[arg(long, value_name = "NAME")]
    pub(crate) name: Option<String>,
    /// Write the model to this file, and its card beside it, instead of to the cache.
    #[arg(long, value_name = "FILE.onnx", conflicts_with = "name")]
    pub(crate) out: Option<PathBuf>,
}

/// Load a model, run it once, and show what it is.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint models check yolox_nano.onnx
  stillpoint models check yolox-nano --runtime onnxruntime --threads 2
  stillpoint models check office.onnx > office.txt

The card that it prints can be put beside the model as FILE.toml and changed there.

Exit code 2 when the model cannot be used."
)]
pub(crate) struct CheckArgs {
    /// Model: FILE.onnx, or the name of a model in the cache.
    #[arg(value_name = "FILE.onnx|NAME")]
    pub(crate) model: String,
    /// For the program itself: tries the model that comes in on stdin, within limits, for who named it by this option.
    #[arg(long, value_name = "OPTION", hide = true)]
    pub(crate) trial: Option<String>,
    #[command(flatten)]
    pub(crate) network: NetworkArgs,
}
