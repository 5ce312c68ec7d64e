//! The command line as clap parses it. The help of every command ends with examples.

pub(crate) mod batch;
pub(crate) mod datasets;
pub(crate) mod doctor;
pub(crate) mod eval;
pub(crate) mod forward;
pub(crate) mod live;
pub(crate) mod map;
pub(crate) mod models;
pub(crate) mod packaging;
pub(crate) mod recording;
pub(crate) mod render;
pub(crate) mod report;
pub(crate) mod run;
pub(crate) mod simulated;
pub(crate) mod suite;

use crate::args::batch::BatchArgs;
use crate::args::datasets::DatasetsCommand;
use crate::args::doctor::DoctorArgs;
use crate::args::eval::EvalArgs;
use crate::args::live::LiveCommand;
use crate::args::map::MapCommand;
use crate::args::models::{DetectArgs, DetectorArgs, ModelsCommand};
use crate::args::packaging::{CompletionsArgs, ManArgs};
use crate::args::recording::RecordingCommand;
use crate::args::render::RenderArgs;
use crate::args::report::ReportArgs;
use crate::args::run::{ReplayArgs, RunArgs};
use crate::args::simulated::{DemoArgs, SimulateArgs};
use crate::args::suite::Suite;
use clap::{ArgAction, Args, Parser, Subcommand};
use std::path::PathBuf;

const EXIT_CODES: &str = "Exit codes:
  0  all went well
  1  it ran, but tracking was lost in some frame, or Ctrl-C ended it early
  2  the arguments, the input or the output folder cannot be used";

const ROOT_EXAMPLES: &str = "Examples:
  stillpoint demo
  stillpoint run rgbd_dataset_freiburg1_xyz
  stillpoint eval groundtruth.txt out/rgbd_dataset_freiburg1_xyz/trajectory.txt

";

/// Visual RGB-D SLAM: from a folder of images to a trajectory and its score.
#[derive(Debug, Parser)]
// Width 0 turns wrapping off: whether clap wraps would otherwise depend on the features that other crates enable.
#[command(name = "stillpoint", version, term_width = 0, after_help = format!("{ROOT_EXAMPLES}{EXIT_CODES}"))]
pub(crate) struct Arguments {
    /// Print only errors (results of eval and config print are still printed).
    #[arg(
        short,
        long,
        global = true,
        conflicts_with = "verbose",
        display_order = 900
    )]
    pub(crate) quiet: bool,
    /// Print messages of each stage; -vv adds all of their figures.
    #[arg(short, long, global = true, action = ArgAction::Count, display_order = 901)]
    pub(crate) verbose: u8,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Demo(DemoArgs),
    Run(RunArgs),
    #[command(subcommand)]
    Live(LiveCommand),
    Replay(ReplayArgs),
    Report(ReportArgs),
    Render(RenderArgs),
    Eval(EvalArgs),
    Simulate(SimulateArgs),
    Batch(BatchArgs),
    Bench(BenchArgs),
    Detect(DetectArgs),
    Doctor(DoctorArgs),
    #[command(subcommand)]
    Recording(RecordingCommand),
    #[command(subcommand)]
    Map(MapCommand),
    #[command(subcommand)]
    Models(ModelsCommand),
    #[command(subcommand)]
    Datasets(DatasetsCommand),
    /// Show the configuration.
    #[command(
        subcommand,
        after_help = "Examples:
  stillpoint config print > my.toml
  stillpoint run recording --config my.toml"
    )]
    Config(ConfigCommand),
    Completions(CompletionsArgs),
    Man(ManArgs),
}

#[derive(Debug, Subcommand)]
pub(crate) enum ConfigCommand {
    Print(PrintArgs),
}

/// Print the resolved configuration as TOML, every value with its meaning.
///
/// Layers, later ones override: defaults, --config, --set in the given order, --seed.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint config print > my.toml
  stillpoint config print --config my.toml --set mapping.close=2.5"
)]
pub(crate) struct PrintArgs {
    #[command(flatten)]
    pub(crate) config: ConfigArgs,
}

/// Configuration layers, shared by the commands that run the system.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ConfigArgs {
    /// Configuration file (TOML); settings not given keep their defaults.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Set one value, e.g. features.features=1500; may be repeated, and overrides the file.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Seed of every random choice; short for --set seed=N.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub(crate) seed: Option<u64>,
}

/// Which frames of a data set or recording, and the camera that took them.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct InputArgs {
    /// Camera file (camera.toml or camera.txt) or preset; guessed when not given. Presets: tum_fr1, tum_fr2, tum_fr3, bonn,
    /// bonn_calibrated, icl_nuim, seven_scenes; by data sheets: realsense_d435, realsense_d455, realsense_l515, azure_kinect, femto_bolt,
    /// oak_d
    #[arg(long, value_name = "FILE|PRESET", verbatim_doc_comment)]
    pub(crate) camera: Option<String>,
    /// Skip this many frames at the start.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) start: usize,
    /// Read at most this many frames.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=u64::from(u32::MAX)))]
    pub(crate) max_frames: Option<u64>,
    #[command(flatten)]
    pub(crate) topics: TopicArgs,
    #[command(flatten)]
    pub(crate) detector: DetectorArgs,
    /// End with an error at the first unreadable frame instead of skipping it.
    #[arg(long)]
    pub(crate) strict: bool,
}

/// Which messages of a recording to use; ignored for data set folders.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub(crate) struct TopicArgs {
    /// Topic of the colour images of a recording; guessed when not given.
    #[arg(long, value_name = "TOPIC")]
    pub(crate) color_topic: Option<String>,
    /// Topic of the depth images of a recording; guessed when not given.
    #[arg(long, value_name = "TOPIC")]
    pub(crate) depth_topic: Option<String>,
    /// Topic of the camera info of the colour images [default: the one beside them, else the only one of their frame and size].
    #[arg(long, value_name = "TOPIC")]
    pub(crate) info_topic: Option<String>,
    /// Topic of ground truth poses or odometry in a recording [default: no ground truth].
    #[arg(long, value_name = "TOPIC")]
    pub(crate) truth_topic: Option<String>,
    /// Topic of the inertial sensor in a recording (angular rates; with the accelerations, or beside their topic) [default: the camera's
    /// own sensor, where its mounting is known].
    #[arg(long, value_name = "TOPIC")]
    pub(crate) imu_topic: Option<String>,
    /// Do not use the inertial sensor of a recording or data set folder.
    #[arg(long, conflicts_with = "imu_topic")]
    pub(crate) no_imu: bool,
    /// Topic of wheel odometry in a recording [default: the only candidate, where the camera's pose on the base is known].
    #[arg(long, value_name = "TOPIC")]
    pub(crate) odometry_topic: Option<String>,
    /// Do not use the wheel odometry of a recording or data set folder.
    #[arg(long, conflicts_with = "odometry_topic")]
    pub(crate) no_odometry: bool,
    /// Depth values per metre of a recording [default: as stated by the device, else 1000, and 1 for floats].
    #[arg(long, value_name = "N", value_parser = depth_scale)]
    pub(crate) depth_scale: Option<f64>,
}

/// Parses values per metre.
fn depth_scale(text: &str) -> Result<f64, String> {
    let scale = text.parse().ok();
    scale
        .filter(|s| (1e-3..=1e6).contains(s))
        .ok_or_else(|| "expected 0.001 to 1000000 values per metre".to_owned())
}

impl InputArgs {
    /// A copy with another detector argument.
    pub(crate) fn with_detector(&self, argument: String) -> Self {
        Self {
            detector: DetectorArgs {
                detector: Some(argument),
                ..self.detector.clone()
            },
            ..self.clone()
        }
    }
}

/// Parses a number above zero.
fn positive(text: &str) -> Result<f64, String> {
    let number = text
        .parse()
        .ok()
        .filter(|x: &f64| *x > 0.0 && x.is_finite());
    number.ok_or_else(|| "expected a number above 0".to_owned())
}

/// Run data sets several times and report accuracy, speed and memory.
///
/// Runs are separate processes, one after the other. Writes bench.md and bench.json; the results of the runs stay in runs/ beside them.
///
/// With --suite, each PATH and three levels of folders below it are searched for the sequences of a public data set, by their published
/// names. Those found are run. suite.md and suite.json compare their errors with published errors of other systems and name the sources. A
/// sequence that fails is listed with its error. Runs differ in their seeds. Bonn's sequences run with both published depth factors, unless
/// --camera names one. --ablation and --live add runs of each sequence. --pull downloads missing sequences from their official pages into
/// the first PATH (default: data).
///
/// With --ablation, each PATH is run with six configurations of the static filter: none, objects (O), epipolar constraint (G), O+G, O+G
/// and depth (O+G+D), as published, and the default one. Writes ablation.md and ablation.json, beside the published ablation where a name
/// matches. Runs differ in their seeds.
///
/// sim:SCENE is a simulated scene, with the simulator's own detections unless --detector is given. In --detector, {} stands for the folder:
/// scripted:{}/detections.csv.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint bench rgbd_dataset_freiburg1_xyz
  stillpoint bench data/* --runs 5 --out out/bench
  stillpoint bench --suite tum-dynamic --pull
  stillpoint bench --suite tum-dynamic ~/data/tum --seeds 5
  stillpoint bench --suite bonn ~/data/bonn --ablation --live --detector yolox-nano
  stillpoint bench --ablation sim:walking_xyz sim:walking_rpy --seeds 5
  stillpoint bench --ablation rgbd_dataset_freiburg3_walking_xyz --detector yolox-nano

Exit code 1 when a frame was lost (of an ablation: by the default filter), a run failed, or Ctrl-C ended it;
2 when a data set, the output folder, or no sequence of a suite can be used."
)]
pub(crate) struct BenchArgs {
    /// Data set folders, or sim:SCENE; with --suite, folders to search.
    #[arg(value_name = "PATH", required_unless_present = "pull")]
    pub(crate) paths: Vec<PathBuf>,
    /// Run all sequences found of a public data set, and compare with published figures.
    #[arg(long, value_name = "NAME", value_enum)]
    pub(crate) suite: Option<Suite>,
    /// Download missing sequences of the suite, as datasets pull does.
    #[arg(long, requires = "suite")]
    pub(crate) pull: bool,
    /// Mirror with the same paths, instead of the official server.
    #[arg(long, value_name = "URL", requires = "pull")]
    pub(crate) mirror: Option<String>,
    /// Measure the contribution of each part of the static filter.
    #[arg(long)]
    pub(crate) ablation: bool,
    /// Also run the sequences of a suite live.
    #[arg(long, requires = "suite")]
    pub(crate) live: bool,
    /// Runs per data set; with --suite or --ablation, number of seeds per configuration, counted up from --seed.
    #[arg(long, visible_alias = "seeds", value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) runs: u32,
    /// Folder to write to.
    #[arg(long, value_name = "DIR", default_value = "out/bench")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) input: InputArgs,
    #[command(flatten)]
    pub(crate) config: ConfigArgs,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    /// The commands in a text, one per line, without comments, pipes and redirections.
    fn commands(text: &str) -> Vec<Vec<String>> {
        let lines = text.lines().map(str::trim);
        let command = |line: &str| {
            let line = line.split(" #").next().unwrap_or_default();
            let line = line.split([';', '>', '&', '|']).next();
            let line = line.unwrap_or_default();
            let words = line
                .split_whitespace()
                .map(|w| w.trim_matches('\'').to_owned());
            words.collect::<Vec<String>>()
        };
        let lines = lines.filter(|l| l.starts_with("stillpoint ") && !l.contains("..."));
        lines.map(command).collect()
    }

    #[test]
    fn commands_in_documents_and_examples_parse() {
        let mut texts = Vec::new();
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut open = vec![root.join("docs"), root.join("README.md")];
        while let Some(path) = open.pop() {
            if path.is_dir() {
                open.extend(std::fs::read_dir(path).unwrap().map(|e| e.unwrap().path()));
            } else if path.extension().is_some_and(|e| e == "md") {
                texts.push(std::fs::read_to_string(path).unwrap());
            }
        }
        let mut all = vec![Arguments::command()];
        while let Some(command) = all.pop() {
            texts.extend(command.get_after_help().map(ToString::to_string));
            all.extend(command.get_subcommands().cloned());
        }
        let commands: Vec<Vec<String>> = texts.iter().flat_map(|t| commands(t)).collect();
        assert!(commands.len() > 50, "{} commands", commands.len());
        for command in commands {
            if let Err(e) = Arguments::try_parse_from(&command) {
                panic!("{}: {e}", command.join(" "));
            }
        }
    }

    #[test]
    fn simulate_help_lists_every_scene() {
        let mut command = Arguments::command();
        let simulate = command.find_subcommand_mut("simulate").unwrap();
        let help = simulate.render_long_help().to_string();
        let words: Vec<&str> = help.split([' ', ',', '.', '\n']).collect();
        for scene in stillpoint::simulator::scene_names() {
            assert!(words.contains(scene), "{scene} is not in {help}");
        }
    }
}
