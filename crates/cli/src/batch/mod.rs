//! `batch`: many recordings, each run in a separate process, several at a time; and the tables of several batches joined.
//!
//! Decides which recordings to run and how many at a time, and collects the results. It schedules on this machine only: use shards or the
//! Python package with a cluster scheduler.

mod budget;
pub(crate) mod child;
mod columns;
pub(crate) mod digest;
mod inputs;
mod lock;
mod merge;
mod page;
mod pool;
mod result;
mod row;
mod table;

use crate::args::batch::{BatchArgs, BatchCommand};
use crate::batch::budget::{Budget, Memory};
use crate::batch::inputs::Item;
use crate::batch::lock::Lock;
use crate::batch::pool::Pool;
use crate::batch::row::{Job, Method, Row};
use crate::batch::table::Batch;
use crate::bench::command_line;
use crate::detector::Settled;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::Machine;
use crate::{config, console, detector};
use std::path::Path;
use std::time::Instant;

pub(crate) fn batch(args: &BatchArgs) -> Result<Status, Failure> {
    if let Some(BatchCommand::Merge(args)) = &args.command {
        return merge::merge(args);
    }
    let interrupt = Interrupt::prepare();
    // Checked here, so that an error in the arguments is reported once instead of in every run.
    config::simd()?;
    let settled = detector::settle(&args.input.detector)?;
    settled.announce();
    // Pins the model, so that one added to the cache meanwhile is not used.
    let args = &BatchArgs {
        input: args.input.with_detector(settled.argument.clone()),
        ..args.clone()
    };
    let method = method(args, &settled)?;
    let items = inputs::share(inputs::find(args)?, args.shard);
    let _lock = Lock::take(&args.out)?;
    let sorted = sort(items, args, &method)?;
    sorted.say();
    // From here on Ctrl-C must keep results.
    interrupt.begin();
    let budget = budget(&sorted.jobs, args, &settled);
    let begin = Instant::now();
    let pool = Pool {
        args,
        budget: &budget,
        interrupt: &interrupt,
    };
    let ran = pool.run(sorted.jobs);
    let skipped = sorted.done.len();
    let mut recordings = [sorted.done, sorted.unreadable, ran.rows].concat();
    recordings.sort_by(|a, b| a.name.cmp(&b.name));
    let batch = Batch {
        command: command_line(),
        machine: Machine::here(),
        method,
        shard: args.shard.map(Into::into),
        merged: Vec::new(),
        is_complete: recordings.len() == sorted.all,
        skipped,
        workers: budget.workers,
        seconds: begin.elapsed().as_secs_f64(),
        recordings,
    };
    end(&batch, args, ran.full, &interrupt, sorted.all)
}

/// Program and configuration that all runs share.
fn method(args: &BatchArgs, settled: &Settled) -> Result<Method, Failure> {
    Ok(Method {
        stillpoint: env!("CARGO_PKG_VERSION").to_owned(),
        program_sha256: digest::of_program()?,
        configuration_sha256: digest::of_configuration(
            &args.config,
            &args.input,
            &args.each,
            settled,
        )?,
    })
}

fn budget(jobs: &[Job], args: &BatchArgs, settled: &Settled) -> Budget {
    if jobs.is_empty() {
        return Budget::NONE;
    }
    let memory = Memory::estimate(jobs, args, settled);
    Budget::plan(jobs.len(), &memory, args.workers)
}

fn end(
    batch: &Batch,
    args: &BatchArgs,
    full: Option<String>,
    interrupt: &Interrupt,
    all: usize,
) -> Result<Status, Failure> {
    let left = all - batch.recordings.len();
    let written = result::write(batch, &args.out);
    if let Some(reason) = full {
        return Err(Failure::input(format!(
            "the disk of {} is full; {} of {all} recordings are done and kept: make room and run the same batch again ({reason})",
            args.out.display(),
            all - left
        )));
    }
    written?;
    let status = result::print(batch, &args.out, args.json)?;
    if interrupt.requested() {
        console::line(&format!(
            "interrupted: {} left; the same command goes on from here",
            console::counted(left, "recording")
        ));
    }
    Ok(status)
}

/// The recordings by what remains to be done.
struct Sorted {
    all: usize,
    done: Vec<Row>,
    /// Recordings that cannot be opened.
    unreadable: Vec<Row>,
    jobs: Vec<Job>,
    /// Number of jobs whose recording changed since its last run.
    changed: usize,
    /// Number of jobs that replace a result of another program or configuration.
    replaced: usize,
}

impl Sorted {
    fn say(&self) {
        if !self.done.is_empty() {
            console::info(&format!(
                "{} of {} skipped: the results of the same input, configuration and program are there",
                self.done.len(),
                console::counted(self.all, "recording")
            ));
        }
        for (n, why) in [
            (self.changed, "the recording changed since"),
            (
                self.replaced,
                "the result is of another program or configuration",
            ),
        ] {
            if n > 0 {
                console::info(&format!(
                    "{} run again: {why}",
                    console::counted(n, "recording")
                ));
            }
        }
    }
}

/// Separates finished recordings from those to run.
///
/// # Errors
/// A result of another program or configuration, without `--replace`.
fn sort(items: Vec<Item>, args: &BatchArgs, method: &Method) -> Result<Sorted, Failure> {
    let mut sorted = Sorted {
        all: items.len(),
        done: Vec::new(),
        unreadable: Vec::new(),
        jobs: Vec::new(),
        changed: 0,
        replaced: 0,
    };
    for item in items {
        let folder = args.out.join(&item.name);
        let input = match digest::of_input(&item.path) {
            Ok(input) => input,
            Err(e) => {
                let reason = format!(
                    "{}: expected a data set folder or a recording, found: {e}",
                    item.path.display()
                );
                console::line(&format!("{}: failed: {reason}", item.name));
                let nothing = digest::InputDigest::default();
                sorted.unreadable.push(Row {
                    error: Some(reason),
                    ..Row::new(&item, &nothing, method)
                });
                continue;
            }
        };
        let job = Job {
            row: Row::new(&item, &input, method),
            item,
        };
        match Row::read(&folder) {
            None => {}
            Some(row) if row.input_sha256 != input.sha256 => sorted.changed += 1,
            Some(row) if row.method == *method => {
                sorted.done.push(row);
                continue;
            }
            Some(_) if args.replace => sorted.replaced += 1,
            Some(row) => return Err(foreign(&folder, &row, method)),
        }
        sorted.jobs.push(job);
    }
    Ok(sorted)
}

/// Error: a result of another program or configuration, which would be lost.
fn foreign(folder: &Path, row: &Row, method: &Method) -> Failure {
    let found = if row.method.program_sha256 == method.program_sha256 {
        "one of another configuration".to_owned()
    } else {
        let (version, here) = (&row.method.stillpoint, &method.stillpoint);
        let same = if version == here {
            ", built otherwise"
        } else {
            ""
        };
        format!("one of another program (Stillpoint {version}{same}; this is {here})")
    };
    Failure::input(format!(
        "{}: expected no result, or one of this program and configuration, found {found}; name another folder with --out, or run all of these again with --replace",
        folder.display()
    ))
}
