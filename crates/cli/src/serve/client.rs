//! One connection: its request, and what it is answered.

use super::request::{Asked, LARGEST, Refusal, judge, read};
use super::{CLIENTS, Counted, Shared};
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// How long a request may take.
const REQUEST: Duration = Duration::from_secs(5);
/// How long one update may take. A browser that takes longer is left; if it comes back it asks again, and knows the newest then.
const UPDATE: Duration = Duration::from_secs(10);
/// Between the beginnings of two updates: fifteen a second look smooth, and as many of a camera's frames at 30 Hz have a picture for browsers.
const PACE: Duration = Duration::from_millis(66);
/// Where nothing is new, it is said so often that the connection stands, and how things are.
const IDLE: Duration = Duration::from_secs(1);

/// Bytes of an update that memory is kept for; the first one may be larger.
const ROOM: usize = 1 << 16;

/// What every answer says of itself: it is not kept, not guessed at, not shown within other pages, and not read by them.
const HEADERS: &str = "Connection: close\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nX-Frame-Options: DENY\r\nReferrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\n";

/// Answers one connection, to its end.
pub(super) fn serve(mut stream: TcpStream, guest: u64, shared: &Shared) {
    // What fails here is that the other side is gone, and there is nobody to tell.
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

/// Sends news to the listener until the run ends or the listener leaves.
fn tell(stream: &mut TcpStream, shared: &Shared) -> Result<()> {
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n{HEADERS}\r\nretry: 2000\n\n"
    );
    write_within(stream, head.as_bytes(), UPDATE)?;
    let (mut version, mut seen) = (0, None);
    // One for all updates: fifteen a second of ever other sizes would leave holes in the memory.
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

/// An event; JSON has no line ends.
fn event(name: &str, json: &str) -> String {
    format!("event: {name}\ndata: {json}\n\n")
}

/// Writes all of it within a time.
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

/// Ends a connection so that the other side sees the answer: what it still sends is taken for a moment, because closing on it would
/// throw the answer away.
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
