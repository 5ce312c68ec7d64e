//! Validates requests: one page and its events, by GET, from the page itself.
//!
//! A foreign page must not read the camera's images through the user's browser. Therefore `Host` must be an address, `localhost`, or the
//! name that the user gave, against DNS rebinding, and `Origin`, if present, must be the page's own.

use std::io::{ErrorKind, Read};
use std::net::{IpAddr, TcpStream};
use std::time::{Duration, Instant};

/// Maximum size of a request, bytes: browsers send less than one kilobyte.
pub(super) const LARGEST: usize = 8 * 1024;
const MOST_HEADERS: usize = 64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    Page,
    Events,
}

/// A refusal: the status, and advice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Refusal(pub(super) &'static str, pub(super) &'static str);

const TOO_LARGE: Refusal = Refusal(
    "431 Request Header Fields Too Large",
    "expected a request of at most 8 kB with at most 64 headers; clear the cookies of this address",
);
const MALFORMED: Refusal = Refusal(
    "400 Bad Request",
    "expected a request of HTTP/1.1; open the address in a browser",
);
const BODY: Refusal = Refusal(
    "400 Bad Request",
    "expected a request without a body: nothing can be sent here",
);
const METHOD: Refusal = Refusal(
    "405 Method Not Allowed",
    "expected GET: this page is only looked at",
);
const NO_HOST: Refusal = Refusal("400 Bad Request", "expected one Host header");
const HOST: Refusal = Refusal(
    "403 Forbidden",
    "expected the address or name that the program was told with --view, found another name; open the address that it prints",
);
const ORIGIN: Refusal = Refusal(
    "403 Forbidden",
    "expected a request of the page itself, found one of another site; open the page itself",
);
const PATH: Refusal = Refusal(
    "404 Not Found",
    "expected the address that the program prints: there is nothing else here",
);
const SLOW: Refusal = Refusal(
    "408 Request Timeout",
    "expected a whole request within seconds",
);

/// Reads a request up to its empty line. `None` if the client left before that.
pub(super) fn read(stream: &mut TcpStream, patience: Duration) -> Option<Result<Vec<u8>, Refusal>> {
    let deadline = Instant::now() + patience;
    let (mut head, mut buffer) = (Vec::new(), [0; 2048]);
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return Some(Err(SLOW));
        }
        match stream.read(&mut buffer) {
            Ok(0) => return None,
            Ok(n) => {
                // The terminator may span two reads.
                let from = head.len().saturating_sub(3);
                head.extend_from_slice(&buffer[..n]);
                if head[from..].windows(4).any(|w| w == b"\r\n\r\n") {
                    return Some(Ok(head));
                }
                if head.len() > LARGEST {
                    return Some(Err(TOO_LARGE));
                }
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(_) => return None,
        }
    }
}

/// Resolves and authorises a request. `name` is the host name that the user gave, `root` the prefix of all paths.
pub(super) fn judge(head: &[u8], name: &str, root: &str) -> Result<Asked, Refusal> {
    if head.len() > LARGEST {
        return Err(TOO_LARGE);
    }
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut request = httparse::Request::new(&mut headers);
    let end = match request.parse(head) {
        Ok(httparse::Status::Complete(end)) => end,
        Ok(httparse::Status::Partial) => return Err(MALFORMED),
        Err(httparse::Error::TooManyHeaders) => return Err(TOO_LARGE),
        Err(_) => return Err(MALFORMED),
    };
    if request.method != Some("GET") {
        return Err(METHOD);
    }
    let all = |wanted: &'static str| {
        let named = request.headers.iter();
        let named = named.filter(move |h| h.name.eq_ignore_ascii_case(wanted));
        named.map(|h| std::str::from_utf8(h.value).unwrap_or_default().trim())
    };
    let announced =
        all("Transfer-Encoding").next().is_some() || all("Content-Length").any(|n| n != "0");
    if announced || end < head.len() {
        return Err(BODY);
    }
    let hosts: Vec<&str> = all("Host").collect();
    let [host] = hosts[..] else {
        return Err(NO_HOST);
    };
    if !is_here(host, name) {
        return Err(HOST);
    }
    let own = |origin: &str| {
        let of = origin.strip_prefix("http://");
        of.is_some_and(|o| o.eq_ignore_ascii_case(host))
    };
    if !all("Origin").all(own) {
        return Err(ORIGIN);
    }
    let path = request.path.unwrap_or_default();
    let path = path.split_once('?').map_or(path, |(path, _)| path);
    let asked = match within(path, root).ok_or(PATH)? {
        "/" => Asked::Page,
        "/events" => Asked::Events,
        _ => return Err(PATH),
    };
    // Other sites may link to the page; only the page itself may fetch its events.
    let from_elsewhere = |site: &str| !matches!(site, "same-origin" | "none");
    if asked == Asked::Events && all("Sec-Fetch-Site").any(from_elsewhere) {
        return Err(ORIGIN);
    }
    Ok(asked)
}

/// The rest of a path after `root`, compared in constant time.
fn within<'a>(path: &'a str, root: &str) -> Option<&'a str> {
    let (begin, rest) = path.split_at_checked(root.len())?;
    let pairs = begin.bytes().zip(root.bytes());
    let differs = pairs.fold(0, |all, (a, b)| all | (a ^ b));
    (differs == 0).then_some(rest)
}

/// Whether a `Host` is allowed: an IP address, which no one else can redirect, `localhost`, or the name that the user gave. Any port is
/// allowed, as port forwarding changes it.
fn is_here(host: &str, name: &str) -> bool {
    let is_port = |p: &str| !p.is_empty() && p.len() <= 5 && p.bytes().all(|b| b.is_ascii_digit());
    if let Some(rest) = host.strip_prefix('[') {
        let Some((address, rest)) = rest.split_once(']') else {
            return false;
        };
        let port = rest.is_empty() || rest.strip_prefix(':').is_some_and(is_port);
        return port && address.parse::<IpAddr>().is_ok_and(|a| a.is_ipv6());
    }
    let (place, port) = match host.rsplit_once(':') {
        Some((place, port)) => (place, is_port(port)),
        None => (host, true),
    };
    let is_number = place.parse::<IpAddr>().is_ok_and(|a| a.is_ipv4());
    let is_named = ["localhost", name]
        .iter()
        .any(|n| place.eq_ignore_ascii_case(n));
    port && !place.is_empty() && (is_number || is_named)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn asked(first: &str, headers: &[&str]) -> Result<Asked, &'static str> {
        let head = format!("{first}\r\n{}\r\n\r\n", headers.join("\r\n"));
        judge(head.as_bytes(), "robot.lan", "").map_err(|r| &r.0[..3])
    }

    #[test]
    fn host_header_must_be_local_or_the_configured_name() {
        for (host, here) in [
            ("127.0.0.1:7117", true),
            ("localhost:8000", true),
            ("LOCALHOST", true),
            ("192.168.1.7:7117", true),
            ("[::1]:7117", true),
            ("[fe80::1]", true),
            ("robot.lan:7117", true),
            ("evil.example:7117", false),
            ("127.0.0.1.evil.example", false),
            ("localhost.evil.example:7117", false),
            ("127.0.0.1:80x", false),
            ("127.0.0.1:", false),
            ("[127.0.0.1]", false),
            ("[::1", false),
            ("[::1]x", false),
            ("::1", false),
            ("", false),
            (":80", false),
            ("user@127.0.0.1", false),
        ] {
            let found = asked("GET / HTTP/1.1", &[&format!("Host: {host}")]);
            let expected = if here { Ok(Asked::Page) } else { Err("403") };
            assert_eq!(found, expected, "{host}");
        }
    }

    #[test]
    fn foreign_requests_are_refused() {
        let host = "Host: localhost:7117";
        for (first, headers, expected) in [
            ("GET /events HTTP/1.1", &[host][..], Ok(Asked::Events)),
            ("GET /events?again HTTP/1.0", &[host], Ok(Asked::Events)),
            (
                "GET /events HTTP/1.1",
                &[host, "Origin: http://localhost:7117"],
                Ok(Asked::Events),
            ),
            (
                "GET /events HTTP/1.1",
                &[host, "Origin: http://localhost:7118"],
                Err("403"),
            ),
            (
                "GET /events HTTP/1.1",
                &[host, "Origin: https://localhost:7117"],
                Err("403"),
            ),
            (
                "GET / HTTP/1.1",
                &[host, "Origin: http://evil.example"],
                Err("403"),
            ),
            ("GET / HTTP/1.1", &[host, "Origin: null"], Err("403")),
            (
                "GET / HTTP/1.1",
                &[host, "Sec-Fetch-Site: cross-site"],
                Ok(Asked::Page),
            ),
            (
                "GET /events HTTP/1.1",
                &[host, "Sec-Fetch-Site: cross-site"],
                Err("403"),
            ),
            (
                "GET /events HTTP/1.1",
                &[host, "Sec-Fetch-Site: same-site"],
                Err("403"),
            ),
            (
                "GET /events HTTP/1.1",
                &[host, "Sec-Fetch-Site: same-origin"],
                Ok(Asked::Events),
            ),
            ("GET / HTTP/1.1", &["Accept: */*"], Err("400")),
            ("GET / HTTP/1.1", &[host, "host: evil.example"], Err("400")),
            ("POST / HTTP/1.1", &[host], Err("405")),
            ("HEAD / HTTP/1.1", &[host], Err("405")),
            ("OPTIONS * HTTP/1.1", &[host], Err("405")),
            ("GET /report.html HTTP/1.1", &[host], Err("404")),
            ("GET /../../etc/passwd HTTP/1.1", &[host], Err("404")),
            ("GET http://localhost:7117/ HTTP/1.1", &[host], Err("404")),
            ("GET / HTTP/1.1", &[host, "Content-Length: 5"], Err("400")),
            (
                "GET / HTTP/1.1",
                &[host, "Transfer-Encoding: chunked"],
                Err("400"),
            ),
            ("GET / HTTP/2.0", &[host], Err("400")),
            ("nonsense", &[host], Err("400")),
        ] {
            assert_eq!(asked(first, headers), expected, "{first} {headers:?}");
        }
        let many: Vec<String> = (0..70).map(|i| format!("X-{i}: 1")).collect();
        let many: Vec<&str> = many.iter().map(|h| &**h).chain([host]).collect();
        assert_eq!(asked("GET / HTTP/1.1", &many), Err("431"));
        let long = format!("Cookie: {}", "x".repeat(LARGEST));
        assert_eq!(asked("GET / HTTP/1.1", &[host, &long]), Err("431"));
        let behind = judge(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\nmore", "", "");
        assert_eq!(behind, Err(BODY));
    }

    #[test]
    fn only_the_printed_path_leads_to_the_page() {
        let asked = |path: &str| {
            let head = format!("GET {path} HTTP/1.1\r\nHost: 192.168.1.7:80\r\n\r\n");
            judge(head.as_bytes(), "", "/0123abcd").map_err(|r| &r.0[..3])
        };
        assert_eq!(asked("/0123abcd/"), Ok(Asked::Page));
        assert_eq!(asked("/0123abcd/events"), Ok(Asked::Events));
        for path in [
            "/",
            "/events",
            "/0123abcd",
            "/0123abce/",
            "/1123abcd/events",
            "/0123abcdevents",
            "//0123abcd/",
            "/0123abc\u{e4}/",
        ] {
            assert!(matches!(asked(path), Err("404" | "400")), "{path}");
        }
    }

    proptest! {
        #[test]
        fn any_request_is_handled_without_panic(head: Vec<u8>, name in "[a-z.]{0,8}") {
            let _ = judge(&head, &name, "/token");
        }

        #[test]
        fn no_other_host_name_is_accepted(host in "[a-z0-9.:\\[\\]@/-]{1,24}") {
            let place = host.rsplit_once(':').map_or(&*host, |(p, _)| p);
            let number = host.trim_matches(['[', ']']).parse::<IpAddr>().is_ok() || place.trim_matches(['[', ']']).parse::<IpAddr>().is_ok();
            if is_here(&host, "robot.lan") {
                prop_assert!(number || ["localhost", "robot.lan"].contains(&place), "{}", host);
            }
        }
    }
}
