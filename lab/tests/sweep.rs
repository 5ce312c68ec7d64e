//! `lab sweep` and `lab compare` on simulated scenes. Controls: a known regression is found worse, and two runs of one program are equal.

use crate::{lab, program};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Long enough for walkers to corrupt the pose without the filter.
const FRAMES: &str = "90";
const VARIANTS: [&str; 4] = [
    "--variant",
    "default=",
    "--variant",
    "off=--set static_filter.preset=off",
];

/// A scene with walkers, rendered once for all tests.
pub(crate) fn scene() -> &'static Path {
    static SCENE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, folder) = SCENE.get_or_init(|| {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("walkers");
        let mut simulate = Command::new(program());
        simulate.args([
            "-q",
            "simulate",
            "--scene",
            "walking_xyz",
            "--frames",
            FRAMES,
        ]);
        let status = simulate.arg("--out").arg(&folder).status().unwrap();
        assert!(status.success(), "{status}");
        (dir, folder)
    });
    folder
}

fn sweep_over(input: &str, file: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    let (program, work) = (program(), file.with_extension("work"));
    let mut words = vec!["sweep", input, "--commit", "here"];
    words.extend(["--program", program.to_str().unwrap()]);
    words.extend(["--out", file.to_str().unwrap()]);
    words.extend(["--work", work.to_str().unwrap()]);
    words.extend(more);
    lab(&words)
}

/// Runs a sweep over the scene with walkers into a file.
fn sweep(file: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    sweep_over(scene().to_str().unwrap(), file, more)
}

/// Runs with the static filter and without, of six seeds each, made once.
fn runs() -> &'static Path {
    static RUNS: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, file) = RUNS.get_or_init(|| {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("runs.jsonl");
        let more = [&VARIANTS[..], &["--seeds", "6"]].concat();
        let (code, out, said) = sweep(&file, &more);
        assert_eq!(code, Some(0), "{out}{said}");
        assert!(said.contains("12/12 walkers"), "{said}");
        (dir, file)
    });
    file
}

fn which(file: &Path, which: &str) -> String {
    format!("{}#{which}", file.display())
}

/// The cells of a comparison's first row about a figure.
fn row(table: &str, figure: &str) -> Vec<String> {
    let cells = |l: &str| -> Vec<String> { l.split('|').map(|c| c.trim().to_owned()).collect() };
    let mut rows = table.lines().map(cells);
    rows.find(|c| c.get(2).is_some_and(|c| c == figure))
        .unwrap_or_else(|| panic!("no row about {figure} in {table}"))
}

#[test]
fn regression_is_found_worse() {
    let (on, off) = (which(runs(), "default"), which(runs(), "off"));
    let (code, out, said) = lab(&["compare", &on, &off]);
    assert_eq!(code, Some(1), "{out}{said}");
    let ate = row(&out, "ATE, mm");
    assert_eq!((ate[3].as_str(), ate[8].as_str()), ("6", "WORSE"), "{out}");
    assert!(ate[6].parse::<f64>().unwrap() > 2.0, "{out}");
    assert!(out.contains("B is WORSE: walkers: ATE, mm"), "{out}");
    // Vice versa the error is better; the filter's cost is printed.
    let (code, out, said) = lab(&["compare", &off, &on]);
    assert_eq!(row(&out, "ATE, mm")[8], "better", "{out}{said}");
    assert!(out.contains("better: walkers: ATE, mm;"), "{out}");
    let worse = out.lines().find(|l| l.starts_with("B is WORSE"));
    assert_eq!(code, Some(i32::from(worse.is_some())), "{out}");
    assert!(
        worse.is_none_or(|l| l == "B is WORSE: walkers: memory, MB"),
        "{out}"
    );
}

#[test]
fn repeated_runs_of_one_program_are_equal() {
    let dir = tempfile::tempdir().unwrap();
    let again = dir.path().join("again.jsonl");
    let (code, out, said) = sweep(&again, &["--seeds", "2"]);
    assert_eq!(code, Some(0), "{out}{said}");
    let first = which(runs(), "default");
    let (code, out, said) = lab(&["compare", &first, again.to_str().unwrap()]);
    assert_eq!(code, Some(0), "{out}{said}");
    for figure in ["ATE, mm", "ATE at each frame, mm"] {
        let cells = row(&out, figure);
        assert_eq!(cells[4], cells[5], "{out}");
        assert_eq!(
            cells[6..9],
            ["1.000", "1.000 to 1.000", "the same"],
            "{out}"
        );
    }
    for figure in ["lost frames", "wrong frames"] {
        assert_eq!(row(&out, figure)[8], "the same", "{out}");
    }
    for seed in 2..6 {
        let line = format!("only in A: walkers, seed {seed}\n");
        assert!(out.contains(&line), "{out}");
    }
    assert!(!out.contains("only in B"), "{out}");
}

#[test]
fn interrupted_sweep_is_resumed() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("runs.jsonl");
    let whole = std::fs::read_to_string(runs()).unwrap();
    // Simulates a process killed while writing the last line.
    std::fs::write(&file, &whole[..whole.len() - 50]).unwrap();
    let more = [&VARIANTS[..], &["--seeds", "6"]].concat();
    let (code, out, said) = sweep(&file, &more);
    assert_eq!(code, Some(0), "{out}{said}");
    assert!(said.contains("was not written to its end"), "{said}");
    assert!(
        said.contains("11 of 12 runs are in") && said.contains("1/1 "),
        "{said}"
    );
    let text = std::fs::read_to_string(&file).unwrap();
    let ates = |text: &str| -> Vec<String> {
        let after = text.split("\"ate_mm\":").skip(1);
        let mut all: Vec<String> = after
            .map(|t| t.split(',').next().unwrap().to_owned())
            .collect();
        all.sort();
        all
    };
    assert_eq!(ates(&text), ates(&whole));
    let (_, _, said) = sweep(&file, &more);
    assert!(
        said.contains("12 of 12 runs are in") && !said.contains("1/"),
        "{said}"
    );
}

#[test]
fn failed_runs_are_recorded_and_reported() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("runs.jsonl");
    let variants = [
        "--variant",
        "default=",
        "--variant",
        "broken=--set no.such=1",
    ];
    let (code, out, said) = sweep(&file, &variants);
    assert_eq!(code, Some(1), "{out}{said}");
    let told: Vec<&str> = said.lines().filter(|l| l.contains("FAILED")).collect();
    assert_eq!(told.len(), 1, "{said}");
    assert!(
        told[0].starts_with("walkers broken seed 0 FAILED: exit status: 2: "),
        "{said}"
    );
    assert!(told[0].contains("no"), "{said}");
    assert!(out.contains("1, 1 failed"), "{out}");
    let (code, out, _) = lab(&["compare", &which(&file, "default"), &which(&file, "broken")]);
    assert_eq!(code, Some(1), "{out}");
    assert!(
        out.contains("seed 0: B has no error: exit status: 2"),
        "{out}"
    );

    let late = dir.path().join("late.jsonl");
    let short = |more: &[&str]| sweep_over("sim:xyz", &late, &[&["--frames", "5"], more].concat());
    let (code, _, said) = short(&["--timeout", "0"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("simulating xyz with seed 0: timed out after 0 s"),
        "{said}"
    );
    let (code, _, said) = short(&[]);
    assert_eq!(
        code,
        Some(1),
        "it is not run again unless asked for: {said}"
    );
    let (code, out, said) = short(&["--retry"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(out.contains("| `sim:xyz` | default |    1 |"), "{out}");
}

#[test]
fn invalid_arguments_are_refused_at_once() {
    for (words, part) in [
        (
            vec!["sweep", "sim:nowhere"],
            "one of the simulator's scenes",
        ),
        (
            vec!["sweep", "sim:xyz", "--program", "/no/such"],
            "cargo build --release",
        ),
        (
            vec!["compare", "/no/such", "/no/such"],
            "expected a result file",
        ),
    ] {
        let mut words = words;
        let program = program();
        if words[0] == "sweep" && !words.contains(&"--program") {
            words.extend(["--program", program.to_str().unwrap()]);
        }
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("runs.jsonl");
        if words[0] == "sweep" {
            words.extend(["--out", file.to_str().unwrap()]);
        }
        let (code, _, said) = lab(&words);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(part), "{said}");
        assert!(!file.exists());
    }
}
