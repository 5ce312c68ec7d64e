//! Arguments of `live`: the sources that are driven at the pace of a camera.

use crate::args::run::{LiveChoice, OutputArgs, RunArgs, budget_ms};
use crate::args::{ConfigArgs, InputArgs};
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Run SLAM at the pace of a camera, with a thread per stage.
#[derive(Debug, Subcommand)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint live file walk.mcap
  stillpoint live file rgbd_dataset_freiburg1_xyz --all"
)]
pub(crate) enum LiveCommand {
    File(LiveFileArgs),
}

/// Play a recording or data set folder as a camera.
///
/// Frames arrive at their stamps; tracking, detection, mapping and loops run on threads of their own. The same as
/// run PATH --live: the result folder, its log and the exit codes are those of run, see run --help.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint live file walk.mcap
  stillpoint live file rgbd_dataset_freiburg1_xyz --all --out result
  stillpoint live file d435.bag --save-map desk.spmap --trace trace.json

Exit codes as those of run."
)]
pub(crate) struct LiveFileArgs {
    /// Data set folder or recording.
    #[arg(value_name = "FILE")]
    path: PathBuf,
    /// Track every frame: frames arrive later when tracking is late. Without it such a frame is dropped, and counted.
    #[arg(long)]
    all: bool,
    /// Write the log of the run to this file [default: run.log in the result folder].
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Keep to so many milliseconds per frame by doing less; what frames take is measured.
    #[arg(long, value_name = "N", value_parser = budget_ms)]
    budget_ms: Option<f64>,
    #[command(flatten)]
    output: OutputArgs,
    /// Resume a map that --save-map wrote: places in it are recognised, and it grows.
    #[arg(long, value_name = "FILE", conflicts_with = "localize")]
    load_map: Option<PathBuf>,
    /// Find the camera in a map that --save-map wrote; the map does not grow.
    #[arg(long, value_name = "FILE", conflicts_with = "save_map")]
    localize: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    config: ConfigArgs,
}

impl LiveFileArgs {
    /// The arguments of `run` that mean the same, so that both are one code path.
    pub(crate) fn as_run(&self) -> RunArgs {
        let choice = if self.all {
            LiveChoice::All
        } else {
            LiveChoice::Newest
        };
        RunArgs {
            path: self.path.clone(),
            live: Some(choice),
            log: self.log.clone(),
            budget_ms: self.budget_ms,
            output: self.output.clone(),
            load_map: self.load_map.clone(),
            localize: self.localize.clone(),
            input: self.input.clone(),
            config: self.config.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::args::live::LiveCommand;
    use crate::args::{Arguments, Command};
    use clap::Parser;

    #[test]
    fn a_file_is_run_as_run_live_runs_it() {
        let rest = "room --log a.log --budget-ms 20 --out o --load-map m --start 3 --seed 7";
        for (live, run) in [("", "--live"), ("--all", "--live=all")] {
            let parse = |line: String| Arguments::try_parse_from(line.split_whitespace()).unwrap();
            let file = parse(format!("stillpoint live file {rest} {live}"));
            let Command::Live(LiveCommand::File(file)) = file.command else {
                panic!("expected live file");
            };
            let run = parse(format!("stillpoint run {rest} {run}"));
            let Command::Run(run) = run.command else {
                panic!("expected run");
            };
            assert_eq!(format!("{:?}", file.as_run()), format!("{run:?}"));
        }
    }
}
