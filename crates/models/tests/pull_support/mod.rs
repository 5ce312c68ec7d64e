//! Models published on a loopback server; tests write every response by hand.
#![allow(dead_code, unreachable_pub, unused_imports)] // Unit tests of `pull` use a part of it.

use std::net::TcpStream;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;
use stillpoint_inference::{Cache, Form, sha256_hex};
use stillpoint_models::{FetchError, KnownModel, Progress, PullError, PullOptions, Pulled, pull};
pub use stillpoint_testdata::server::{
    Request, Server, break_off, made_up_bytes, reply, send, serve, stall,
};

/// A model of these bytes, with size and checksum known, at `/made/up.onnx`.
pub fn model(bytes: &[u8]) -> KnownModel {
    KnownModel {
        name: "made-up",
        file: "up.onnx",
        url: "https://github.com/made/up.onnx",
        bytes: Some(bytes.len() as u64),
        sha256: Some(sha256_hex(bytes).leak()),
        licence: "MIT",
        form: Form::Onnx,
        about: "made up for a test",
    }
}

/// The same with unknown size and checksum.
pub fn unknown() -> KnownModel {
    KnownModel {
        bytes: None,
        sha256: None,
        ..model(b"")
    }
}

/// Options for this server, with short time limits, that replace existing models.
pub fn options(server: &Server) -> PullOptions {
    PullOptions {
        base: Some(server.base.clone()),
        connect_timeout: Duration::from_secs(10),
        stall_timeout: Duration::from_secs(10),
        again: true,
    }
}

/// A download without progress callback.
pub fn get(model: &KnownModel, cache: &Cache, server: &Server) -> Result<Pulled, PullError> {
    pull(model, cache, &options(server), &mut |_| {
        ControlFlow::Continue(())
    })
}

/// The same, unless a model of its name is present.
pub fn get_once(model: &KnownModel, cache: &Cache, server: &Server) -> Result<Pulled, PullError> {
    let once = PullOptions {
        again: false,
        ..options(server)
    };
    watch(model, cache, &once).0
}

/// A cache in a temporary folder.
pub struct Scratch {
    pub cache: Cache,
    _folder: tempfile::TempDir,
}

impl Scratch {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self {
            cache: Cache::at(folder.path().join("cache")),
            _folder: folder,
        }
    }

    /// With an older intact model under the same name.
    pub fn with_older() -> Self {
        let scratch = Self::new();
        scratch
            .cache
            .install("made-up", b"older", Some("card"), Default::default())
            .unwrap();
        scratch
    }

    pub fn part(&self) -> PathBuf {
        self.cache.folder().join("made-up.part")
    }

    /// Names of the files in the cache except locks, sorted.
    pub fn files(&self) -> Vec<String> {
        files_in(&self.cache.folder())
    }

    /// Asserts that the older model is unchanged, and that there are only these other files.
    pub fn assert_older(&self, others: &[&str]) {
        let older = self.cache.find("made-up").unwrap().unwrap();
        assert_eq!(older.read().unwrap(), b"older");
        assert_eq!(older.card_text().unwrap().as_deref(), Some("card"));
        let mut expected = vec!["made-up.onnx", "made-up.record.toml", "made-up.toml"];
        expected.extend(others);
        expected.sort_unstable();
        assert_eq!(self.files(), expected);
    }
}

pub fn files_in(folder: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut files: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.ends_with(".lock"))
        .collect();
    files.sort();
    files
}

/// All progress of a complete download, with its result.
pub fn watch(
    model: &KnownModel,
    cache: &Cache,
    options: &PullOptions,
) -> (Result<Pulled, PullError>, Vec<Progress>) {
    let mut seen = Vec::new();
    let result = pull(model, cache, options, &mut |progress| {
        seen.push(progress);
        ControlFlow::Continue(())
    });
    (result, seen)
}

/// Downloads a model from a server with these responses, over an older model.
pub fn fetch(
    model: &KnownModel,
    answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static,
) -> (Result<Pulled, PullError>, Scratch, Server) {
    fetch_within(Duration::from_secs(10), model, answer)
}

/// The same with a limit for each wait.
pub fn fetch_within(
    stall_timeout: Duration,
    model: &KnownModel,
    answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static,
) -> (Result<Pulled, PullError>, Scratch, Server) {
    let (server, scratch) = (Server::start(answer), Scratch::with_older());
    let limited = PullOptions {
        stall_timeout,
        ..options(&server)
    };
    (watch(model, &scratch.cache, &limited).0, scratch, server)
}

/// The error of such a download; only the older model may remain.
pub fn fails(
    model: &KnownModel,
    answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static,
) -> PullError {
    let (result, scratch, _server) = fetch(model, answer);
    failed(result, &scratch)
}

/// Asserts that only the older model is present.
pub fn failed(result: Result<Pulled, PullError>, scratch: &Scratch) -> PullError {
    let e = result.unwrap_err();
    assert!(!e.to_string().contains('\n'), "{e}");
    scratch.assert_older(&[]);
    e
}

/// Asserts that the partial download is kept; returns its size and the reason.
pub fn broke_off(result: Result<Pulled, PullError>, scratch: &Scratch) -> (u64, String) {
    scratch.assert_older(&["made-up.part", "made-up.part.toml"]);
    match result.unwrap_err() {
        PullError::Fetch(FetchError::BrokenOff {
            received, reason, ..
        }) => (received, reason),
        other => panic!("{other}"),
    }
}
