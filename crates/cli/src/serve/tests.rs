//! Tests with browsers that are slow, gone, too many, or not browsers at all.

use super::guests::CONNECTIONS;
use super::*;
use std::io::{BufRead, BufReader, Read, Write};
use std::sync::atomic::AtomicU64;

/// Counts up; every version is a long text.
struct Numbers {
    now: AtomicU64,
    bytes: usize,
}

impl Feed for Numbers {
    fn since(&self, version: u64, json: &mut Vec<u8>) -> u64 {
        let now = self.now.load(Ordering::Relaxed);
        let filler = "x".repeat(self.bytes);
        let text = format!("{{\"from\":{version},\"to\":{now},\"filler\":\"{filler}\"}}");
        json.extend_from_slice(text.as_bytes());
        now
    }
}

struct Served {
    server: Server,
    numbers: Arc<Numbers>,
}

fn serve(bytes: usize) -> Served {
    let numbers = Arc::new(Numbers {
        now: AtomicU64::new(1),
        bytes,
    });
    let place: Place = "127.0.0.1:0".parse().unwrap();
    let feed: Arc<dyn Feed> = Arc::clone(&numbers) as _;
    let server = Server::start(&place, "<p>page</p>".to_owned(), feed, || {}).unwrap();
    Served { server, numbers }
}

impl Served {
    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.server.address).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        stream
    }

    fn ask(&self, text: &str) -> String {
        let mut stream = self.connect();
        // A server that refuses does not have to read all of it.
        let _ = stream.write_all(text.as_bytes());
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer
    }

    fn listen(&self) -> Listener {
        let mut stream = self.connect();
        let request = "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        Listener(BufReader::new(stream))
    }

    fn step(&self) {
        self.numbers.now.fetch_add(1, Ordering::Relaxed);
        self.server.wake();
    }
}

/// Waits until a condition holds, as threads may be slow on a busy machine.
fn until(what: &str, holds: impl Fn() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(30);
    while !holds() {
        assert!(Instant::now() < deadline, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

struct Listener(BufReader<TcpStream>);

impl Listener {
    /// The next event: its name, and its data.
    fn next(&mut self) -> Option<(String, serde_json::Value)> {
        let (mut name, mut line) = (String::new(), String::new());
        loop {
            line.clear();
            if self.0.read_line(&mut line).ok()? == 0 {
                return None;
            }
            if let Some(text) = line.strip_prefix("event: ") {
                name = text.trim().to_owned();
            } else if let Some(text) = line.strip_prefix("data: ") {
                return Some((name, serde_json::from_str(text).unwrap()));
            }
        }
    }
}

#[test]
fn page_is_served_and_receives_updates() {
    let served = serve(10);
    let host = "Host: 127.0.0.1:1";
    let page = served.ask(&format!("GET / HTTP/1.1\r\n{host}\r\n\r\n"));
    assert!(
        page.starts_with("HTTP/1.1 200 OK\r\n") && page.ends_with("\r\n\r\n<p>page</p>"),
        "{page}"
    );
    for header in [
        "no-store",
        "nosniff",
        "X-Frame-Options: DENY",
        "Resource-Policy: same-origin",
    ] {
        assert!(page.contains(header), "{header}: {page}");
    }
    assert!(!page.contains("Access-Control"), "{page}");
    assert!(!served.server.is_watched() && !served.server.is_open());
    let mut pages = [served.listen(), served.listen()];
    for page in &mut pages {
        let (name, first) = page.next().unwrap();
        assert_eq!((&*name, &first["from"]), ("update", &0.into()));
    }
    assert!(served.server.is_watched());
    served.step();
    for page in &mut pages {
        // Later updates start from the known version.
        let mut known = 1;
        while known < 2 {
            let (_, update) = page.next().unwrap();
            assert_eq!(update["from"], known);
            known = update["to"].as_u64().unwrap();
        }
    }
    served.server.end("report", "{\"all\":1}".to_owned());
    for page in &mut pages {
        let last = std::iter::from_fn(|| page.next()).last().unwrap();
        assert_eq!((&*last.0, &last.1["all"]), ("report", &1.into()));
    }
}

#[test]
fn invalid_requests_are_refused() {
    let served = serve(10);
    let long = format!(
        "GET / HTTP/1.1\r\nHost: localhost\r\nCookie: {}\r\n\r\n",
        "x".repeat(100_000)
    );
    let head = |rest: &str| format!("GET /events HTTP/1.1\r\n{rest}\r\n\r\n");
    for (text, status) in [
        (head("Host: evil.example"), "403"),
        (
            head("Host: localhost\r\nOrigin: http://evil.example"),
            "403",
        ),
        (head("Host: localhost\r\nSec-Fetch-Site: cross-site"), "403"),
        (head("Accept: text/event-stream"), "400"),
        (
            "POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\n\r\nabc".to_owned(),
            "405",
        ),
        (
            "DELETE /events HTTP/1.1\r\nHost: localhost\r\n\r\n".to_owned(),
            "405",
        ),
        (
            "GET /summary.json HTTP/1.1\r\nHost: localhost\r\n\r\n".to_owned(),
            "404",
        ),
        (
            "\u{16}\u{3}\u{1} a handshake of TLS\r\n\r\n".to_owned(),
            "400",
        ),
        (long, "431"),
    ] {
        let answer = served.ask(&text);
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {status} ")),
            "{text:.80}: {answer}"
        );
        assert!(answer.contains("expected "), "{answer}");
    }
    assert!(!served.server.is_watched());
}

#[test]
fn excess_clients_get_an_error() {
    let served = serve(10);
    let mut pages: Vec<Listener> = (0..CLIENTS).map(|_| served.listen()).collect();
    pages.iter_mut().for_each(|p| assert!(p.next().is_some()));
    let one_more = served.ask("GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert!(
        one_more.starts_with("HTTP/1.1 503") && one_more.contains("close another"),
        "{one_more}"
    );
    // A client that leaves makes room.
    drop(pages.pop());
    let one_less = || served.server.shared.clients.load(Ordering::Relaxed) < CLIENTS;
    until("the page that left is noticed", || {
        served.step();
        one_less()
    });
    assert!(served.listen().next().is_some());
}

#[test]
fn idle_connections_do_not_block_others() {
    let served = serve(10);
    let mut page = served.listen();
    page.next().unwrap();
    let connections = || served.server.shared.guests.count();
    // Each sends a byte now and then, and never a whole request.
    let mut idle: Vec<TcpStream> = (0..2 * CONNECTIONS).map(|_| served.connect()).collect();
    until("they are all seen", || connections() == CONNECTIONS);
    for _ in 0..3 {
        for stream in &mut idle {
            let _ = stream.write_all(b"G");
        }
        let answer = served.ask("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }
    assert!(connections() <= CONNECTIONS);
    // A page that sent its request stays connected.
    served.step();
    assert!(page.next().is_some());
    drop(idle);
    until("those who left are noticed", || connections() < CLIENTS + 4);
}

#[test]
fn remote_page_address_contains_a_secret_token() {
    let open = |host: &str| {
        let numbers = Numbers {
            now: AtomicU64::new(1),
            bytes: 10,
        };
        let place = Place {
            host: host.to_owned(),
            port: Some(0),
        };
        Server::start(&place, "<p>page</p>".to_owned(), Arc::new(numbers), || {}).unwrap()
    };
    let (first, second) = (open("0.0.0.0"), open("0.0.0.0"));
    assert!(first.is_open());
    let rest = first.url();
    let (host, path) = rest
        .strip_prefix("http://")
        .unwrap()
        .split_once('/')
        .unwrap();
    let address: SocketAddr = host.parse().unwrap();
    assert!(!address.ip().is_unspecified(), "{host}");
    let others = if_addrs::get_if_addrs().unwrap();
    if others.iter().any(|c| !c.is_loopback() && c.ip().is_ipv4()) {
        assert!(!address.ip().is_loopback(), "{host}");
    }
    assert!(path.len() == 33 && path.ends_with('/'), "{path}");
    assert_ne!(first.shared.root, second.shared.root);
    let ask = |path: &str| {
        let mut stream = TcpStream::connect(address).unwrap();
        let head = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer
    };
    assert!(ask("/").starts_with("HTTP/1.1 404"));
    assert!(ask("/events").starts_with("HTTP/1.1 404"));
    assert!(ask(&format!("/{path}")).ends_with("<p>page</p>"));
    // Control: on the loopback interface there is no token.
    assert!(open("127.0.0.1").url().ends_with("/") && open("127.0.0.1").shared.root.is_empty());
}

#[test]
fn stalled_client_does_not_block_others() {
    // A few updates fill the system's send buffer.
    let served = serve(1_000_000);
    let stopped = served.listen();
    let mut page = served.listen();
    until("both are there", || {
        served.server.shared.clients.load(Ordering::Relaxed) == 2
    });
    let mut known = 0;
    let began = Instant::now();
    let mut slowest = Duration::ZERO;
    while known < 16 {
        let step = Instant::now();
        served.step();
        slowest = slowest.max(step.elapsed());
        let (_, update) = page.next().unwrap();
        assert_eq!(update["from"], known);
        known = update["to"].as_u64().unwrap();
    }
    // A server that waited for the stopped page would need its full ten seconds.
    assert!(slowest < Duration::from_secs(5) && began.elapsed() < Duration::from_secs(60));
    // At the end the page is waited for only briefly.
    let ends = Instant::now();
    served.server.end("end", "1".to_owned());
    drop(page);
    drop(served);
    assert!(ends.elapsed() < LAST + Duration::from_secs(10));
    drop(stopped);
}

#[test]
fn failed_run_is_reported_to_the_page() {
    let served = serve(10);
    let mut listener = served.listen();
    listener.next().unwrap();
    drop(served);
    let last = std::iter::from_fn(|| listener.next()).last().unwrap();
    assert_eq!(last.0, "end");
    assert!(last.1.as_str().unwrap().contains("the terminal says why"));
}

#[test]
fn view_address_and_port_are_parsed() {
    for (text, host, port) in [
        ("", "127.0.0.1", None),
        ("8080", "127.0.0.1", Some(8080)),
        ("0.0.0.0", "0.0.0.0", None),
        ("192.168.1.7:80", "192.168.1.7", Some(80)),
        ("[::1]:80", "::1", Some(80)),
        ("::1", "::1", None),
        ("robot.lan:8080", "robot.lan", Some(8080)),
    ] {
        let place: Place = text.parse().unwrap();
        assert_eq!((&*place.host, place.port), (host, port), "{text}");
    }
    for text in [
        "recording",
        "data/desk",
        "a b:80",
        ":80",
        "host:",
        "host:99999",
        "http://x:80",
    ] {
        let error = text.parse::<Place>().unwrap_err();
        assert!(
            error.contains("ADDR:PORT") && error.contains(text),
            "{error}"
        );
    }
}

#[test]
fn occupied_port_is_reported_and_default_picks_a_free_one() {
    let served = serve(10);
    let taken = Place {
        host: "127.0.0.1".to_owned(),
        port: Some(served.server.address.port()),
    };
    let error = taken.bind().unwrap_err().to_string();
    assert!(error.contains("--view ADDR:PORT"), "{error}");
    let (first, second) = (
        Place::default().bind().unwrap(),
        Place::default().bind().unwrap(),
    );
    assert_ne!(
        first.local_addr().unwrap().port(),
        second.local_addr().unwrap().port()
    );
    let elsewhere: Place = "192.0.2.1:0".parse().unwrap();
    assert!(elsewhere.bind().is_err());
}
