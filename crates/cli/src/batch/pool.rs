//! Runs jobs in parallel and shows the progress.

use crate::args::batch::BatchArgs;
use crate::args::forward;
use crate::batch::budget::Budget;
use crate::batch::child::{End, Runner};
use crate::batch::digest::of_input;
use crate::batch::row::{Job, Outcome, Row, rounded};
use crate::console::{self, Progress, Unit};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Attempts per recording: a failure may be due to the load of the machine.
const ATTEMPTS: u32 = 2;

/// Interval between updates of the progress.
const PAUSE: Duration = Duration::from_millis(200);

#[derive(Debug, Default)]
pub(crate) struct Ran {
    /// Rows of the recordings that ended, successfully or not.
    pub(crate) rows: Vec<Row>,
    /// Message about a full disk, of a run or of this program.
    pub(crate) full: Option<String>,
}

enum Said {
    /// A recording ended for good.
    Row(Box<Row>),
    /// A recording failed and is retried: name and reason.
    Again(String, String),
    Full(String),
}

pub(crate) struct Pool<'a> {
    pub(crate) args: &'a BatchArgs,
    pub(crate) budget: &'a Budget,
    pub(crate) interrupt: &'a Interrupt,
}

impl Pool<'_> {
    /// Runs all jobs; ends early on Ctrl-C or a full disk.
    pub(crate) fn run(&self, mut jobs: Vec<Job>) -> Ran {
        if self.budget.workers > 1 {
            // The longest first, so that it does not start when the other workers are done.
            jobs.sort_by_key(|j| std::cmp::Reverse(j.row.input_bytes));
        }
        let mut shown = Shown::new(&jobs);
        let queue = Mutex::new(VecDeque::from(jobs));
        let is_full = AtomicBool::new(false);
        let mut ran = Ran::default();
        let (sender, said) = channel();
        std::thread::scope(|scope| {
            for _ in 0..self.budget.workers {
                let sender = sender.clone();
                let (queue, is_full) = (&queue, &is_full);
                scope.spawn(move || self.work(queue, is_full, &sender));
            }
            drop(sender);
            loop {
                match said.recv_timeout(PAUSE) {
                    Ok(Said::Row(row)) => {
                        shown.ended(&row);
                        ran.rows.push(*row);
                    }
                    Ok(Said::Again(name, reason)) => {
                        console::line(&format!("{name}: failed, tried again later: {reason}"));
                    }
                    Ok(Said::Full(reason)) => ran.full = Some(reason),
                    Err(RecvTimeoutError::Timeout) => shown.progress(),
                    Err(RecvTimeoutError::Disconnected) => break,
                }
            }
        });
        shown.finish();
        ran
    }

    /// Takes jobs until none is left or the batch stops.
    fn work(&self, queue: &Mutex<VecDeque<Job>>, is_full: &AtomicBool, sender: &Sender<Said>) {
        let jobs = || queue.lock().unwrap_or_else(PoisonError::into_inner);
        let is_stopped = || self.interrupt.requested() || is_full.load(Ordering::Relaxed);
        let runner = Runner {
            threads: self.budget.threads,
            time_limit: self.args.time_limit.map(Duration::from_secs_f64),
            is_stopped: &is_stopped,
        };
        while !is_stopped() {
            let job = jobs().pop_front();
            let Some(mut job) = job else {
                return;
            };
            job.row.attempts += 1;
            let said = match self.once(&runner, &mut job) {
                End::Stopped => return,
                End::Full(reason) => {
                    is_full.store(true, Ordering::Relaxed);
                    Said::Full(format!("{}: {reason}", job.item.name))
                }
                End::Failed(reason) if job.row.attempts < ATTEMPTS => {
                    let name = job.item.name.clone();
                    // At the end of the queue: the cause of the failure may be gone by then.
                    jobs().push_back(job);
                    Said::Again(name, reason)
                }
                End::Failed(reason) => {
                    job.row.error = Some(reason);
                    Said::Row(Box::new(job.row))
                }
                End::Done(..) => Said::Row(Box::new(job.row)),
            };
            // The receiver ends only after this.
            let _ = sender.send(said);
        }
    }

    fn once(&self, runner: &Runner<'_>, job: &mut Job) -> End {
        let folder = self.args.out.join(&job.item.name);
        if let Err(e) = Row::remove(&folder) {
            return End::Failed(Failure::write(&folder, &e).to_string());
        }
        let mut arguments = forward::typed(&self.args.input, &self.args.config, &job.item.path);
        arguments.extend(self.args.each.typed(&folder));
        let begin = Instant::now();
        let end = runner.run(&job.item, &arguments, &folder);
        job.row.seconds = rounded(begin.elapsed().as_secs_f64());
        let End::Done(outcome, figures) = &end else {
            return end;
        };
        if !of_input(&job.item.path).is_ok_and(|now| now.sha256 == job.row.input_sha256) {
            return End::Failed("the recording changed while it was run".to_owned());
        }
        job.row.outcome = *outcome;
        job.row.figures = (**figures).clone();
        match job.row.write(&folder) {
            Ok(()) => end,
            Err(e) => {
                job.row.outcome = Outcome::Failed;
                job.row.figures = Default::default();
                crate::batch::child::failed(e.to_string())
            }
        }
    }
}

struct Shown {
    begin: Instant,
    done: usize,
    all: usize,
    done_bytes: u64,
    all_bytes: u64,
    bar: Progress,
}

impl Shown {
    fn new(jobs: &[Job]) -> Self {
        let all_bytes = jobs.iter().map(|j| weight(&j.row)).sum();
        Self {
            begin: Instant::now(),
            done: 0,
            all: jobs.len(),
            done_bytes: 0,
            all_bytes,
            bar: Progress::of(Unit::Bytes, Some(all_bytes as usize), 0),
        }
    }

    /// Prints a line for a recording that ended.
    fn ended(&mut self, row: &Row) {
        self.done += 1;
        self.done_bytes += weight(row);
        let (done, all, name, words) = (self.done, self.all, &row.name, row.words());
        if row.outcome == Outcome::Failed {
            console::line(&format!(
                "[{done}/{all}] {name}: failed, after {}: {words}",
                console::counted(row.attempts as usize, "run")
            ));
        } else {
            let left = self.left();
            console::info(&format!("[{done}/{all}] {name}: {words}{left}"));
        }
    }

    /// Remaining time, by the bytes processed until now.
    fn left(&self) -> String {
        let left = self.all_bytes.saturating_sub(self.done_bytes);
        if self.done_bytes == 0 || left == 0 {
            return String::new();
        }
        let pace = self.begin.elapsed().as_secs_f64() / self.done_bytes as f64;
        format!("; {} left", duration(pace * left as f64))
    }

    fn progress(&mut self) {
        // The pace is unknown until the first one has ended.
        if self.done > 0 {
            let note = format!(", {} of {} recordings", self.done, self.all);
            self.bar.show(self.done_bytes as usize, &note);
        }
    }

    fn finish(&self) {
        self.bar.finish();
    }
}

/// The size that a run's duration is assumed to be proportional to.
fn weight(row: &Row) -> u64 {
    row.input_bytes.max(1)
}

pub(crate) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 99.5 => format!("{s:.0} s"),
        s if s < 99.5 * 60.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_shown_with_two_digits() {
        for (seconds, said) in [
            (3.4, "3 s"),
            (90.0, "90 s"),
            (600.0, "10 min"),
            (7200.0, "2.0 h"),
        ] {
            assert_eq!(duration(seconds), said);
        }
    }
}
