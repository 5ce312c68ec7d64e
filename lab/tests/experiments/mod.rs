//! Every experiment in a tiny size prints its table, and its exit code states whether the bounds are met.

mod recorded;
mod simulated;

use std::path::{Path, PathBuf};
use std::process::Command;

struct Done {
    code: i32,
    out: String,
    errors: String,
}

impl Done {
    /// The cells of all rows of all tables, without their heads.
    fn rows(&self) -> Vec<Vec<&str>> {
        let lines: Vec<&str> = self.out.lines().filter(|l| l.starts_with('|')).collect();
        let is_rule = |line: &str| line.chars().all(|c| "|-: ".contains(c));
        let is_head = |i: usize| lines.get(i + 1).is_some_and(|next| is_rule(next));
        let rows = (0..lines.len()).filter(|i| !is_rule(lines[*i]) && !is_head(*i));
        let cells = |i: usize| lines[i].trim_matches('|').split('|').map(str::trim);
        rows.map(|i| cells(i).collect()).collect()
    }

    fn with_code(self, code: i32) -> Self {
        let Self { out, errors, .. } = &self;
        assert_eq!(self.code, code, "{out}\n{errors}");
        self
    }
}

fn lab(arguments: &[&str]) -> Done {
    let output = Command::new(env!("CARGO_BIN_EXE_lab"))
        .args(arguments)
        .env("STILLPOINT_DATA", scratch("no-data"))
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Done {
        code: output.status.code().unwrap(),
        out: text(output.stdout),
        errors: text(output.stderr),
    }
}

fn scratch(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("experiments")
        .join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn number(cell: &str) -> f64 {
    cell.parse()
        .unwrap_or_else(|_| panic!("expected a number, found {cell:?}"))
}

#[test]
fn every_experiment_has_a_help_text() {
    let help = lab(&["--help"]).with_code(0).out;
    let commands = help.lines().skip_while(|l| *l != "Commands:").skip(1);
    let commands: Vec<&str> = commands.take_while(|l| !l.is_empty()).collect();
    assert!(commands.len() > 17, "{help}");
    for line in commands {
        assert!(line.split_whitespace().count() > 2, "{line:?} says nothing");
    }
}

#[test]
fn invalid_arguments_are_reported_with_exit_code_2() {
    for (arguments, said) in [
        (&["crowds", "--seeds", "1", "nowhere"][..], "nowhere"),
        (&["frame-time", "not/there"], "not/there"),
        (&["detectors", "not/there.onnx"], "not/there.onnx"),
        (&["place", "train", "out.bin"], "no-data"),
        (&["scale", "maps", "path", "1"], "2.."),
        (&["loops", "table", "--only", "nowhere.2"], "nowhere.2"),
    ] {
        let done = lab(arguments).with_code(2);
        assert!(done.errors.contains(said), "{arguments:?}: {}", done.errors);
    }
}
