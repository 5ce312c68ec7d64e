//! Arguments of the model commands, and the detector options that several commands share.

use crate::args::TopicArgs;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Runtime of networks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum RuntimeChoice {
    /// ONNX Runtime where its library is found, else rten.
    #[default]
    Auto,
    /// Built in.
    Rten,
    /// The ONNX Runtime library.
    Onnxruntime,
}

impl RuntimeChoice {
    /// The name on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Rten => "rten",
            Self::Onnxruntime => "onnxruntime",
        }
    }
}

/// The detector and its runtime.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct DetectorArgs {
    /// Object detector: none, scripted:FILE.csv (timestamp,class,score,x0,y0,x1,y1), a model as FILE.onnx (its card, if needed, is
    /// FILE.toml beside it), or the name of a model in the cache. [default: a model of the cache if there is one, else none]
    #[arg(
        long,
        value_name = "none|scripted:FILE.csv|FILE.onnx|NAME",
        verbatim_doc_comment
    )]
    pub(crate) detector: Option<String>,
    /// Runtime of networks: rten (built in), onnxruntime (two to three times faster; its library must be installed), or auto: onnxruntime
    /// where its library is found, else rten.
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

/// Runtime of a network outside of a run.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct NetworkArgs {
    /// Runtime of the network: rten, onnxruntime, or auto: onnxruntime where its library is found, else rten.
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

/// Detect objects in images.
///
/// PATH is an image (PNG, JPEG or WebP), a folder of images in the order of their names, an RGB-D data set folder or a recording;
/// detections of the latter two have the time stamps of the frames.
///
/// With --out, detections.csv (timestamp,class,score,x0,y0,x1,y1; raw pixels) and an image with boxes per input image (boxes_NAME.png) are
/// written. For data sets and recordings, run --detector scripted:FILE plays that table back. Images without time stamps get the number in
/// their file name, or their index.
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
    /// Model: FILE.onnx (its card, if needed, is FILE.toml beside it), or the name of a model in the cache. [default: the model of the
    /// cache that run uses]
    #[arg(long, value_name = "FILE.onnx|NAME", verbatim_doc_comment)]
    pub(crate) model: Option<String>,
    /// Folder for the table and the images.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Minimum score of a detection, above 0 and up to 1.
    #[arg(long, value_name = "SCORE", default_value_t = 0.25)]
    pub(crate) score: f32,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
    #[command(flatten)]
    pub(crate) network: NetworkArgs,
}

/// List, download and check detector models.
///
/// The cache is the folder in STILLPOINT_CACHE, else the user's own (~/.cache/stillpoint). A model in the cache is used by its name:
/// --detector NAME, --model NAME.
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

/// List known models, models in the cache, and available runtimes.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint models list"
)]
pub(crate) struct ListArgs {}

/// Download a known model from its authors' release into the cache.
///
/// An interrupted download (also by Ctrl-C) is kept and resumed the next time. The file is compared with its checksum; where none is known,
/// the first one is recorded and later downloads are compared with it. A checkpoint (yolov7-tiny) is converted to ONNX; nothing in it is
/// executed.
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
    /// Download even if it is in the cache, and replace any model of that name.
    #[arg(long)]
    pub(crate) again: bool,
    /// Mirror with the same paths, instead of https://github.com.
    #[arg(long, value_name = "URL")]
    pub(crate) mirror: Option<String>,
}

/// Add a model file to the cache: ONNX as it is, a YOLOv7-tiny checkpoint (.pt) converted to ONNX.
///
/// The model is run once first, and refused if it cannot be used. Its card, if needed, is FILE.toml beside it; the card of a checkpoint is
/// derived from its contents. Nothing in a checkpoint is executed.
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
    /// Write the model to this file and its card beside it, instead of to the cache.
    #[arg(long, value_name = "FILE.onnx", conflicts_with = "name")]
    pub(crate) out: Option<PathBuf>,
}

/// Load a model, run it once, and describe it.
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
    /// Internal: tries a model from stdin within resource limits, for the process identified by this value.
    #[arg(long, value_name = "OPTION", hide = true)]
    pub(crate) trial: Option<String>,
    #[command(flatten)]
    pub(crate) network: NetworkArgs,
}
