//! A server on loopback whose every answer a test writes by hand, and models that are published there.
#![allow(dead_code, unreachable_pub)] // Unit tests of `pull` use a part of it.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;
use stillpoint_inference::{Cache, Form, sha256_hex};
use stillpoint_models::{KnownModel, Progress, PullError, PullOptions, Pulled, pull};

/// What a client asked for.
#[derive(Clone, Debug)]
pub struct Request {
    pub path: String,
    headers: BTreeMap<String, String>,
}

impl Request {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.get(name).map(String::as_str)
    }

    /// N of `Range: bytes=N-`.
    pub fn start(&self) -> Option<usize> {
        let range = self.header("range")?.strip_prefix("bytes=")?;
        range.strip_suffix('-')?.parse().ok()
    }
}

/// Answers requests until it is dropped. Each connection has a thread of its own and ends after one answer.
pub struct Server {
    pub base: String,
    requests: Arc<Mutex<Vec<Request>>>,
    ended: Arc<AtomicBool>,
    address: std::net::SocketAddr,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// `answer` gets the number of the request, from 0, and what was asked.
    pub fn start(answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let requests = Arc::new(Mutex::new(Vec::new()));
        let ended = Arc::new(AtomicBool::new(false));
        let (log, end, answer) = (requests.clone(), ended.clone(), Arc::new(answer));
        let thread = std::thread::spawn(move || {
            for stream in listener.incoming() {
                if end.load(Ordering::SeqCst) {
                    break;
                }
                let (mut stream, log, answer) = (stream.unwrap(), log.clone(), answer.clone());
                std::thread::spawn(move || {
                    let Some(request) = read_request(&stream) else {
                        return;
                    };
                    let number = {
                        let mut log = log.lock().unwrap();
                        log.push(request.clone());
                        log.len() - 1
                    };
                    answer(number, &request, &mut stream);
                });
            }
        });
        Self {
            base: format!("http://{address}"),
            requests,
            ended,
            address,
            thread: Some(thread),
        }
    }

    /// One that publishes these bytes as a good server does.
    pub fn of(bytes: &'static [u8]) -> Self {
        Self::start(move |_, request, stream| serve(bytes, "\"v1\"", request, stream))
    }

    pub fn requests(&self) -> Vec<Request> {
        self.requests.lock().unwrap().clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::SeqCst);
        // Wakes the thread that waits for a connection.
        let _ = TcpStream::connect(self.address);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

fn read_request(stream: &TcpStream) -> Option<Request> {
    let mut lines = BufReader::new(stream).lines();
    let first = lines.next()?.ok()?;
    let path = first.split(' ').nth(1)?.to_owned();
    let mut headers = BTreeMap::new();
    for line in lines {
        let line = line.ok()?;
        if line.is_empty() {
            return Some(Request { path, headers });
        }
        let (name, value) = line.split_once(':')?;
        headers.insert(name.to_ascii_lowercase(), value.trim().to_owned());
    }
    None
}

/// Sends bytes; the client may have gone.
pub fn send(stream: &mut TcpStream, bytes: &[u8]) {
    let _ = stream.write_all(bytes);
    let _ = stream.flush();
}

/// A whole answer with these header lines, each ended by `\r\n`.
pub fn reply(stream: &mut TcpStream, status: &str, headers: &str, body: &[u8]) {
    let head = format!(
        "HTTP/1.1 {status}\r\nConnection: close\r\nContent-Length: {}\r\n{headers}\r\n",
        body.len()
    );
    send(stream, head.as_bytes());
    send(stream, body);
}

/// The file, or the rest of it if that is asked for and it is still the same.
pub fn serve(bytes: &[u8], etag: &str, request: &Request, stream: &mut TcpStream) {
    let same = request.header("if-range").is_none_or(|tag| tag == etag);
    match request.start().filter(|_| same) {
        None => reply(stream, "200 OK", &format!("ETag: {etag}\r\n"), bytes),
        Some(start) if start >= bytes.len() => {
            let range = format!("Content-Range: bytes */{}\r\n", bytes.len());
            reply(stream, "416 Range Not Satisfiable", &range, b"");
        }
        Some(start) => {
            let (last, size) = (bytes.len() - 1, bytes.len());
            let range = format!("ETag: {etag}\r\nContent-Range: bytes {start}-{last}/{size}\r\n");
            reply(stream, "206 Partial Content", &range, &bytes[start..]);
        }
    }
}

/// Says that all bytes come, sends the first `sent` and hangs up.
pub fn break_off(bytes: &[u8], sent: usize, headers: &str, stream: &mut TcpStream) {
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Length: {}\r\n{headers}\r\n",
        bytes.len()
    );
    send(stream, head.as_bytes());
    send(stream, &bytes[..sent]);
}

/// Some 200 kB that are the same in every run.
pub fn made_up_bytes() -> &'static [u8] {
    let mut state = 1_u32;
    let bytes: Vec<u8> = (0..200_003)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    bytes.leak()
}

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

/// The same with nothing known beforehand.
pub fn unknown() -> KnownModel {
    KnownModel {
        bytes: None,
        sha256: None,
        ..model(b"")
    }
}

/// Options that find the server, do not wait long, and replace what is there.
pub fn options(server: &Server) -> PullOptions {
    PullOptions {
        base: Some(server.base.clone()),
        connect_timeout: Duration::from_secs(10),
        stall_timeout: Duration::from_secs(10),
        again: true,
    }
}

/// A download that nobody watches.
pub fn get(model: &KnownModel, cache: &Cache, server: &Server) -> Result<Pulled, PullError> {
    pull(model, cache, &options(server), &mut |_| {
        ControlFlow::Continue(())
    })
}

/// The same, unless a model of its name is here.
pub fn get_once(model: &KnownModel, cache: &Cache, server: &Server) -> Result<Pulled, PullError> {
    let once = PullOptions {
        again: false,
        ..options(server)
    };
    watch(model, cache, &once).0
}

/// A cache in a folder that lives as long as the test.
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

    /// With an older good model under the name of the made-up one.
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

    /// Names of the files in the cache but for locks, sorted.
    pub fn files(&self) -> Vec<String> {
        files_in(&self.cache.folder())
    }

    /// Asserts that the older model is as it was, and that nothing else is there but what is named.
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

/// All progress of a download that nobody stops, with its result.
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

/// Downloads a model from a server that answers like this, over an older model.
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

/// The error of such a download, after which nothing but the older model is there.
pub fn fails(
    model: &KnownModel,
    answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static,
) -> PullError {
    let (result, scratch, _server) = fetch(model, answer);
    failed(result, &scratch)
}

/// Asserts that nothing but the older model is there.
pub fn failed(result: Result<Pulled, PullError>, scratch: &Scratch) -> PullError {
    let e = result.unwrap_err();
    assert!(!e.to_string().contains('\n'), "{e}");
    scratch.assert_older(&[]);
    e
}

/// Asserts that what came is kept: how much, and why no more came.
pub fn broke_off(result: Result<Pulled, PullError>, scratch: &Scratch) -> (u64, String) {
    scratch.assert_older(&["made-up.part", "made-up.part.toml"]);
    match result.unwrap_err() {
        PullError::BrokenOff {
            received, reason, ..
        } => (received, reason),
        other => panic!("{other}"),
    }
}

/// Waits until the client has gone.
pub fn stall(stream: &mut TcpStream) {
    let _ = stream.read(&mut [0; 1]);
}
