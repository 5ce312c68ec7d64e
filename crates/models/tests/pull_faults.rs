//! Failing servers and networks: every failure is reported, leaves no partial file under a model's name, and leaves an older model
//! unchanged.

#![cfg(feature = "pull")]
use crate::pull_support::*;
use std::net::TcpListener;
use std::time::Duration;
use stillpoint_models::{FetchError, PullError, PullOptions};

#[test]
fn http_error_statuses_are_reported() {
    let model = model(b"model");
    for (status, part) in [
        ("404 Not Found", "404 (not found); look for a newer version"),
        ("410 Gone", "(not found)"),
        ("403 Forbidden", "403 (forbidden)"),
        ("429 Too Many", "try again later"),
        ("500 Internal", "500 (the server failed); try again later"),
        ("503 Busy", "try again later"),
        ("407 Proxy", "HTTPS_PROXY"),
        ("204 No Content", "204"),
        ("304 Not Modified", "304"),
        ("206 Partial Content", "206"),
        ("416 Range Not Satisfiable", "416"),
    ] {
        let e = fails(&model, move |_, _, stream| {
            reply(stream, status, "", b"model")
        });
        assert!(
            matches!(e, PullError::Fetch(FetchError::Status { .. })),
            "{e}"
        );
        assert!(e.to_string().contains(part), "{e}");
        assert!(e.to_string().contains("stillpoint models import"), "{e}");
    }
}

#[test]
fn redirects_are_followed() {
    let bytes = made_up_bytes();
    for location in [
        "/other/file?signature=x",
        "other",
        "HOST/far/away",
        "//PORT/x",
    ] {
        let (result, _scratch, server) = fetch(&model(bytes), move |number, request, stream| {
            if number > 0 {
                return serve(bytes, "\"v1\"", request, stream);
            }
            let host = request.header("host").unwrap();
            let location = location
                .replace("HOST", &format!("http://{host}"))
                .replace("PORT", host);
            reply(
                stream,
                "302 Found",
                &format!("Location: {location}\r\n"),
                b"over there",
            );
        });
        assert_eq!(result.unwrap().model.read().unwrap(), bytes, "{location}");
        assert_eq!(server.requests().len(), 2);
    }
    for status in ["301 A", "303 B", "307 C", "308 D"] {
        let (result, _, server) =
            fetch(&model(bytes), move |number, request, stream| match number {
                5 => serve(bytes, "\"v1\"", request, stream),
                _ => reply(stream, status, &format!("Location: /{number}\r\n"), b""),
            });
        assert!(result.is_ok(), "five are followed");
        assert_eq!(server.requests()[5].path, "/4");
    }
}

#[test]
fn unsafe_redirects_are_refused() {
    let model = model(b"model");
    for (location, part) in [
        ("Location: /again\r\n", "more than 5"),
        ("Location: ftp://host/file\r\n", "one to ftp://host/file"),
        (
            "Location: file:///etc/passwd\r\n",
            "one to file:///etc/passwd",
        ),
        ("Location:\r\n", "no address"),
        ("", "without an address"),
        ("Location: /\u{e4}\r\n", "without an address"),
    ] {
        let e = fails(&model, move |_, _, stream| {
            reply(stream, "302 Found", location, b"model")
        });
        assert!(
            matches!(e, PullError::Fetch(FetchError::Redirect { .. })),
            "{e}"
        );
        assert!(e.to_string().contains(part), "{e}");
    }
    // The body of a redirect is not read.
    let (result, scratch, _server) = fetch(&model, |number, request, stream| {
        if number > 0 {
            return serve(b"model", "\"v1\"", request, stream);
        }
        send(
            stream,
            b"HTTP/1.1 302 Found\r\nLocation: /x\r\nContent-Length: 999999999\r\n\r\n",
        );
        stall(stream);
    });
    assert_eq!(result.unwrap().model.read().unwrap(), b"model");
    assert!(!scratch.part().exists());
}

#[test]
fn silent_server_times_out() {
    let bytes = made_up_bytes();
    let model = model(bytes);
    let limit = Duration::from_millis(700);
    let (result, scratch, _server) = fetch_within(limit, &model, |_, _, stream| stall(stream));
    let e = failed(result, &scratch);
    assert!(
        matches!(e, PullError::Fetch(FetchError::Unreachable { .. })),
        "{e}"
    );
    assert!(e.to_string().contains("none in time"), "{e}");
    let (result, scratch, _server) = fetch_within(limit, &model, |_, _, stream| {
        send(stream, b"HTTP/1.1 200 OK\r\nContent-");
        stall(stream);
    });
    let e = failed(result, &scratch);
    assert!(
        matches!(e, PullError::Fetch(FetchError::Unreachable { .. })),
        "{e}"
    );
    let (result, scratch, _server) = fetch_within(limit, &model, |_, _, stream| {
        break_off(bytes, 30_000, "ETag: \"v1\"\r\n", stream);
        stall(stream);
    });
    let (received, reason) = broke_off(result, &scratch);
    assert_eq!((received, reason.as_str()), (30_000, "no more in time"));
}

/// A slow connection is not a broken one: each wait is limited, the total is not.
#[test]
fn slow_server_is_tolerated() {
    let limit = Duration::from_secs(2);
    let (result, _scratch, _server) = fetch_within(limit, &model(b"slowly"), |_, _, stream| {
        send(stream, b"HTTP/1.1 200 OK\r\nContent-Length: 6\r\n\r\n");
        for byte in b"slowly" {
            std::thread::sleep(Duration::from_millis(450));
            send(stream, &[*byte]);
        }
    });
    assert_eq!(result.unwrap().model.read().unwrap(), b"slowly");
}

#[test]
fn unreachable_server_is_reported() {
    let (scratch, model) = (Scratch::with_older(), model(b"model"));
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    for base in [
        format!("http://{port}"),
        "gopher://host".to_owned(),
        "http://".to_owned(),
        "no address".to_owned(),
    ] {
        let nowhere = PullOptions {
            base: Some(base),
            again: true,
            connect_timeout: Duration::from_secs(2),
            ..PullOptions::default()
        };
        let e = watch(&model, &scratch.cache, &nowhere).0.unwrap_err();
        assert!(
            matches!(e, PullError::Fetch(FetchError::Unreachable { .. })),
            "{e}"
        );
        for part in [
            "HTTPS_PROXY",
            model.url,
            "5 bytes",
            "SHA-256",
            "models import up.onnx",
            "made-up.onnx",
        ] {
            assert!(e.to_string().contains(part), "{e}");
        }
    }
    scratch.assert_older(&[]);
    // Encryption is requested, and the server does not support it.
    let server = Server::of(b"model");
    let secure = PullOptions {
        base: Some(server.base.replace("http", "https")),
        ..options(&server)
    };
    let e = watch(&model, &scratch.cache, &secure).0.unwrap_err();
    assert!(
        matches!(e, PullError::Fetch(FetchError::Unreachable { .. })),
        "{e}"
    );
    scratch.assert_older(&[]);
}

#[test]
fn invalid_http_responses_are_reported() {
    for answer in [
        "",
        "\r\n\r\n",
        "SSH-2.0-OpenSSH\r\n",
        "HTTP/1.1 banana\r\n\r\n",
        "HTTP/1.1 200 OK\r\nContent-Length: -5\r\n\r\nmodel",
    ] {
        let e = fails(&model(b"model"), move |_, _, stream| {
            send(stream, answer.as_bytes())
        });
        assert!(
            matches!(e, PullError::Fetch(FetchError::Unreachable { .. })),
            "{answer:?}: {e}"
        );
    }
    let e = fails(&model(b"model"), |_, _, stream| {
        send(stream, b"HTTP/1.1 200 OK\r\n");
        for _ in 0..20_000 {
            send(
                stream,
                b"X-Flood: aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\r\n",
            );
        }
    });
    assert!(
        matches!(e, PullError::Fetch(FetchError::Unreachable { .. })),
        "{e}"
    );
}
