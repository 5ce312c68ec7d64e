//! A model cache per test, and files to put into it.

use super::server::Server;
use super::{program, tiny_model};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

pub struct Cache {
    pub dir: TempDir,
}

impl Cache {
    pub fn new() -> Self {
        Self {
            dir: tempfile::tempdir().unwrap(),
        }
    }

    pub fn program(&self) -> Command {
        let mut command = program();
        command.env("STILLPOINT_CACHE", self.dir.path());
        command
    }

    pub fn run<S: AsRef<std::ffi::OsStr>>(&self, args: &[S]) -> Output {
        self.program().args(args).output().unwrap()
    }

    pub fn pull(&self, name: &str, server: &Server) -> Output {
        self.run(&["models", "pull", name, "--mirror", &server.url])
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.dir.path().join("models").join(name)
    }

    /// Imports the file of the tiny network into the cache.
    pub fn import(&self, name: &str) -> Output {
        let file = tiny_model::write(self.dir.path());
        self.run(&["models", "import", file.to_str().unwrap(), "--name", name])
    }
}

/// A checkpoint with YOLOv7-tiny's layers and random weights.
pub fn checkpoint() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/tests/fixtures/idetect.pt")
}
