//! Locates uncommitted test data (recordings, models, pictures), and provides a server on loopback. If
//! `STILLPOINT_SKIPS` names a file, used and missing data are recorded there: the test runner hides the output of
//! passing tests, so a skipped test would look like a passed one. `.ci/run` reads the file.
//!
//! A line is `used` or `skipped`, the test (crate and name), and the data or the reason for skipping, separated by
//! tabs.

pub mod ate;
pub mod server;

use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder of the data sets: `STILLPOINT_DATA`, else `../shared/data` beside the workspace.
pub fn folder() -> PathBuf {
    std::env::var_os("STILLPOINT_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    )
}

/// The folder of a recording; `None`, recorded as skipped, if missing.
pub fn recording(name: &str) -> Option<PathBuf> {
    found(
        folder().join(name),
        Path::is_dir,
        &format!("recording {name}"),
    )
}

/// A file in a folder beside the data sets, such as `models/yolox_nano_416.onnx`; `None`, recorded as skipped, if
/// missing.
pub fn beside(file: &str) -> Option<PathBuf> {
    found(folder().join("..").join(file), Path::exists, file)
}

fn found(path: PathBuf, is: fn(&Path) -> bool, what: &str) -> Option<PathBuf> {
    if is(&path) {
        note("used", what);
        return Some(path);
    }
    skipped(&format!("there is no {what}"));
    None
}

/// Records the current test, or the rest of it, as skipped, and prints the reason.
#[allow(clippy::print_stderr)]
pub fn skipped(reason: &str) {
    eprintln!("skipped: {reason}");
    note("skipped", reason);
}

/// Appends a line in one write, since tests run concurrently, also in several processes.
fn note(kind: &str, what: &str) {
    let Some(file) = std::env::var_os("STILLPOINT_SKIPS") else {
        return;
    };
    let thread = std::thread::current();
    let krate = std::env::var("CARGO_PKG_NAME").unwrap_or_default();
    let test = thread.name().unwrap_or("unnamed");
    let line = format!("{kind}\t{krate} {test}\t{what}\n");
    let opened = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(&file);
    let written = opened.and_then(|mut file| file.write_all(line.as_bytes()));
    assert!(
        written.is_ok(),
        "STILLPOINT_SKIPS: expected a file that lines can be appended to, found {}: {written:?}",
        Path::new(&file).display()
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Does nothing unless started as a child process with a folder and a file of notes.
    #[test]
    fn child_that_asks() {
        if std::env::var_os("STILLPOINT_TEST_CHILD").is_some() {
            assert!(recording("src").is_some() && recording("nowhere").is_none());
            assert!(beside("testdata/Cargo.toml").is_some() && beside("models/no.onnx").is_none());
        }
    }

    #[test]
    fn used_and_missing_data_is_recorded_per_test() {
        let notes = std::env::temp_dir().join(format!("stillpoint-skips-{}", std::process::id()));
        let output = std::process::Command::new(std::env::current_exe().expect("this program"))
            .args(["--exact", "tests::child_that_asks"])
            .env("STILLPOINT_TEST_CHILD", "1")
            .env("STILLPOINT_DATA", env!("CARGO_MANIFEST_DIR"))
            .env("CARGO_PKG_NAME", "krate")
            .env("STILLPOINT_SKIPS", &notes)
            .output();
        let text = std::fs::read_to_string(&notes).unwrap_or_default();
        let _ = std::fs::remove_file(&notes);
        let output = output.expect("the program starts");
        assert!(output.status.success(), "{output:?}");
        assert_eq!(
            text,
            "used\tkrate tests::child_that_asks\trecording src\n\
             skipped\tkrate tests::child_that_asks\tthere is no recording nowhere\n\
             used\tkrate tests::child_that_asks\ttestdata/Cargo.toml\n\
             skipped\tkrate tests::child_that_asks\tthere is no models/no.onnx\n"
        );
    }
}
