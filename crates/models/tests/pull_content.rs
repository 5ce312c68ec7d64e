//! Files other than the published one: longer, shorter, different, web pages; and files of unknown size and checksum.

#![cfg(feature = "pull")]
use crate::pull_support::*;
use stillpoint_inference::sha256_hex;
use stillpoint_models::{Checksum, FetchError, KnownModel, PullError, PullOptions};

#[test]
fn stated_lengths_are_verified() {
    let bytes = made_up_bytes();
    let model = model(bytes);
    // More or less than was published, with a correct length.
    for body in [&bytes[1..], b"", &[0; 300_000]] {
        let e = fails(&model, move |_, _, stream| {
            reply(stream, "200 OK", "", body)
        });
        assert!(
            matches!(e, PullError::Fetch(FetchError::Size { .. })),
            "{e}"
        );
        assert!(e.to_string().contains("expected 200003 bytes"), "{e}");
    }
    // The same without a length: the end of the connection is the end of the file.
    let open = b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n";
    let e = fails(&model, |_, _, stream| {
        send(stream, open);
        send(stream, &[7; 300_000]);
    });
    assert!(e.to_string().contains("found more than 200003"), "{e}");
    let (result, scratch, _server) = fetch(&model, |_, _, stream| {
        send(stream, open);
        send(stream, &bytes[..1000]);
    });
    assert_eq!(broke_off(result, &scratch).0, 1000);
    // Chunked, without an end.
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
    assert!(
        matches!(e, PullError::Fetch(FetchError::Size { .. })),
        "{e}"
    );
    // A size beyond any model, of an unknown model.
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
    // A partial response with another total than published.
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
    assert!(
        matches!(e, PullError::Fetch(FetchError::Status { status: 206, .. })),
        "{e}"
    );
}

#[test]
fn wrong_files_are_refused() {
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
        assert!(
            matches!(e, PullError::Fetch(FetchError::WebPage { .. })),
            "{e}"
        );
        assert!(e.to_string().contains("asks for a login"), "{e}");
    }
}

#[test]
fn first_download_without_a_known_checksum_is_recorded() {
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
        get_once(&unknown(), &scratch.cache, &server)
            .unwrap()
            .transferred,
        0
    );
    // The record remains after the model.
    for file in ["made-up.onnx", "made-up.record.toml"] {
        std::fs::remove_file(scratch.cache.folder().join(file)).unwrap();
    }
    let second = get(&unknown(), &scratch.cache, &server).unwrap();
    assert_eq!(
        (second.checksum, second.transferred),
        (Checksum::MatchesRecord, 5)
    );

    let again = options(&server);
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

/// Without a validator and without a checksum, a change of the file in between would go unnoticed.
#[test]
fn parts_without_validator_or_checksum_are_not_resumed() {
    let bytes = made_up_bytes();
    for (headers, start) in [("", None), ("ETag: \"v1\"\r\n", Some(1000))] {
        let (result, scratch, server) = fetch(&unknown(), move |number, r, stream| match number {
            0 => break_off(bytes, 1000, headers, stream),
            _ => serve(bytes, "\"v1\"", r, stream),
        });
        assert!(matches!(
            result,
            Err(PullError::Fetch(FetchError::BrokenOff {
                received: 1000,
                ..
            }))
        ));
        let pulled = get(&unknown(), &scratch.cache, &server).unwrap();
        assert_eq!(pulled.model.read().unwrap(), bytes);
        assert_eq!(server.requests()[1].start(), start);
    }
}

#[test]
fn other_model_of_the_same_name_is_not_replaced_unasked() {
    let server = Server::of(b"model");
    for known in [model(b"model"), unknown()] {
        let scratch = Scratch::with_older();
        let refused = |what: &str| {
            let e = get_once(&known, &scratch.cache, &server).unwrap_err();
            assert!(matches!(e, PullError::Another { .. }), "{what}: {e}");
            for part in ["made-up.onnx", "--again", &sha256_hex(b"older")] {
                assert!(e.to_string().contains(part), "{what}: {e}");
            }
        };
        refused("imported");
        scratch.assert_older(&[]);
        let record = scratch.cache.record_path("made-up");
        std::fs::remove_file(&record).unwrap();
        refused("put there by hand");
        assert_eq!(scratch.files(), ["made-up.onnx", "made-up.toml"]);
        assert!(server.requests().is_empty());
    }
    // Requested, and damaged.
    for (damage, known) in [(false, model(b"model")), (true, unknown())] {
        let scratch = Scratch::with_older();
        let pulled = if damage {
            std::fs::write(scratch.cache.onnx_path("made-up"), b"damaged").unwrap();
            get_once(&known, &scratch.cache, &server)
        } else {
            get(&known, &scratch.cache, &server)
        };
        let pulled = pulled.unwrap();
        assert_eq!(pulled.model.read().unwrap(), b"model");
        assert_eq!(pulled.model.card, None);
    }
    // A downloaded file is not the user's own, even after its checksum was removed.
    let scratch = Scratch::new();
    get_once(&unknown(), &scratch.cache, &server).unwrap();
    let recorded = scratch.cache.folder().join("made-up.sha256");
    std::fs::remove_file(&recorded).unwrap();
    let second = get_once(&unknown(), &scratch.cache, &server).unwrap();
    assert_eq!(second.checksum, Checksum::Recorded);
}

#[test]
fn passwords_of_mirrors_are_not_shown() {
    let bytes = made_up_bytes();
    let server = Server::start(move |number, r, stream| match number {
        0 => break_off(bytes, 1000, "ETag: \"v1\"\r\n", stream),
        _ => serve(bytes, "\"v1\"", r, stream),
    });
    let scratch = Scratch::new();
    let secret = PullOptions {
        base: Some(server.base.replace("//", "//ada:secret@")),
        ..options(&server)
    };
    let known = model(bytes);
    let (broken, seen) = watch(&known, &scratch.cache, &secret);
    assert!(!format!("{seen:?} {}", broken.unwrap_err()).contains("secret"));
    let (pulled, seen) = watch(&known, &scratch.cache, &secret);
    let pulled = pulled.unwrap();
    assert_eq!(pulled.resumed, 1000);
    assert_eq!(pulled.url, format!("{}/made/up.onnx", server.base));
    assert!(!format!("{seen:?}").contains("secret"));
    let record = pulled.model.record.as_ref().unwrap();
    assert_eq!(record.source.as_deref(), Some(pulled.url.as_str()));
    for file in scratch.files() {
        let stored = std::fs::read(scratch.cache.folder().join(&file)).unwrap();
        assert!(!stored.windows(6).any(|w| w == b"secret"), "{file}");
    }
}
