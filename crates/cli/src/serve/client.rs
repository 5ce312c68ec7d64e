//! Serves one connection.

use super::request::{Asked, LARGEST, Refusal, judge, read};
use super::{CLIENTS, Counted, Shared};
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

const REQUEST: Duration = Duration::from_secs(5);
/// Time limit of one update. A slower browser is disconnected; when it reconnects it gets the newest state.
const UPDATE: Duration = Duration::from_secs(10);
/// Minimum interval between updates: fifteen per second look smooth, and as many of a camera's frames at 30 Hz have an image for browsers.
const PACE: Duration = Duration::from_millis(66);
/// Interval of updates without news, which keep the connection alive and carry the state of the run.
const IDLE: Duration = Duration::from_secs(1);

/// Reserved size of an update, bytes; the first one may be larger.
const ROOM: usize = 1 << 16;

/// Headers of every response: no caching, no content sniffing, no framing, no access from other pages.
const HEADERS: &str = "Connection: close\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nX-Frame-Options: DENY\r\nReferrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\n";

pub(super) fn serve(mut stream: TcpStream, guest: u64, shared: &Shared) {
    // Errors here mean that the client is gone.
    let _ = stream.set_nodelay(true);
    let head = match read(&mut stream, REQUEST) {
        None => return,
        Some(head) => head,
    };
    shared.guests.asked(guest);
    match head.and_then(|head| judge(&head, &shared.name, &shared.root)) {
        Ok(Asked::Page) => drop(answer(
            &mut stream,
            "200 OK",
            "text/html",
            shared.html.as_bytes(),
        )),
        Ok(Asked::Events) => {
            let before = shared.clients.fetch_add(1, Ordering::Relaxed);
            let _counted = Counted(&shared.clients);
            if before < CLIENTS {
                let _ = tell(&mut stream, shared);
            } else {
                let full = "expected at most 8 pages at once; close another one\n";
                let _ = answer(
                    &mut stream,
                    "503 Service Unavailable",
                    "text/plain",
                    full.as_bytes(),
                );
            }
        }
        Err(Refusal(status, text)) => {
            let text = format!("{text}\n");
            let _ = answer(&mut stream, status, "text/plain", text.as_bytes());
        }
    }
    leave(&mut stream);
}

fn answer(stream: &mut TcpStream, status: &str, kind: &str, body: &[u8]) -> Result<()> {
    let allow = if status.starts_with("405") {
        "Allow: GET\r\n"
    } else {
        ""
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\n{allow}{HEADERS}\r\n",
        body.len()
    );
    write_within(stream, &[head.as_bytes(), body].concat(), UPDATE)
}

/// Sends updates until the run ends or the client leaves.
fn tell(stream: &mut TcpStream, shared: &Shared) -> Result<()> {
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n{HEADERS}\r\nretry: 2000\n\n"
    );
    write_within(stream, head.as_bytes(), UPDATE)?;
    let (mut version, mut seen) = (0, None);
    // One buffer for all updates: many allocations of varying size would fragment memory.
    let mut text = Vec::with_capacity(ROOM);
    loop {
        let began = Instant::now();
        let last = shared.wait(&mut seen, IDLE);
        text.clear();
        text.extend_from_slice(b"event: update\ndata: ");
        version = shared.feed.since(version, &mut text);
        text.extend_from_slice(b"\n\n");
        write_within(stream, &text, UPDATE)?;
        if let Some((name, text)) = &*last {
            return write_within(stream, event(name, text).as_bytes(), UPDATE);
        }
        text.shrink_to(ROOM);
        std::thread::sleep(PACE.saturating_sub(began.elapsed()));
    }
}

/// A server-sent event; JSON has no line breaks.
fn event(name: &str, json: &str) -> String {
    format!("event: {name}\ndata: {json}\n\n")
}

/// Writes all bytes within a time limit.
fn write_within(stream: &mut TcpStream, mut bytes: &[u8], time: Duration) -> Result<()> {
    let deadline = Instant::now() + time;
    while !bytes.is_empty() {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(Error::from(ErrorKind::TimedOut));
        }
        stream.set_write_timeout(Some(left))?;
        match stream.write(bytes) {
            Ok(0) => return Err(Error::from(ErrorKind::WriteZero)),
            Ok(n) => bytes = &bytes[n..],
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// Closes a connection so that the client can read the response: reads its remaining input for a moment, because closing with unread input
/// would discard the response.
fn leave(stream: &mut TcpStream) {
    let _ = stream.shutdown(Shutdown::Write);
    let _ = stream.set_read_timeout(Some(Duration::from_millis(200)));
    let (mut buffer, mut taken) = ([0; 4096], 0);
    let deadline = Instant::now() + Duration::from_millis(500);
    while taken < 8 * LARGEST && Instant::now() < deadline {
        match stream.read(&mut buffer) {
            Ok(0) | Err(_) => return,
            Ok(n) => taken += n,
        }
    }
}
