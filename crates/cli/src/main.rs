//! The command line of Stillpoint: arguments to a resolved configuration to wiring to an exit code.
//!
//! Answers: what the user asked for, which parts do it, and how it ended. Holds no method of its own. This is the only
//! place that reads the environment, and but for live runs the only one that reads the clock; results never depend on either.

mod ablation;
mod ablation_report;
mod about;
mod args;
mod args_map;
mod args_models;
mod args_run;
mod bench;
mod bench_runner;
mod bench_source;
mod cache;
mod config;
mod config_docs;
mod console;
mod demo;
mod demo_detector;
mod demo_pictures;
mod demo_report;
mod detect;
mod detect_images;
mod detect_output;
mod detector;
mod eval;
mod failure;
mod frames;
mod interrupt;
mod live_report;
mod machine;
mod map;
mod map_export;
mod map_file;
mod map_merge;
mod models;
mod models_check;
mod models_import;
mod models_pull;
mod network;
mod output;
mod overlay;
mod played;
mod priority;
mod replay;
mod report;
mod result;
mod run;
mod runtime;
mod session;
mod session_live;
mod session_outputs;
mod session_replay;
mod simulate;
mod spelling;
mod suite;
mod suite_catalogue;
mod suite_find;
mod suite_report;
mod summary;
mod summary_detector;
mod tally;
mod timing;
mod trace;
mod verdicts;

use args::{Arguments, Command, ConfigCommand};
use clap::Parser;
use failure::{Failure, Status};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(e) => {
            // Help and version go to stdout and end with 0, mistakes to stderr with 2; a closed pipe is no reason to fail.
            let _ = e.print();
            return ExitCode::from(e.exit_code().clamp(0, 2) as u8);
        }
    };
    match dispatch(&arguments) {
        Ok(status) => status.into(),
        Err(failure) => {
            console::line(&format!("error: {failure}"));
            failure.status().into()
        }
    }
}

fn dispatch(arguments: &Arguments) -> Result<Status, Failure> {
    console::set_verbosity(arguments.quiet, arguments.verbose);
    let timing = timing::install();
    match &arguments.command {
        Command::Demo(a) => demo::demo(a, timing),
        Command::Run(a) => run::run(a, timing),
        Command::Replay(a) => replay::replay(a, timing),
        Command::Eval(a) => eval::eval(a),
        Command::Simulate(a) => simulate::simulate(a),
        Command::Bench(a) => bench::bench(a),
        Command::Detect(a) => detect::detect(a, timing),
        Command::Map(a) => map::map(a),
        Command::Models(a) => models::models(a),
        Command::Config(ConfigCommand::Print(a)) => config::print(a),
    }
}
