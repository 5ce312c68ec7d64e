//! The command line of Stillpoint: arguments to a resolved configuration to wiring to an exit code.
//!
//! Answers: what the user asked for, which parts do it, and how it ended. Holds no method of its own. This is the only
//! place that reads the environment, and but for live runs the only one that reads the clock; results never depend on either.
//!
//! It is a library so that more than one program can hold it: `stillpoint` itself, and the Python package, whose wheel has the
//! command line too. [`run`] is all of it; [`front`] is what other front ends take over, so that the same words mean the same there.

mod args;
mod batch;
mod bench;
mod config;
mod console;
mod datasets;
mod demo;
mod dense;
mod detect;
mod detector;
mod doctor;
mod download;
mod eval;
mod failure;
pub mod front;
mod input;
mod interrupt;
mod machine;
mod map;
mod models;
mod output;
mod packaging;
mod page;
mod priority;
mod realsense;
mod recording;
#[cfg(test)]
mod reference;
mod render;
mod report;
mod run;
mod serve;
mod simulate;
mod sink;
mod sinks;
mod spelling;
mod things;
mod timing;
mod trace;

use args::live::LiveCommand;
use args::{Arguments, Command as Asked, ConfigCommand};
use clap::Parser;
use failure::{Failure, Status};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

/// What the process was told, the program's name first.
static TYPED: OnceLock<Vec<OsString>> = OnceLock::new();
/// What starts this program once more, before its arguments; nothing where it is an executable of its own.
static LAUNCHER: OnceLock<Launcher> = OnceLock::new();

/// How this program is started by another executable.
#[derive(Debug)]
struct Launcher {
    /// The executable and what it has to be told before the arguments.
    words: Vec<OsString>,
    /// The file that holds the program.
    file: PathBuf,
}

/// Carries out a command line, the program's name first, and returns the exit code: 0 well, 1 lost frames or failed criteria, 2 unusable
/// arguments or input. It is the process's only one: it listens to signals, and takes over what panics and spans say.
#[must_use]
pub fn run(typed: Vec<OsString>) -> u8 {
    keep_expected_panics_quiet();
    batch::child::end_with_parent();
    let arguments = Arguments::try_parse_from(&typed);
    // A second command line in one process would be recorded as the first.
    let _ = TYPED.set(typed);
    let arguments = match arguments {
        Ok(arguments) => arguments,
        Err(e) => {
            // Help and version go to stdout and end with 0, mistakes to stderr with 2.
            let text = e.render().to_string();
            if e.use_stderr() {
                console::line(text.trim_end());
                return Status::Unusable.code();
            }
            console::print(&text);
            return told(Status::Ok).code();
        }
    };
    told(match dispatch(&arguments) {
        Ok(status) => status,
        Err(failure) => {
            console::line(&format!("error: {failure}"));
            failure.status()
        }
    })
    .code()
}

/// Says how this program is started once more, as benchmarks and trials of models do, where the process's own executable is another one: that
/// one, and what it has to be told before the arguments. `file` is the library that holds the program. The first who says so is heard.
pub fn launch_by(words: Vec<OsString>, file: PathBuf) {
    let _ = LAUNCHER.set(Launcher { words, file });
}

/// What the user typed after the program's name.
fn typed() -> impl Iterator<Item = &'static OsString> {
    TYPED.get().into_iter().flatten().skip(1)
}

/// This program, to be run in a process of its own.
fn program() -> std::io::Result<Command> {
    let mut command = match LAUNCHER.get().map(|l| l.words.as_slice()) {
        Some([first, told @ ..]) => {
            let mut command = Command::new(first);
            command.args(told);
            command
        }
        _ => Command::new(std::env::current_exe()?),
    };
    // What a batch says to its runs is not for what these start.
    command.env_remove(batch::child::PARENT);
    Ok(command)
}

/// The file whose bytes are this program.
fn program_file() -> std::io::Result<PathBuf> {
    match LAUNCHER.get() {
        Some(launcher) => Ok(launcher.file.clone()),
        None => std::env::current_exe(),
    }
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
        Asked::Demo(a) => demo::demo(a, timing),
        Asked::Run(a) => run::run(a, timing),
        Asked::Live(LiveCommand::File(a)) => run::run(&a.as_run(), timing),
        Asked::Live(LiveCommand::Realsense(a)) => realsense::live(a, timing),
        Asked::Replay(a) => run::replay::replay(a, timing),
        Asked::Render(a) => render::render(a, timing),
        Asked::Report(a) => page::report(a),
        Asked::Eval(a) => eval::eval(a),
        Asked::Simulate(a) => simulate::simulate(a),
        Asked::Batch(a) => batch::batch(a),
        Asked::Bench(a) => bench::bench(a),
        Asked::Detect(a) => detect::detect(a, timing),
        Asked::Doctor(a) => doctor::doctor(a),
        Asked::Recording(a) => recording::recording(a),
        Asked::Map(a) => map::map(a),
        Asked::Models(a) => models::models(a),
        Asked::Datasets(a) => datasets::datasets(a),
        Asked::Config(ConfigCommand::Print(a)) => config::print(a),
        Asked::Completions(a) => Ok(packaging::completions(a)),
        Asked::Man(a) => packaging::man(a),
    }
}
