//! Runs one recording in a separate process: starts it, and ends it on timeout or when the batch stops.

use crate::batch::inputs::Item;
use crate::batch::row::{Figures, Outcome};
use crate::failure::Failure;
use crate::run::summary::Summary;
use std::ffi::OsString;
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Messages of a run, in its result folder.
const SAID: &str = "stderr.log";

/// Environment variable with the id of the parent process; the run ends with that process.
pub(crate) const PARENT: &str = "STILLPOINT_PARENT";

/// Interval at which a run is polled: a hundredth of a short run, at negligible cost.
const PAUSE: Duration = Duration::from_millis(10);

/// Error numbers at the end of the system's messages: file size limit, full disk, exhausted quota.
const FULL: [&str; 3] = ["(os error 27)", "(os error 28)", "(os error 122)"];

#[derive(Debug)]
pub(crate) enum End {
    Done(Outcome, Box<Figures>),
    /// Without a result; the reason.
    Failed(String),
    Full(String),
    Stopped,
}

#[derive(Clone, Copy)]
pub(crate) struct Runner<'a> {
    /// Worker threads of a run; `None` where the environment sets them.
    pub(crate) threads: Option<usize>,
    pub(crate) time_limit: Option<Duration>,
    pub(crate) is_stopped: &'a (dyn Fn() -> bool + Sync),
}

impl Runner<'_> {
    /// Runs one recording into `folder`.
    pub(crate) fn run(&self, item: &Item, arguments: &[OsString], folder: &Path) -> End {
        match self.start(item, arguments, folder) {
            Ok(child) => self.watch(child, folder),
            Err(e) => failed(e.to_string()),
        }
    }

    fn start(&self, item: &Item, arguments: &[OsString], folder: &Path) -> Result<Child, Failure> {
        let write = |e: std::io::Error| Failure::write(folder, &e);
        std::fs::create_dir_all(folder).map_err(write)?;
        let said = File::create(folder.join(SAID)).map_err(write)?;
        let wrong = |e: std::io::Error| {
            Failure::input(format!("expected to start this program, found: {e}"))
        };
        let mut command = crate::program().map_err(wrong)?;
        command
            .arg("run")
            .arg(absolute(&item.path))
            .arg("--out")
            .arg(folder)
            .args(arguments)
            .env(PARENT, std::process::id().to_string())
            .envs(self.threads.map(|n| ("STILLPOINT_WORKERS", n.to_string())))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(said);
        alone(&mut command);
        command.spawn().map_err(wrong)
    }

    fn watch(&self, mut child: Child, folder: &Path) -> End {
        let begin = Instant::now();
        let end = |mut child: Child| {
            // Fails if it ended by itself, which is fine.
            let _ = child.kill();
            let _ = child.wait();
        };
        loop {
            match child.try_wait() {
                Ok(Some(status)) => return ended(status, folder),
                Ok(None) => {}
                Err(e) => {
                    end(child);
                    return End::Failed(format!("expected to wait for the run, found: {e}"));
                }
            }
            if (self.is_stopped)() {
                end(child);
                return End::Stopped;
            }
            if let Some(limit) = self.time_limit.filter(|l| begin.elapsed() > *l) {
                end(child);
                return End::Failed(format!("took longer than {} s", limit.as_secs_f64()));
            }
            std::thread::sleep(PAUSE);
        }
    }
}

/// An absolute path, so that a leading dash is not read as an option.
fn absolute(path: &Path) -> std::path::PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Puts the run in its own process group: Ctrl-C in a terminal reaches only the batch, which decides about its runs.
fn alone(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(windows)]
    {
        const NEW_GROUP: u32 = 0x200;
        std::os::windows::process::CommandExt::creation_flags(command, NEW_GROUP);
    }
    #[cfg(not(any(unix, windows)))]
    let _ = command;
}

/// Outcome of a run that ended by itself.
fn ended(status: ExitStatus, folder: &Path) -> End {
    let outcome = match status.code() {
        Some(0) => Outcome::Ok,
        Some(1) => Outcome::Lost,
        _ => return failed(reason(status, folder)),
    };
    let file = folder.join("summary.json");
    let summary = std::fs::read_to_string(&file)
        .map_err(|e| e.to_string())
        .and_then(|text| serde_json::from_str::<Summary>(&text).map_err(|e| e.to_string()));
    match summary {
        Ok(s) if s.interrupted => {
            End::Failed("something else than the batch interrupted it".into())
        }
        Ok(s) => End::Done(outcome, Box::new(Figures::from(&s))),
        Err(e) => failed(format!(
            "{}: expected the summary of a run, found: {e}",
            file.display()
        )),
    }
}

pub(crate) fn failed(reason: String) -> End {
    if FULL.iter().any(|full| reason.contains(full)) {
        End::Full(reason)
    } else {
        End::Failed(reason)
    }
}

/// Why a run failed: its error message, else the last line that it printed.
fn reason(status: ExitStatus, folder: &Path) -> String {
    let said = std::fs::read(folder.join(SAID)).unwrap_or_default();
    let said = String::from_utf8_lossy(&said);
    let lines = || said.lines().rev().map(str::trim).filter(|l| !l.is_empty());
    if let Some(error) = lines().find_map(|l| l.strip_prefix("error: ")) {
        return error.to_owned();
    }
    match lines()
        .find(|l| l.contains("panicked at"))
        .or(lines().next())
    {
        Some(last) => format!("{status}: {last}"),
        None => status.to_string(),
    }
}

/// Ends this run when its batch ends, however that happens. Linux only; elsewhere the run continues to its end.
pub(crate) fn end_with_parent() {
    #[cfg(target_os = "linux")]
    if let Some(parent) = std::env::var_os(PARENT) {
        use rustix::process::{Signal, getppid, set_parent_process_death_signal};
        let _ = set_parent_process_death_signal(Some(Signal::KILL));
        let now = getppid().map(|p| p.as_raw_nonzero().to_string());
        // The parent may have ended before.
        if now.is_some_and(|now| parent != now.as_str()) {
            std::process::exit(i32::from(crate::failure::Status::Unusable.code()));
        }
    }
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;

    #[test]
    fn failure_reason_is_the_last_message_of_the_run() {
        let dir = tempfile::tempdir().unwrap();
        let of = |status: i32, said: &str| {
            std::fs::write(dir.path().join(SAID), said).unwrap();
            match ended(ExitStatus::from_raw(status), dir.path()) {
                End::Failed(reason) => reason,
                End::Full(reason) => format!("full: {reason}"),
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(of(2 << 8, "a\nerror: no frames\n\n"), "no frames");
        assert_eq!(
            of(
                2 << 8,
                "error: x: found: No space left on device (os error 28); check\n"
            ),
            "full: x: found: No space left on device (os error 28); check"
        );
        assert_eq!(of(11, ""), "signal: 11 (SIGSEGV)");
        assert_eq!(
            of(
                101 << 8,
                "thread 'main' panicked at a.rs:1:2:\nindex\nnote: run with\n"
            ),
            "exit status: 101: thread 'main' panicked at a.rs:1:2:"
        );
        assert!(of(0, "").contains("summary.json: expected the summary"));
    }
}
