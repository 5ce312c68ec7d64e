//! Programs as child processes, one per run, to measure its memory and to isolate crashes.

use crate::Failure;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Polling interval for the end of a child, s: far below the shortest run.
const PAUSE: Duration = Duration::from_millis(10);

#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub(crate) path: PathBuf,
    pub(crate) timeout: Duration,
}

impl Program {
    /// Writes the output to a file in `scratch`. Exit codes other than 0 and 1 are errors: 1 means lost frames, which are a figure.
    pub(crate) fn call<S: AsRef<OsStr>>(
        &self,
        words: impl IntoIterator<Item = S>,
        scratch: &Path,
    ) -> Result<(), Failure> {
        let said = scratch.join("said.txt");
        let file = File::create(&said).map_err(|e| {
            format!(
                "{}: expected a file that can be written, found: {e}",
                said.display()
            )
        })?;
        let mut command = Command::new(&self.path);
        command
            .args(words)
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        let ended = wait(command.stderr(file), self.timeout)
            .map_err(|e| format!("{}: expected to run it, found: {e}", self.path.display()))?;
        let last = std::fs::read_to_string(&said).unwrap_or_default();
        let last = last.trim().lines().last().unwrap_or_default().to_owned();
        match ended {
            None => Err(format!("timed out after {:.0} s", self.timeout.as_secs_f64()).into()),
            Some(status) if matches!(status.code(), Some(0 | 1)) => Ok(()),
            Some(status) => Err(format!("{status}: {}", last.trim_start_matches("error: ")).into()),
        }
    }

    /// Atomic.
    pub(crate) fn simulate(
        &self,
        scene: &str,
        seed: u64,
        frames: Option<u64>,
        out: &Path,
    ) -> Result<(), Failure> {
        let scratch = out.with_extension("part");
        let _ = std::fs::remove_dir_all(&scratch);
        std::fs::create_dir_all(&scratch)?;
        let folder = scratch.join("scene");
        let mut words: Vec<OsString> = ["-q", "simulate", "--scene", scene, "--seed"]
            .map(Into::into)
            .into();
        words.extend([
            seed.to_string().into(),
            "--out".into(),
            folder.clone().into(),
        ]);
        if let Some(n) = frames {
            words.extend(["--frames".into(), n.to_string().into()]);
        }
        let done = self.call(words, &scratch).and_then(|()| {
            std::fs::rename(&folder, out)?;
            Ok(())
        });
        let _ = std::fs::remove_dir_all(&scratch);
        done.map_err(|e| format!("simulating {scene} with seed {seed}: {e}").into())
    }
}

/// Kills the child at the timeout and returns `None`.
fn wait(command: &mut Command, timeout: Duration) -> std::io::Result<Option<ExitStatus>> {
    let (mut child, begun) = (command.spawn()?, Instant::now());
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if begun.elapsed() > timeout {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(PAUSE);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn failures_and_timeouts_of_programs_are_reported() {
        let dir = tempfile::tempdir().unwrap();
        let shell = Program {
            path: "/bin/sh".into(),
            timeout: Duration::from_millis(300),
        };
        let call = |text: &str| {
            let done = shell.call(["-c", text], dir.path());
            done.map_err(|e| e.to_string())
        };
        assert_eq!(call("exit 1"), Ok(()));
        let e = call("echo first >&2; echo 'error: no such scene' >&2; exit 2").unwrap_err();
        assert_eq!(e, "exit status: 2: no such scene");
        let e = call("kill -9 $$").unwrap_err();
        assert!(e.starts_with("signal: 9"), "{e}");
        let begun = Instant::now();
        assert_eq!(call("exec sleep 60").unwrap_err(), "timed out after 0 s");
        assert!(begun.elapsed() < Duration::from_secs(20));
    }
}
