//! Origin of figures: commit, program and machine.

use crate::Failure;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::Command;
use stillpoint_files::sha256_hex;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Machine {
    /// The CPU's model name, else its architecture.
    pub(crate) cpu: String,
    pub(crate) cores: usize,
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {} cores", self.cpu, self.cores)
    }
}

impl Machine {
    pub(crate) fn here() -> Self {
        let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let named = text.lines().find(|l| l.starts_with("model name"));
        let cpu = named.and_then(|l| l.split_once(':'));
        Self {
            cpu: cpu.map_or(std::env::consts::ARCH.to_owned(), |(_, v)| {
                v.trim().to_owned()
            }),
            cores: cores(),
        }
    }
}

/// The command line as shown in documents.
pub(crate) fn command() -> String {
    let words = std::env::args().skip(1).map(|word| {
        if word.contains([' ', '{', '*']) || word.is_empty() {
            format!("'{word}'")
        } else {
            word
        }
    });
    std::iter::once("lab".to_owned())
        .chain(words)
        .collect::<Vec<_>>()
        .join(" ")
}

pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

pub(crate) fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    root.canonicalize().unwrap_or(root)
}

/// The output of `git` in a folder; `None` if it fails.
fn git(folder: &Path, words: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .arg("-C")
        .arg(folder)
        .args(words)
        .output();
    let output = output.ok().filter(|o| o.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// The commit of a checkout, with a `+` if tracked files were changed; `unknown` outside of one.
pub(crate) fn commit(folder: &Path) -> String {
    let Some(head) = git(folder, &["rev-parse", "--short=12", "HEAD"]) else {
        return "unknown".to_owned();
    };
    let changed = git(folder, &["status", "--porcelain", "--untracked-files=no"]);
    let mark = if changed.is_some_and(|c| !c.is_empty()) {
        "+"
    } else {
        ""
    };
    head + mark
}

/// The first 12 digits of a file's SHA-256.
pub(crate) fn hash(file: &Path) -> Result<String, Failure> {
    let bytes = std::fs::read(file).map_err(|e| {
        format!(
            "{}: expected the program `stillpoint`, found: {e}; build it with `cargo build --release`, or name another one with --program",
            file.display()
        )
    })?;
    Ok(sha256_hex(&bytes).chars().take(12).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn program_is_hashed_and_a_missing_one_gets_advice() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("program");
        std::fs::write(&file, "abc").unwrap();
        assert_eq!(hash(&file).unwrap(), "ba7816bf8f01");
        let e = hash(&dir.path().join("no")).unwrap_err().to_string();
        assert!(e.contains("cargo build --release"), "{e}");
        assert_eq!(commit(dir.path()), "unknown");
    }
}
