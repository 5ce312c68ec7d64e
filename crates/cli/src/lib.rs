//! The command line of Stillpoint: from arguments to a resolved configuration, a run and an exit code. It contains no algorithms.
//!
//! Only this crate reads the environment and, except for live runs, the clock; results depend on neither.
//!
//! It is a library because two programs contain it: `stillpoint`, and the Python package, whose wheel includes the command line. [`run`] is
//! the complete command line; [`front`] holds what other front ends share with it.

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

/// The command line, starting with the program's name.
static TYPED: OnceLock<Vec<OsString>> = OnceLock::new();
/// How to start this program again; unset where it is an executable of its own.
static LAUNCHER: OnceLock<Launcher> = OnceLock::new();

#[derive(Debug)]
struct Launcher {
    words: Vec<OsString>,
    file: PathBuf,
}

/// Runs a command line, starting with the program's name, and returns the exit code: 0 success, 1 lost frames or failed criteria, 2
/// unusable arguments or input. May be called once per process, since it installs signal handlers, a panic hook and a tracing subscriber.
#[must_use]
pub fn run(typed: Vec<OsString>) -> u8 {
    keep_expected_panics_quiet();
    batch::child::end_with_parent();
    let arguments = Arguments::try_parse_from(&typed);
    // Kept for reports. A second command line in one process would be recorded as the first.
    let _ = TYPED.set(typed);
    let arguments = match arguments {
        Ok(arguments) => arguments,
        Err(e) => {
            // Help and version go to stdout with exit code 0, errors to stderr with 2.
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

/// Sets how child processes (benchmarks, trials of models) start this program where the executable is another one: that executable with its
/// first arguments. `file` is the library that contains the program. Only the first call has an effect.
pub fn launch_by(words: Vec<OsString>, file: PathBuf) {
    let _ = LAUNCHER.set(Launcher { words, file });
}

/// The arguments after the program's name.
fn typed() -> impl Iterator<Item = &'static OsString> {
    TYPED.get().into_iter().flatten().skip(1)
}

fn program() -> std::io::Result<Command> {
    let mut command = match LAUNCHER.get().map(|l| l.words.as_slice()) {
        Some([first, told @ ..]) => {
            let mut command = Command::new(first);
            command.args(told);
            command
        }
        _ => Command::new(std::env::current_exe()?),
    };
    // Children of a batch run must not inherit its parent id.
    command.env_remove(batch::child::PARENT);
    Ok(command)
}

/// The file that contains this program, for digests.
fn program_file() -> std::io::Result<PathBuf> {
    match LAUNCHER.get() {
        Some(launcher) => Ok(launcher.file.clone()),
        None => std::env::current_exe(),
    }
}

/// Silences panics of network runtimes, which become errors with a message. Other panics are bugs and are printed as usual.
fn keep_expected_panics_quiet() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let file = info.location().map_or("", |place| place.file());
        if !stillpoint::inference::is_expected(file) {
            usual(info);
        }
    }));
}

/// The final status: failed output on stdout counts as a failure.
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
