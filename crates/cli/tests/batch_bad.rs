//! `batch` with bad input and failures: a clear error, and no lost results.

use crate::batch::{batch, rooms, row, table};
use crate::common::{check, program, shell, simulate, stderr};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

#[test]
fn invalid_inputs_are_reported_before_any_output() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let twin = dir.path().join("a");
    std::fs::create_dir(&twin).unwrap();
    let list = dir.path().join("list.txt");
    std::fs::write(&list, "# nothing\n").unwrap();
    let (a, nothing) = (rooms().join("a"), rooms().join("*.bag"));
    let listed: PathBuf = format!("@{}", list.display()).into();
    let absent: PathBuf = format!("@{}", dir.path().join("no.txt").display()).into();
    let (a_said, twin_said) = (a.display().to_string(), twin.display().to_string());
    for (inputs, more, parts) in [
        (
            vec![a.clone(), twin],
            vec![],
            vec![a_said.as_str(), &twin_said, "both a", "--name-parts 2"],
        ),
        (vec![nothing], vec![], vec!["*.bag", "found none"]),
        (vec![listed], vec![], vec!["list.txt", "found none"]),
        (vec![absent], vec![], vec!["no.txt", "expected a list"]),
        (
            vec![a.clone()],
            vec!["--shard", "5/4"],
            vec!["5/4", "from 1 to 4"],
        ),
        (
            vec![a.clone()],
            vec!["--shard", "0/4"],
            vec!["count from 0"],
        ),
        (
            vec![a.clone()],
            vec!["--save-map", "/tmp/m"],
            vec!["within the result folder"],
        ),
        (vec![a.clone()], vec!["--set", "no.such=1"], vec!["no.such"]),
        (vec![], vec![], vec!["INPUT"]),
    ] {
        check(&batch(&inputs, &out, &more), 2, &parts);
        assert!(!out.exists(), "{parts:?}");
    }
    let file = dir.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    check(
        &batch(&[a], &file, &[]),
        2,
        &["expected a folder to write to"],
    );
}

/// A file size limit acts like a full disk.
#[test]
#[cfg(unix)]
fn full_disk_ends_the_batch_and_keeps_finished_results() {
    let dir = tempfile::tempdir().unwrap();
    let (long, out) = (dir.path().join("b_long"), dir.path().join("out"));
    simulate(&long, "xyz", 60);
    let inputs = [rooms().join("a"), long, rooms().join("d")];
    let size = |name: &str| {
        let files = std::fs::read_dir(out.join(name)).unwrap();
        files
            .map(|f| f.unwrap().metadata().unwrap().len())
            .max()
            .unwrap()
    };
    check(&batch(&inputs, &out, &[]), 0, &[]);
    let (small, large) = (size("a"), size("b_long"));
    assert!(large > small + 8192, "{small} {large}");
    std::fs::remove_dir_all(&out).unwrap();
    let blocks = (small + large) / 2 / 512;
    let script = format!(
        "trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" batch \"$1\" \"$2\" \"$3\" --out \"$4\" --workers 1"
    );
    let output = shell(&script, inputs.iter().chain([&out]));
    check(
        &output,
        2,
        &[
            "is full; 1 of 3 recordings are done and kept",
            "make room and run the same batch again",
        ],
    );
    assert_eq!(row(&table(&out), "a")["outcome"], "ok");
    assert!(!out.join("d").exists());
    check(
        &batch(&inputs, &out, &["--workers", "1"]),
        0,
        &["1 of 3 recordings skipped"],
    );
}

/// A batch that is processing a long recording after a short one.
#[cfg(unix)]
struct Working {
    child: Child,
    said: BufReader<std::process::ChildStderr>,
    out: PathBuf,
    inputs: Vec<PathBuf>,
    _dir: tempfile::TempDir,
}

#[cfg(unix)]
impl Working {
    fn start() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (long, out) = (dir.path().join("long"), dir.path().join("out"));
        simulate(&long, "xyz", 60);
        let inputs = vec![rooms().join("d"), long];
        let mut child = program()
            .arg("batch")
            .args(&inputs)
            .arg("--out")
            .arg(&out)
            .args(["--workers", "1"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        while !line.contains("[1/2]") {
            line.clear();
            assert!(said.read_line(&mut line).unwrap() > 0, "it ended");
        }
        Self {
            child,
            said,
            out,
            inputs,
            _dir: dir,
        }
    }

    fn send(id: u32, signal: &str) {
        let sent = Command::new("kill")
            .args([signal, &id.to_string()])
            .status();
        assert!(sent.unwrap().success());
    }

    #[cfg(target_os = "linux")]
    fn run(&self) -> u32 {
        let id = self.child.id();
        let begin = Instant::now();
        loop {
            // Each thread has its own children.
            let tasks = std::fs::read_dir(format!("/proc/{id}/task")).unwrap();
            let children = tasks
                .filter_map(|t| std::fs::read_to_string(t.unwrap().path().join("children")).ok());
            let all: Vec<String> = children.collect();
            if let Some(run) = all
                .iter()
                .find_map(|c| c.split_whitespace().next()?.parse().ok())
            {
                return run;
            }
            assert!(begin.elapsed() < Duration::from_secs(20), "no run");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Its messages up to its end, and its exit status.
    fn end(
        mut self,
    ) -> (
        Option<i32>,
        String,
        PathBuf,
        Vec<PathBuf>,
        tempfile::TempDir,
    ) {
        let mut said = String::new();
        self.said.read_to_string(&mut said).unwrap();
        (
            self.child.wait().unwrap().code(),
            said,
            self.out,
            self.inputs,
            self._dir,
        )
    }
}

#[test]
#[cfg(unix)]
fn interrupted_batch_keeps_results_and_resumes() {
    let working = Working::start();
    Working::send(working.child.id(), "-INT");
    let begin = Instant::now();
    let (code, said, out, inputs, _dir) = working.end();
    assert!(begin.elapsed() < Duration::from_secs(20));
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("interrupted: 1 recording left; the same command goes on"),
        "{said}"
    );
    let json = table(&out);
    assert_eq!(json["is_complete"], false);
    assert_eq!(json["recordings"].as_array().unwrap().len(), 1);
    check(
        &batch(&inputs, &out, &[]),
        0,
        &["1 of 2 recordings skipped"],
    );
    assert_eq!(table(&out)["is_complete"], true);
}

#[test]
#[cfg(target_os = "linux")]
fn folder_lock_and_runs_end_with_the_batch_process() {
    let mut working = Working::start();
    let second = batch(&working.inputs, &working.out, &[]);
    let process = format!("found that of process {}", working.child.id());
    check(&second, 2, &[process.as_str(), "wait for its end"]);
    let run = working.run();
    working.child.kill().unwrap();
    working.child.wait().unwrap();
    let begin = Instant::now();
    // A zombie process still has an entry.
    let lives =
        || std::fs::read_to_string(format!("/proc/{run}/stat")).is_ok_and(|s| !s.contains(") Z "));
    while lives() {
        assert!(begin.elapsed() < Duration::from_secs(10), "the run goes on");
        std::thread::sleep(Duration::from_millis(10));
    }
    check(
        &batch(&working.inputs, &working.out, &[]),
        0,
        &["1 of 2 recordings skipped"],
    );
}

#[test]
#[cfg(target_os = "linux")]
fn crashed_run_is_retried() {
    let working = Working::start();
    Working::send(working.run(), "-ABRT");
    let (code, said, out, _, _dir) = working.end();
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("long: failed, tried again later: signal: 6 (SIGABRT)"),
        "{said}"
    );
    assert_eq!(row(&table(&out), "long")["attempts"], 2);
}

#[test]
fn unfinished_result_is_rerun() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = [rooms().join("a")];
    check(&batch(&inputs, dir.path(), &[]), 0, &[]);
    // The state after a batch was killed while a run replaced its result.
    std::fs::remove_file(dir.path().join("a/recording.json")).unwrap();
    let again = batch(&inputs, dir.path(), &[]);
    check(&again, 0, &["[1/1] a:"]);
    assert!(!stderr(&again).contains("skipped"));
    assert!(Path::new(&dir.path().join("a/recording.json")).is_file());
}
