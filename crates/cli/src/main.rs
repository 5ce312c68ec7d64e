//! The command line of Stillpoint: arguments to a resolved configuration to wiring to an exit code.
//!
//! Answers: what the user asked for, which parts do it, and how it ended. Holds no method of its own. This is the only
//! place that reads the environment, and but for live runs the only one that reads the clock; results never depend on either.

mod args;
mod bench;
mod config;
mod console;
mod demo;
mod dense;
mod detect;
mod detector;
mod doctor;
mod eval;
mod failure;
mod interrupt;
mod machine;
mod map;
mod models;
mod output;
mod packaging;
mod page;
mod realsense;
mod recording;
mod report;
mod run;
mod serve;
mod simulate;
mod spelling;
mod timing;
mod trace;

use args::live::LiveCommand;
use args::{Arguments, Command, ConfigCommand};
use clap::Parser;
use failure::{Failure, Status};
use std::process::ExitCode;

fn main() -> ExitCode {
    keep_expected_panics_quiet();
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(e) => {
            // Help and version go to stdout and end with 0, mistakes to stderr with 2.
            let text = e.render().to_string();
            if e.use_stderr() {
                console::line(text.trim_end());
                return Status::Unusable.into();
            }
            console::print(&text);
            return told(Status::Ok).into();
        }
    };
    told(match dispatch(&arguments) {
        Ok(status) => status,
        Err(failure) => {
            console::line(&format!("error: {failure}"));
            failure.status()
        }
    })
    .into()
}

/// Panics of a network's runtime become errors with a message. Others are mistakes of this program, and are told as usual.
fn keep_expected_panics_quiet() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let file = info.location().map_or("", |place| place.file());
        if !stillpoint::inference::is_expected(file) {
            usual(info);
        }
    }));
}

/// How the program ends: what it was to say on stdout is part of what it was to do.
fn told(status: Status) -> Status {
    match console::lost() {
        None => status,
        Some(reason) => {
            console::line(&format!(
                "error: stdout: expected to write the result to it, found: {reason}; check the free space where it goes"
            ));
            Status::Unusable
        }
    }
}

fn dispatch(arguments: &Arguments) -> Result<Status, Failure> {
    console::set_verbosity(arguments.quiet, arguments.verbose);
    let timing = timing::install();
    match &arguments.command {
        Command::Demo(a) => demo::demo(a, timing),
        Command::Run(a) => run::run(a, timing),
        Command::Live(LiveCommand::File(a)) => run::run(&a.as_run(), timing),
        Command::Live(LiveCommand::Realsense(a)) => realsense::live(a, timing),
        Command::Replay(a) => run::replay::replay(a, timing),
        Command::Report(a) => page::report(a),
        Command::Eval(a) => eval::eval(a),
        Command::Simulate(a) => simulate::simulate(a),
        Command::Bench(a) => bench::bench(a),
        Command::Detect(a) => detect::detect(a, timing),
        Command::Doctor(a) => doctor::doctor(a),
        Command::Recording(a) => recording::recording(a),
        Command::Map(a) => map::map(a),
        Command::Models(a) => models::models(a),
        Command::Config(ConfigCommand::Print(a)) => config::print(a),
        Command::Completions(a) => Ok(packaging::completions(a)),
        Command::Man(a) => packaging::man(a),
    }
}
