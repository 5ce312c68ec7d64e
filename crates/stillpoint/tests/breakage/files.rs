//! Exhausted file descriptors and full disks. These limits apply to a process, so each test starts its own.
#![cfg(unix)]

use super::corrupt::record;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use stillpoint_datasets::{AtomicFile, Dataset, FrameOptions, OpenOptions, write_atomic};
use stillpoint_imaging::FrameSource;

/// Environment variable with the child process's folder.
const FOLDER: &str = "STILLPOINT_TEST_BREAKAGE";

/// Runs one of the functions below under a limit; returns its output.
fn under(limit: &str, test: &str, folder: &Path) -> String {
    let script = format!(
        "{limit}; exec \"$0\" --exact breakage::files::{test} --nocapture --test-threads=1"
    );
    let output = Command::new("sh")
        .args(["-c", &script])
        .arg(std::env::current_exe().unwrap())
        .env(FOLDER, folder)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}\n{errors}");
    assert!(text.contains("came to its end"), "{text}\n{errors}");
    text
}

fn folder() -> Option<PathBuf> {
    std::env::var_os(FOLDER).map(PathBuf::from)
}

fn exhaust() -> Vec<File> {
    let mut files = Vec::new();
    while let Ok(file) = File::open("/dev/null") {
        files.push(file);
    }
    files
}

/// Not a test by itself: runs in the child without descriptors.
#[test]
fn child_without_descriptors() {
    let Some(folder) = folder() else { return };
    let room = folder.join("room");
    let all = exhaust();
    let refused = Dataset::open(&room, &OpenOptions::default()).err();
    drop(all);
    println!("open: {}", refused.unwrap());
    let dataset = Dataset::open(&room, &OpenOptions::default()).unwrap();
    let mut source = dataset.frames(&FrameOptions::default()).unwrap();
    assert!(source.next_frame().unwrap().is_ok());
    let all = exhaust();
    let unread = source.next_frame().unwrap().unwrap_err();
    let unwritten = write_atomic(&folder.join("result"), b"new").unwrap_err();
    drop(all);
    println!("frame: {unread}\nwrite: {unwritten}");
    assert!(unread.recoverable);
    // With descriptors again, reading continues.
    assert_eq!(source.next_frame().unwrap().unwrap().id.0, 2);
    println!("came to its end");
}

#[test]
fn exhausted_file_descriptors_give_clear_errors() {
    let dir = tempfile::tempdir().unwrap();
    record(&dir.path().join("room"), 0..4);
    std::fs::write(dir.path().join("result"), "old").unwrap();
    let text = under("ulimit -n 40", "child_without_descriptors", dir.path());
    for what in ["open: ", "frame: frame 1 ", "write: "] {
        let line = text.lines().find(|l| l.contains(what));
        let line = line.unwrap_or_else(|| panic!("no {what} in {text}"));
        assert!(
            line.to_lowercase().contains("too many open files"),
            "{line}"
        );
    }
    let kept = std::fs::read_to_string(dir.path().join("result")).unwrap();
    assert_eq!(kept, "old");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
}

/// Not a test by itself: runs in the child on a full disk.
#[test]
fn child_on_a_full_disk() {
    let Some(folder) = folder() else { return };
    let error = write_atomic(&folder.join("result"), &[1; 100_000]).unwrap_err();
    println!("at once: {error}");
    let mut file = AtomicFile::create(&folder.join("result")).unwrap();
    let part = vec![2; 1000];
    let written = (0..100).try_for_each(|_| std::io::Write::write_all(&mut file, &part));
    let error = written.and_then(|()| file.commit()).unwrap_err();
    println!("by parts: {error}\ncame to its end");
}

#[test]
fn full_disk_keeps_the_old_file() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("result"), "old").unwrap();
    // A file size limit behaves like a full disk: writing fails half-way.
    let limit = "trap '' XFSZ; ulimit -f 8";
    let text = under(limit, "child_on_a_full_disk", dir.path());
    assert!(
        text.contains("at once: ") && text.contains("by parts: "),
        "{text}"
    );
    let kept = std::fs::read_to_string(dir.path().join("result")).unwrap();
    assert_eq!(kept, "old");
    assert_eq!(
        std::fs::read_dir(dir.path()).unwrap().count(),
        1,
        "files are left over"
    );
    // A device that is always full.
    if Path::new("/dev/full").exists() {
        let error = write_atomic(Path::new("/dev/full"), b"new").unwrap_err();
        println!("{error}");
        assert!(error.to_string().contains("/dev/full"));
    }
}
