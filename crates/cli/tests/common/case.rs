//! A valid data set to damage, with an older result beside it.

use super::{check, copy, files, program, simulate};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;

pub const FRAMES: usize = 12;

/// A valid data set, made once.
static GOOD: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "xyz", FRAMES);
    dir
});

/// A copy of the valid data set, with an older result beside it.
pub struct Case {
    pub dir: TempDir,
}

impl Case {
    pub fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        copy(&GOOD.path().join("room"), &dir.path().join("room"));
        std::fs::create_dir(dir.path().join("out")).unwrap();
        std::fs::write(dir.path().join("out/trajectory.txt"), "old").unwrap();
        Self { dir }
    }

    pub fn room(&self) -> PathBuf {
        self.dir.path().join("room")
    }

    pub fn out(&self) -> PathBuf {
        self.dir.path().join("out")
    }

    pub fn edit(&self, name: &str, change: impl Fn(&str) -> String) -> &Self {
        let path = self.room().join(name);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(path, change(&text)).unwrap();
        self
    }

    pub fn images(
        &self,
        folder: &str,
        which: impl Fn(usize) -> bool,
        write: impl Fn(&Path),
    ) -> &Self {
        for (i, path) in files(&self.room().join(folder)).iter().enumerate() {
            if which(i) {
                write(path);
            }
        }
        self
    }

    pub fn run(&self, more: &[&str]) -> std::process::Output {
        program()
            .arg("run")
            .arg(self.room())
            .arg("--out")
            .arg(self.out())
            .args(more)
            .output()
            .unwrap()
    }

    /// Expects exit code 2, the parts in the message, and the older result unchanged.
    #[track_caller]
    pub fn fails(&self, more: &[&str], parts: &[&str]) {
        let output = self.run(more);
        check(&output, 2, parts);
        check(&output, 2, &["error: ", "expected", "found"]);
        self.old_result_is_untouched();
    }

    #[track_caller]
    pub fn old_result_is_untouched(&self) {
        let names: Vec<_> = files(&self.out());
        assert_eq!(names, [self.out().join("trajectory.txt")]);
        let old = std::fs::read_to_string(self.out().join("trajectory.txt")).unwrap();
        assert_eq!(old, "old");
    }
}
