//! A server on loopback with answers written by the test.

#![allow(clippy::unwrap_used, missing_docs)] // A helper of tests only.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// A client's request.
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

/// Answers requests until dropped. Each connection has its own thread and ends after one answer.
pub struct Server {
    pub base: String,
    requests: Arc<Mutex<Vec<Request>>>,
    ended: Arc<AtomicBool>,
    address: SocketAddr,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// `answer` gets the index of the request, from 0, and the request.
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

    /// A server that publishes these bytes correctly.
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

/// Sends bytes; ignores closed connections.
pub fn send(stream: &mut TcpStream, bytes: &[u8]) {
    let _ = stream.write_all(bytes);
    let _ = stream.flush();
}

/// A whole answer with these header lines, each terminated by `\r\n`.
pub fn reply(stream: &mut TcpStream, status: &str, headers: &str, body: &[u8]) {
    let head = format!(
        "HTTP/1.1 {status}\r\nConnection: close\r\nContent-Length: {}\r\n{headers}\r\n",
        body.len()
    );
    send(stream, head.as_bytes());
    send(stream, body);
}

/// The file, or the rest of it if requested and unchanged.
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

/// Announces all bytes, sends the first `sent` and disconnects.
pub fn break_off(bytes: &[u8], sent: usize, headers: &str, stream: &mut TcpStream) {
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Length: {}\r\n{headers}\r\n",
        bytes.len()
    );
    send(stream, head.as_bytes());
    send(stream, &bytes[..sent]);
}

/// Some 200 kB of constant pseudo-random bytes.
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

/// Waits until the client disconnects.
pub fn stall(stream: &mut TcpStream) {
    let _ = stream.read(&mut [0; 1]);
}
