//! One request: follows redirects by its own rules, and parses the response headers.

use crate::address::{follow, is_loopback, shown};
use crate::download::{Waits, Wanted};
use crate::error::FetchError;
use crate::{one_line, tls};
use std::io::Read;
use ureq::http::{HeaderMap, header};
use ureq::tls::RootCerts;

/// Maximum number of redirects: a release on GitHub needs one, and so does TUM's data set.
pub(crate) const REDIRECTS: usize = 5;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Range {
    /// The first byte wanted; 0 requests the whole file.
    pub(crate) start: u64,
    /// Only resume if the file still has this ETag or date.
    pub(crate) validator: Option<String>,
}

/// A response before its body.
pub(crate) struct Answer {
    /// HTTP status: 200, 206 or 416.
    pub(crate) status: u16,
    /// The address after all redirects, without its query, which may contain a signature.
    pub(crate) url: String,
    /// The first byte of the body, and the size of the whole file, according to the server.
    pub(crate) start: Option<u64>,
    pub(crate) total: Option<u64>,
    /// Strong ETag, else date: identifies the version of the file.
    pub(crate) validator: Option<String>,
    /// Whether the content type is a web page.
    pub(crate) is_page: bool,
    pub(crate) body: Box<dyn Read>,
}

/// Requests a file. Statuses other than 200, 206 and 416 are errors.
pub(crate) fn request(wanted: &Wanted<'_>, range: &Range) -> Result<Answer, FetchError> {
    let (url, by_hand) = (wanted.address, wanted.by_hand);
    let mut at = url.to_owned();
    for _ in 0..=REDIRECTS {
        refuse_without_encryption(&at, tls::missing(), by_hand)?;
        let response = send(&at, range, wanted.waits, RootCerts::WebPki).map_err(|e| {
            FetchError::Unreachable {
                url: shown(&at),
                reason: reason_of(&e),
                by_hand: by_hand.to_owned(),
            }
        })?;
        let status = response.status().as_u16();
        let headers = response.headers();
        match status {
            301 | 302 | 303 | 307 | 308 => {
                let refused = |found: String| FetchError::Redirect {
                    url: shown(url),
                    found,
                    by_hand: by_hand.to_owned(),
                };
                let location = text(headers, header::LOCATION)
                    .ok_or_else(|| refused(format!("status {status} without an address")))?;
                // The body of a redirect is not read: dropping the response closes the connection.
                at = follow(&at, &location).map_err(refused)?;
            }
            200 | 206 | 416 => return Ok(answer(status, &at, response)),
            _ => {
                return Err(FetchError::Status {
                    url: shown(&at),
                    status,
                    by_hand: by_hand.to_owned(),
                });
            }
        }
    }
    Err(FetchError::Redirect {
        url: shown(url),
        found: format!("more than {REDIRECTS}"),
        by_hand: by_hand.to_owned(),
    })
}

/// Refuses `https` addresses if the CPU lacks the features for encryption.
fn refuse_without_encryption(
    url: &str,
    missing: Option<String>,
    by_hand: &str,
) -> Result<(), FetchError> {
    let scheme = url.split_once("://").map_or("", |(scheme, _)| scheme);
    match missing {
        Some(missing) if scheme.eq_ignore_ascii_case("https") => Err(FetchError::Cpu {
            url: shown(url),
            missing,
            by_hand: by_hand.to_owned(),
        }),
        _ => Ok(()),
    }
}

/// `roots`: trusted certificates.
fn send(
    url: &str,
    range: &Range,
    waits: Waits,
    roots: RootCerts,
) -> Result<ureq::http::Response<ureq::Body>, ureq::Error> {
    let mut config = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .max_redirects(0)
        .accept_encoding("identity")
        .user_agent(concat!("stillpoint/", env!("CARGO_PKG_VERSION")))
        .timeout_resolve(Some(waits.connect))
        .tls_config(tls::config(roots))
        .timeout_connect(Some(waits.connect))
        .timeout_send_request(Some(waits.stall))
        .timeout_recv_response(Some(waits.stall))
        // A limit for each wait, none for the total: a slow connection may take an hour.
        .timeout_per_read(Some(waits.stall));
    if is_loopback(url) {
        // A proxy would search for the file on its own machine.
        config = config.proxy(None);
    }
    let mut request = config.build().new_agent().get(url);
    if range.start > 0 {
        request = request.header(header::RANGE, format!("bytes={}-", range.start));
        if let Some(validator) = &range.validator {
            request = request.header(header::IF_RANGE, validator);
        }
    }
    request.call()
}

fn answer(status: u16, url: &str, response: ureq::http::Response<ureq::Body>) -> Answer {
    let headers = response.headers();
    let (start, total) = match status {
        206 | 416 => {
            text(headers, header::CONTENT_RANGE).map_or((None, None), |value| content_range(&value))
        }
        _ => {
            let length = text(headers, header::CONTENT_LENGTH).and_then(|v| v.parse().ok());
            (Some(0), length)
        }
    };
    let strong = text(headers, header::ETAG).filter(|tag| tag.starts_with('"'));
    let is_page = text(headers, header::CONTENT_TYPE)
        .is_some_and(|kind| kind.to_ascii_lowercase().starts_with("text/html"));
    Answer {
        status,
        url: shown(url),
        start,
        total,
        validator: strong.or_else(|| text(headers, header::LAST_MODIFIED)),
        is_page,
        body: Box::new(response.into_body().into_reader()),
    }
}

/// Start and total of `bytes START-END/TOTAL` (RFC 9110, section 14.4); the total may be `*`.
fn content_range(value: &str) -> (Option<u64>, Option<u64>) {
    let parts = value
        .trim()
        .strip_prefix("bytes ")
        .and_then(|v| v.split_once('/'));
    let Some((range, total)) = parts else {
        return (None, None);
    };
    let start = range.split_once('-').and_then(|(s, _)| s.parse().ok());
    (start, total.parse().ok())
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<String> {
    let value = headers.get(name)?.to_str().ok()?;
    Some(value.trim().to_owned())
}

/// Part of a message about unexpected bytes: networks that require a login answer every request with their own page.
#[must_use]
pub fn page_hint(bytes: &[u8]) -> &'static str {
    let text = bytes.trim_ascii_start();
    let starts = |with: &str| {
        text.get(..with.len())
            .is_some_and(|start| start.eq_ignore_ascii_case(with.as_bytes()))
    };
    if ["<!doctype", "<html", "<head", "<?xml"]
        .into_iter()
        .any(starts)
    {
        "it looks like a web page, as networks that ask for a login send; "
    } else {
        ""
    }
}

/// Reason of an interrupted body, on one line.
pub(crate) fn broken_by(error: std::io::Error) -> String {
    match ureq::Error::from(error) {
        ureq::Error::Timeout(_) => "no more in time".to_owned(),
        other => reason_of(&other),
    }
}

/// Reason of a missing response, on one line.
pub(crate) fn reason_of(error: &ureq::Error) -> String {
    match error {
        ureq::Error::HostNotFound => "no such host (or no network)".to_owned(),
        ureq::Error::Timeout(_) => "none in time".to_owned(),
        // Handshake refusals of rustls are reported as invalid data.
        ureq::Error::Io(e) if e.kind() == std::io::ErrorKind::InvalidData => {
            format!("no trustworthy encryption ({})", one_line(&e.to_string()))
        }
        ureq::Error::Io(e) => one_line(&e.to_string()),
        ureq::Error::Rustls(e) => {
            format!("no trustworthy encryption ({})", one_line(&e.to_string()))
        }
        other => one_line(&other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A loopback server with the certificate of the fixtures, which answers one request if that is trusted.
    fn encrypted_server() -> (String, std::thread::JoinHandle<bool>) {
        let fixture = |name: &str| {
            let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/tls/");
            std::fs::read(format!("{folder}{name}")).unwrap()
        };
        let key = rustls::pki_types::PrivatePkcs8KeyDer::from(fixture("server.key.der"));
        let provider = std::sync::Arc::new(rustls_graviola::default_provider());
        let config = rustls::ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(vec![fixture("server.crt.der").into()], key.into())
            .unwrap();
        let listener = std::net::TcpListener::bind("localhost:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let server = std::thread::spawn(move || {
            let (mut socket, _) = listener.accept().unwrap();
            let mut connection = rustls::ServerConnection::new(config.into()).unwrap();
            let mut stream = rustls::Stream::new(&mut connection, &mut socket);
            let mut request = [0; 4096];
            let asked = stream.read(&mut request).is_ok_and(|n| n > 0);
            let reply = b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nmodel";
            asked && std::io::Write::write_all(&mut stream, reply).is_ok()
        });
        (format!("https://localhost:{port}/made/up.onnx"), server)
    }

    #[test]
    fn encryption_needs_a_trusted_certificate() {
        if let Some(missing) = tls::missing() {
            println!("skipped: this CPU lacks {missing}");
            return;
        }
        let (range, waits) = (Range::default(), Waits::default());
        let certificate = include_bytes!("../tests/fixtures/tls/authority.crt.der");
        let trusted = RootCerts::new_with_certs(&[ureq::tls::Certificate::from_der(certificate)]);
        let (url, server) = encrypted_server();
        let response = send(&url, &range, waits, trusted).unwrap();
        let mut body = String::new();
        let mut reader = answer(200, &url, response).body;
        reader.read_to_string(&mut body).unwrap();
        assert_eq!(body, "model");
        assert!(server.join().unwrap());

        let (url, server) = encrypted_server();
        let e = send(&url, &range, waits, RootCerts::WebPki).unwrap_err();
        assert!(reason_of(&e).contains("trustworthy encryption"), "{e:?}");
        assert!(!server.join().unwrap(), "nothing was asked for");
    }

    #[test]
    fn cpu_without_encryption_support_is_reported() {
        let by_hand = "run `stillpoint models import yolox_nano.onnx`";
        let lacking = || Some("adx, avx2".to_owned());
        let e = refuse_without_encryption("HTTPS://host/file", lacking(), by_hand).unwrap_err();
        let said = e.to_string();
        for part in ["without adx, avx2", "models import yolox_nano.onnx"] {
            assert!(said.contains(part), "{said}");
        }
        assert!(refuse_without_encryption("http://host/file", lacking(), by_hand).is_ok());
        assert!(refuse_without_encryption("https://host/file", None, by_hand).is_ok());
    }

    #[test]
    fn content_ranges_are_parsed() {
        assert_eq!(content_range("bytes 5-9/10"), (Some(5), Some(10)));
        assert_eq!(content_range("bytes 5-9/*"), (Some(5), None));
        assert_eq!(content_range("bytes */10"), (None, Some(10)));
        for bad in [
            "",
            "5-9/10",
            "bytes 5",
            "bytes -/",
            "bytes a-b/c",
            "bytes 99999999999999999999-1/2",
        ] {
            assert_eq!(content_range(bad).0, None, "{bad}");
        }
    }
}
