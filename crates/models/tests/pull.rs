//! Downloads that succeed, break off and are resumed.

#![cfg(feature = "pull")]
use crate::pull_support::*;
use std::ops::ControlFlow;
use std::sync::mpsc;
use stillpoint_inference::{Cache, CacheError, State};
use stillpoint_models::{
    Checksum, FetchError, KnownModel, Progress, PullError, PullOptions, known, pull,
};

#[test]
fn model_is_downloaded_only_once() {
    let bytes = made_up_bytes();
    let (server, scratch, model) = (Server::of(bytes), Scratch::new(), model(bytes));
    let (pulled, seen) = watch(&model, &scratch.cache, &options(&server));
    let pulled = pulled.unwrap();
    assert_eq!(pulled.checksum, Checksum::Verified);
    assert_eq!(Some(pulled.sha256.as_str()), model.sha256);
    assert_eq!(pulled.url, format!("{}/made/up.onnx", server.base));
    assert_eq!(
        (pulled.transferred, pulled.resumed),
        (bytes.len() as u64, 0)
    );
    assert_eq!(pulled.model.read().unwrap(), bytes);
    assert_eq!(pulled.model.state, State::Good);
    let record = pulled.model.record.as_ref().unwrap();
    assert_eq!(record.source.as_deref(), Some(pulled.url.as_str()));
    assert_eq!(record.licence.as_deref(), Some("MIT"));
    assert_eq!(scratch.files(), ["made-up.onnx", "made-up.record.toml"]);

    let total = bytes.len() as u64;
    assert!(matches!(&seen[0], Progress::Connecting { url } if *url == pulled.url));
    assert_eq!(seen.last(), Some(&Progress::Checking));
    let mut before = 0;
    for step in &seen[1..seen.len() - 1] {
        let Progress::Receiving {
            received,
            total: t,
            resumed: 0,
        } = step
        else {
            panic!("{step:?}");
        };
        assert!(*received >= before && *received - before <= 1 << 16);
        assert_eq!(*t, Some(total));
        before = *received;
    }
    assert_eq!(before, total);

    let again = get_once(&model, &scratch.cache, &server).unwrap();
    assert_eq!((again.model, again.transferred), (pulled.model.clone(), 0));
    assert_eq!(server.requests().len(), 1, "it was here");
    let forced = get(&model, &scratch.cache, &server).unwrap();
    assert_eq!(forced.transferred, total);
    assert_eq!(server.requests().len(), 2);

    // A model that was damaged since then is downloaded again.
    std::fs::write(&pulled.model.onnx, b"damaged").unwrap();
    assert_eq!(
        get_once(&model, &scratch.cache, &server)
            .unwrap()
            .transferred,
        total
    );
    assert_eq!(scratch.files(), ["made-up.onnx", "made-up.record.toml"]);
}

/// A server that breaks off the first response, and the cache after that.
fn broken_off(
    sent: usize,
    headers: &'static str,
    then: impl Fn(&Request, &mut std::net::TcpStream) + Send + Sync + 'static,
) -> (Server, Scratch, KnownModel) {
    let bytes = made_up_bytes();
    let server = Server::start(move |number, request, stream| match number {
        0 => break_off(bytes, sent, headers, stream),
        _ => then(request, stream),
    });
    let (scratch, model) = (Scratch::with_older(), model(bytes));
    let e = get(&model, &scratch.cache, &server).unwrap_err();
    assert_eq!(e.part(), Some(scratch.part().as_path()));
    match &e {
        PullError::Fetch(FetchError::BrokenOff {
            received, total, ..
        }) => {
            assert_eq!(*received, sent as u64);
            assert_eq!(*total, Some(bytes.len() as u64));
        }
        other => panic!("{other}"),
    }
    assert!(e.to_string().contains("run the same command again"), "{e}");
    assert_eq!(std::fs::read(scratch.part()).unwrap(), &bytes[..sent]);
    scratch.assert_older(&["made-up.part", "made-up.part.toml"]);
    (server, scratch, model)
}

#[test]
fn interrupted_download_is_resumed() {
    let bytes = made_up_bytes();
    for (headers, validator) in [
        ("ETag: \"v1\"\r\n", Some("\"v1\"")),
        (
            "ETag: W/\"v1\"\r\nLast-Modified: Sat, 31 Jan 2026 12:00:00 GMT\r\n",
            Some("Sat, 31 Jan 2026 12:00:00 GMT"),
        ),
        // The checksum would detect a change of the file.
        ("ETag: W/\"v1\"\r\n", None),
    ] {
        let tag = validator.unwrap_or_default();
        let (server, scratch, model) = broken_off(70_001, headers, move |r, stream| {
            serve(bytes, tag, r, stream)
        });
        let (pulled, seen) = watch(&model, &scratch.cache, &options(&server));
        let pulled = pulled.unwrap();
        let second = &server.requests()[1];
        assert_eq!(second.header("range"), Some("bytes=70001-"));
        assert_eq!(second.header("if-range"), validator);
        assert_eq!(second.header("accept-encoding"), Some("identity"));
        assert_eq!(pulled.model.read().unwrap(), bytes);
        assert_eq!(pulled.resumed, 70_001);
        assert_eq!(pulled.transferred, bytes.len() as u64 - 70_001);
        assert!(matches!(
            seen[1],
            Progress::Receiving {
                received: 70_001,
                resumed: 70_001,
                ..
            }
        ));
        assert_eq!(scratch.files(), ["made-up.onnx", "made-up.record.toml"]);
    }
}

#[test]
fn unresumable_download_starts_over() {
    let bytes = made_up_bytes();
    let tag = "ETag: \"v1\"\r\n";
    let last = bytes.len() - 1;
    let odd = |range: String| {
        move |r: &Request, stream: &mut std::net::TcpStream| match r.start() {
            Some(start) => reply(stream, "206 Partial Content", &range, &bytes[start..]),
            None => serve(bytes, "\"v2\"", r, stream),
        }
    };
    let cases = [
        // The file changed, so If-Range does not hold; a server without ranges.
        broken_off(5_000, tag, move |r, stream| {
            serve(bytes, "\"v2\"", r, stream)
        }),
        broken_off(5_000, tag, move |_, stream| {
            reply(stream, "200 OK", "", bytes)
        }),
        // Ranges other than requested.
        broken_off(
            5_000,
            tag,
            odd(format!(
                "Content-Range: bytes 4999-{last}/{}\r\n",
                bytes.len()
            )),
        ),
        broken_off(
            5_000,
            tag,
            odd("Content-Range: bytes 5000-5000/5000\r\n".to_owned()),
        ),
        broken_off(5_000, tag, odd("Content-Range: lines 1-2/3\r\n".to_owned())),
        broken_off(5_000, tag, odd(String::new())),
        broken_off(5_000, tag, move |r, stream| match r.start() {
            Some(_) => reply(stream, "416 Range Not Satisfiable", "", b""),
            None => serve(bytes, "\"v2\"", r, stream),
        }),
    ];
    for (number, (server, scratch, model)) in cases.into_iter().enumerate() {
        let pulled = get(&model, &scratch.cache, &server).unwrap();
        assert_eq!(pulled.model.read().unwrap(), bytes, "case {number}");
        assert_eq!(pulled.resumed, 0, "case {number}");
        assert_eq!(server.requests()[1].start(), Some(5_000), "case {number}");
    }
}

#[test]
fn foreign_part_file_is_not_used() {
    let bytes = made_up_bytes();
    for (part, origin) in [
        (&bytes[..9], None),
        (&bytes[..9], Some("no record")),
        (
            &bytes[..9],
            Some("url = \"https://elsewhere/made/up.onnx\"\n"),
        ),
        (
            &[0; 300_000],
            Some("url = \"URL\"\nvalidator = \"\\\"v1\\\"\"\n"),
        ),
        (
            &bytes[..9],
            Some("url = \"URL\"\nvalidator = \"a\\r\\nHost: b\"\n"),
        ),
        (&bytes[..0], Some("url = \"URL\"\n")),
    ] {
        let (server, scratch, model) = (Server::of(bytes), Scratch::with_older(), model(bytes));
        std::fs::write(scratch.part(), part).unwrap();
        if let Some(origin) = origin {
            let url = format!("{}/made/up.onnx", server.base);
            let path = scratch.part().with_extension("part.toml");
            std::fs::write(path, origin.replace("URL", &url)).unwrap();
        }
        let pulled = get(&model, &scratch.cache, &server).unwrap();
        assert_eq!(pulled.model.read().unwrap(), bytes);
        let requests = server.requests();
        assert_eq!(requests.len(), 1, "{origin:?}");
        assert_eq!(requests[0].header("range"), None, "{origin:?}");
    }
}

#[test]
fn complete_part_file_needs_no_server() {
    let bytes = made_up_bytes();
    let (scratch, model) = (Scratch::with_older(), model(bytes));
    let server = Server::start(|_, _, stream| reply(stream, "500 No", "", b""));
    let origin = format!("url = \"{}/made/up.onnx\"\n", server.base);
    let write = |part: &[u8]| {
        std::fs::write(scratch.part(), part).unwrap();
        std::fs::write(scratch.part().with_extension("part.toml"), &origin).unwrap();
    };
    let mut wrong = bytes.to_vec();
    wrong[100] ^= 1;
    write(&wrong);
    let e = get(&model, &scratch.cache, &server).unwrap_err();
    assert!(matches!(e, PullError::Checksum { .. }), "{e}");
    scratch.assert_older(&[]);
    write(bytes);
    let pulled = get(&model, &scratch.cache, &server).unwrap();
    assert_eq!(
        (pulled.transferred, pulled.resumed),
        (0, bytes.len() as u64)
    );
    assert_eq!(pulled.model.read().unwrap(), bytes);
    assert_eq!(server.requests().len(), 0);
}

#[test]
fn stopping_keeps_the_partial_download() {
    let bytes = made_up_bytes();
    let (server, scratch, model) = (Server::of(bytes), Scratch::with_older(), model(bytes));
    let e = pull(
        &model,
        &scratch.cache,
        &options(&server),
        &mut |progress| match progress {
            Progress::Receiving { received, .. } if received > 50_000 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        },
    )
    .unwrap_err();
    let PullError::Fetch(FetchError::Stopped { received, .. }) = e else {
        panic!("{e}");
    };
    assert!(received > 50_000 && received < bytes.len() as u64);
    scratch.assert_older(&["made-up.part", "made-up.part.toml"]);
    let pulled = get(&model, &scratch.cache, &server).unwrap();
    assert_eq!(pulled.resumed, received);
    assert_eq!(pulled.model.read().unwrap(), bytes);

    // Before the first byte.
    let scratch = Scratch::new();
    let e = pull(&model, &scratch.cache, &options(&server), &mut |_| {
        ControlFlow::Break(())
    });
    assert!(matches!(
        e,
        Err(PullError::Fetch(FetchError::Stopped { received: 0, .. }))
    ));
    assert!(scratch.files().is_empty());
}

#[test]
fn concurrent_downloads_do_not_mix() {
    let bytes = made_up_bytes();
    let (server, scratch, model) = (Server::of(bytes), Scratch::new(), model(bytes));
    let (inside, is_inside) = mpsc::channel();
    let (go_on, may_go_on) = mpsc::channel::<()>();
    let (first, second) = std::thread::scope(|scope| {
        let (cache, model, server) = (&scratch.cache, &model, &server);
        let first = scope.spawn(move || {
            let mut waited = false;
            pull(model, cache, &options(server), &mut |progress| {
                if matches!(progress, Progress::Receiving { .. }) && !waited {
                    waited = true;
                    inside.send(()).unwrap();
                    may_go_on.recv().unwrap();
                }
                ControlFlow::Continue(())
            })
        });
        is_inside.recv().unwrap();
        let second = get(model, cache, server);
        go_on.send(()).unwrap();
        (first.join().unwrap(), second)
    });
    let e = second.unwrap_err();
    assert!(
        matches!(e, PullError::Fetch(FetchError::Busy { .. })),
        "{e}"
    );
    assert!(e.to_string().contains("made-up"), "{e}");
    assert_eq!(first.unwrap().model.read().unwrap(), bytes);
    // A remaining lock file is not a lock.
    assert!(get(&model, &scratch.cache, &server).is_ok());
}

#[test]
fn names_and_folders_are_checked_before_download() {
    let bytes = made_up_bytes();
    let server = Server::of(bytes);
    for name in ["../made-up", "a/b", "", "nul"] {
        let scratch = Scratch::new();
        let model = KnownModel {
            name,
            ..model(bytes)
        };
        let e = get(&model, &scratch.cache, &server).unwrap_err();
        assert!(
            matches!(e, PullError::Cache(CacheError::Name { .. })),
            "{e}"
        );
        assert!(scratch.files().is_empty());
    }
    let scratch = Scratch::new();
    let file = scratch.cache.folder();
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::write(&file, b"a file").unwrap();
    for cache in [scratch.cache.clone(), Cache::at(file.join("deeper"))] {
        let e = get(&model(bytes), &cache, &server).unwrap_err();
        assert!(
            matches!(e, PullError::Cache(CacheError::NoFolder { .. })),
            "{e}"
        );
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"a file");
    assert!(server.requests().is_empty());
}

#[test]
fn known_models_are_requested_from_a_mirror() {
    let scratch = Scratch::new();
    let server = Server::start(|_, _, stream| reply(stream, "404 Not Found", "", b""));
    let nano = known("yolox-nano").unwrap();
    let with_slash = PullOptions {
        base: Some(format!("{}/mirror/", server.base)),
        ..options(&server)
    };
    let e = watch(nano, &scratch.cache, &with_slash)
        .0
        .unwrap_err()
        .to_string();
    assert_eq!(
        server.requests()[0].path,
        "/mirror/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx"
    );
    // File, source, checksum and destination.
    for part in [
        nano.url,
        "3659407 bytes",
        nano.sha256.unwrap(),
        "stillpoint models import yolox_nano.onnx",
    ] {
        assert!(e.contains(part), "{e}");
    }
    assert!(
        e.contains(&scratch.cache.onnx_path("yolox-nano").display().to_string()),
        "{e}"
    );
}
