//! Servers and networks that fail: every failure is told, leaves no half file, and leaves an older model as it was.
#![cfg(feature = "pull")]
#![allow(clippy::unwrap_used)]

mod pull_support;

use pull_support::*;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::time::Duration;
use stillpoint_models::{Checksum, KnownModel, PullError, PullOptions, Pulled};

/// Downloads the made-up model from a server that answers like this, over an older model.
fn fetch(
    model: &KnownModel,
    answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static,
) -> (Result<Pulled, PullError>, Scratch, Server) {
    let (server, scratch) = (Server::start(answer), Scratch::with_older());
    let patient = PullOptions {
        stall_timeout: Duration::from_millis(700),
        ..options(&server)
    };
    (watch(model, &scratch.cache, &patient).0, scratch, server)
}

/// The error of such a download, after which nothing but the older model is there.
fn fails(
    model: &KnownModel,
    answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static,
) -> PullError {
    let (result, scratch, _server) = fetch(model, answer);
    let e = result.unwrap_err();
    assert!(!e.to_string().contains('\n'), "{e}");
    scratch.assert_older(&[]);
    e
}

/// The same for a failure that keeps what came.
fn breaks_off(
    model: &KnownModel,
    answer: impl Fn(usize, &Request, &mut TcpStream) + Send + Sync + 'static,
) -> (u64, String) {
    let (result, scratch, _server) = fetch(model, answer);
    scratch.assert_older(&["made-up.part", "made-up.part.toml"]);
    match result.unwrap_err() {
        PullError::BrokenOff {
            received, reason, ..
        } => (received, reason),
        other => panic!("{other}"),
    }
}

/// Waits until the client has gone.
fn stall(stream: &mut TcpStream) {
    let _ = stream.read(&mut [0; 1]);
}

#[test]
fn statuses_are_told() {
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
        assert!(matches!(e, PullError::Status { .. }), "{e}");
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
fn odd_redirects_are_refused() {
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
        assert!(matches!(e, PullError::Redirect { .. }), "{e}");
        assert!(e.to_string().contains(part), "{e}");
    }
    // The body of a redirect is not waited for.
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
fn silence_ends() {
    let bytes = made_up_bytes();
    let model = model(bytes);
    let e = fails(&model, |_, _, stream| stall(stream));
    assert!(matches!(e, PullError::Unreachable { .. }), "{e}");
    assert!(e.to_string().contains("none in time"), "{e}");
    let e = fails(&model, |_, _, stream| {
        send(stream, b"HTTP/1.1 200 OK\r\nContent-");
        stall(stream);
    });
    assert!(matches!(e, PullError::Unreachable { .. }), "{e}");
    let (received, reason) = breaks_off(&model, |_, _, stream| {
        break_off(bytes, 30_000, "ETag: \"v1\"\r\n", stream);
        stall(stream);
    });
    assert_eq!((received, reason.as_str()), (30_000, "no more in time"));
}

/// A slow line is not a broken one: there is a limit for each wait, and none for the whole.
#[test]
fn slowness_is_borne() {
    let (result, _scratch, _server) = fetch(&model(b"slowly"), |_, _, stream| {
        send(stream, b"HTTP/1.1 200 OK\r\nContent-Length: 6\r\n\r\n");
        for byte in b"slowly" {
            std::thread::sleep(Duration::from_millis(200));
            send(stream, &[*byte]);
        }
    });
    assert_eq!(result.unwrap().model.read().unwrap(), b"slowly");
}

#[test]
fn no_server_is_told() {
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
            connect_timeout: Duration::from_secs(2),
            ..PullOptions::default()
        };
        let e = watch(&model, &scratch.cache, &nowhere).0.unwrap_err();
        assert!(matches!(e, PullError::Unreachable { .. }), "{e}");
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
    // Encryption is asked for, and the server speaks without.
    let server = Server::of(b"model");
    let secure = PullOptions {
        base: Some(server.base.replace("http", "https")),
        ..options(&server)
    };
    let e = watch(&model, &scratch.cache, &secure).0.unwrap_err();
    assert!(matches!(e, PullError::Unreachable { .. }), "{e}");
    scratch.assert_older(&[]);
}

#[test]
fn what_is_not_http_is_told() {
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
            matches!(e, PullError::Unreachable { .. }),
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
    assert!(matches!(e, PullError::Unreachable { .. }), "{e}");
}

#[test]
fn lengths_are_not_believed() {
    let bytes = made_up_bytes();
    let model = model(bytes);
    // More or less than was published, and it says so.
    for body in [&bytes[1..], b"", &[0; 300_000]] {
        let e = fails(&model, move |_, _, stream| {
            reply(stream, "200 OK", "", body)
        });
        assert!(matches!(e, PullError::Size { .. }), "{e}");
        assert!(e.to_string().contains("expected 200003 bytes"), "{e}");
    }
    // The same without a word: the end of the connection is the end of the file.
    let open = b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n";
    let e = fails(&model, |_, _, stream| {
        send(stream, open);
        send(stream, &[7; 300_000]);
    });
    assert!(e.to_string().contains("found more than 200003"), "{e}");
    let (received, _) = breaks_off(&model, |_, _, stream| {
        send(stream, open);
        send(stream, &bytes[..1000]);
    });
    assert_eq!(received, 1000);
    // In pieces, without an end.
    let e = fails(&model, |_, _, stream| {
        send(
            stream,
            b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n",
        );
        for _ in 0..1000 {
            send(
                stream,
                format!("400\r\n{}\r\n", "x".repeat(1024)).as_bytes(),
            );
        }
    });
    assert!(matches!(e, PullError::Size { .. }), "{e}");
    // A size that no model has, where none is known.
    let e = fails(&unknown(), |_, _, stream| {
        send(
            stream,
            b"HTTP/1.1 200 OK\r\nContent-Length: 600000000\r\n\r\n",
        );
        stall(stream);
    });
    assert!(
        e.to_string()
            .contains("at most 536870912 bytes, found 600000000"),
        "{e}"
    );
    // A part, of which the server says another total than was published.
    let e = fails(&model, |number, request, stream| {
        assert_eq!(number, 0);
        let _ = request;
        reply(
            stream,
            "206 Partial Content",
            "Content-Range: bytes 0-4/5\r\n",
            b"model",
        );
    });
    assert!(matches!(e, PullError::Status { status: 206, .. }), "{e}");
}

#[test]
fn other_files_are_refused() {
    let bytes = made_up_bytes();
    let mut wrong = bytes.to_vec();
    wrong[199_999] ^= 1;
    let wrong: &'static [u8] = wrong.leak();
    let e = fails(&model(bytes), |_, r, stream| {
        serve(wrong, "\"v1\"", r, stream)
    });
    let (expected, found) = (model(bytes).sha256.unwrap(), model(wrong).sha256.unwrap());
    assert!(
        e.to_string().contains(&format!(
            "expected SHA-256 {expected} (as published), found {found}"
        )),
        "{e}"
    );
    assert!(!e.to_string().contains("web page"), "{e}");

    let page: &'static [u8] = b"\n <!DOCTYPE html><html>Please log in</html>";
    let length_fits = KnownModel {
        bytes: Some(page.len() as u64),
        ..model(b"model")
    };
    let e = fails(&length_fits, |_, r, stream| {
        serve(page, "\"v1\"", r, stream)
    });
    assert!(matches!(e, PullError::Checksum { .. }), "{e}");
    assert!(e.to_string().contains("looks like a web page"), "{e}");
    for model in [length_fits, unknown()] {
        let e = fails(&model, |_, _, stream| {
            reply(
                stream,
                "200 OK",
                "Content-Type: Text/HTML; charset=utf-8\r\n",
                page,
            );
        });
        assert!(matches!(e, PullError::WebPage { .. }), "{e}");
        assert!(e.to_string().contains("asks for a login"), "{e}");
    }
}

#[test]
fn the_first_download_is_recorded_where_no_checksum_is_known() {
    let scratch = Scratch::new();
    let server = Server::start(|number, r, stream| match number {
        0 | 1 => serve(b"model", "\"v1\"", r, stream),
        _ => serve(b"other", "\"v2\"", r, stream),
    });
    let first = get(&unknown(), &scratch.cache, &server).unwrap();
    assert_eq!(first.checksum, Checksum::Recorded);
    let recorded = scratch.cache.folder().join("made-up.sha256");
    let text = std::fs::read_to_string(&recorded).unwrap();
    assert_eq!(
        text,
        format!("{}  up.onnx\n", model(b"model").sha256.unwrap())
    );

    assert_eq!(
        get(&unknown(), &scratch.cache, &server)
            .unwrap()
            .transferred,
        0
    );
    // The record outlives the model.
    for file in ["made-up.onnx", "made-up.record.toml"] {
        std::fs::remove_file(scratch.cache.folder().join(file)).unwrap();
    }
    let second = get(&unknown(), &scratch.cache, &server).unwrap();
    assert_eq!(
        (second.checksum, second.transferred),
        (Checksum::MatchesRecord, 5)
    );

    let again = PullOptions {
        again: true,
        ..options(&server)
    };
    let e = watch(&unknown(), &scratch.cache, &again).0.unwrap_err();
    assert!(matches!(e, PullError::Checksum { .. }), "{e}");
    for part in [
        "as of the first download",
        &format!("remove {}", recorded.display()),
    ] {
        assert!(e.to_string().contains(part), "{e}");
    }
    assert_eq!(second.model.read().unwrap(), b"model");
    assert_eq!(
        scratch.files(),
        ["made-up.onnx", "made-up.record.toml", "made-up.sha256"]
    );

    std::fs::write(&recorded, "banana").unwrap();
    let e = watch(&unknown(), &scratch.cache, &again)
        .0
        .unwrap_err()
        .to_string();
    assert!(e.contains("remove this file"), "{e}");
    std::fs::remove_file(&recorded).unwrap();
    let third = watch(&unknown(), &scratch.cache, &again).0.unwrap();
    assert_eq!(third.checksum, Checksum::Recorded);
    assert_eq!(third.model.read().unwrap(), b"other");
}

/// Without a validator and without a checksum nobody could tell that the file changed in between.
#[test]
fn parts_that_nothing_vouches_for_are_not_gone_on_with() {
    let bytes = made_up_bytes();
    for (headers, start) in [("", None), ("ETag: \"v1\"\r\n", Some(1000))] {
        let (result, scratch, server) = fetch(&unknown(), move |number, r, stream| match number {
            0 => break_off(bytes, 1000, headers, stream),
            _ => serve(bytes, "\"v1\"", r, stream),
        });
        assert!(matches!(
            result,
            Err(PullError::BrokenOff { received: 1000, .. })
        ));
        let pulled = get(&unknown(), &scratch.cache, &server).unwrap();
        assert_eq!(pulled.model.read().unwrap(), bytes);
        assert_eq!(server.requests()[1].start(), start);
    }
}
