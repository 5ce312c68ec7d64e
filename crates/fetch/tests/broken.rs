//! Lost connections, full disks, servers without ranges: the partial download is kept, or repeated.

use crate::packed::*;
use std::ops::ControlFlow;
use stillpoint_fetch::archive::{ArchiveError, Packing};
use stillpoint_fetch::{FetchError, Progress, RealDisk};
use stillpoint_testdata::server::{Server, break_off, reply, serve};

const TAG: &str = "ETag: \"v1\"\r\n";

#[test]
fn interrupted_download_is_resumed() {
    let bytes: &'static [u8] = sequence().leak();
    let server = at_first(
        move |_, stream| break_off(bytes, 100_000, TAG, stream),
        move |request, stream| serve(bytes, "\"v1\"", request, stream),
    );
    let place = Place::new();
    let e = place.pull(&server, Packing::TarGz).unwrap_err();
    assert!(e.to_string().contains("it goes on from"), "{e}");
    assert_eq!(place.names(), ["walk.bin.part", "walk.bin.part.toml"]);
    let pulled = place.pull(&server, Packing::TarGz).unwrap();
    assert_eq!(pulled.resumed, 100_000);
    assert_eq!(server.requests()[1].start(), Some(100_000));
    assert_eq!(server.requests()[1].header("if-range"), Some("\"v1\""));
    place.assert_whole();
    // The checksum is that of the complete file, not of the last part.
    let whole = Place::new();
    let at_once = whole.pull(&Server::of(bytes), Packing::TarGz).unwrap();
    assert_eq!(
        pulled.sha256.map(|(sum, _)| sum),
        at_once.sha256.map(|(sum, _)| sum)
    );
}

#[test]
fn changed_file_or_missing_range_support_restarts() {
    let bytes: &'static [u8] = sequence().leak();
    for ranges in [true, false] {
        let server = at_first(
            move |_, stream| break_off(&[7; 150_000], 90_000, TAG, stream),
            move |request, stream| match ranges {
                true => serve(bytes, "\"v2\"", request, stream),
                false => reply(stream, "200 OK", "", bytes),
            },
        );
        let place = Place::new();
        place.pull(&server, Packing::TarGz).unwrap_err();
        let pulled = place.pull(&server, Packing::TarGz).unwrap();
        assert_eq!(pulled.resumed, 0);
        place.assert_whole();
    }
}

#[test]
fn missing_file_is_reported() {
    let server = Server::start(|_, _, stream| reply(stream, "404 Not Found", "", b""));
    let place = Place::new();
    let e = place.pull(&server, Packing::TarGz).unwrap_err().to_string();
    let by_hand = format!(
        "/made/walk.bin in another way and unpack it in {}",
        place.path().display()
    );
    for part in ["404 (not found)", &by_hand] {
        assert!(e.contains(part), "{e}");
    }
    assert_eq!(place.names(), [""; 0]);
}

/// Also with a server without ranges and versions: the file is complete.
#[test]
fn full_disk_while_unpacking_keeps_the_download() {
    let bytes: &'static [u8] = sequence().leak();
    let server = Server::start(move |_, _, stream| reply(stream, "200 OK", "", bytes));
    let place = Place::new();
    let full = SmallDisk {
        room: 100_000,
        free: None,
    };
    let e = place.pull_to(&server, Packing::TarGz, &full).unwrap_err();
    assert!(matches!(e, ArchiveError::Write { .. }), "{e}");
    for part in [
        "1.png",
        "free some space",
        "the same command goes on from it",
    ] {
        assert!(e.to_string().contains(part), "{e}");
    }
    assert_eq!(place.names(), ["walk.bin.part", "walk.bin.part.toml"]);
    let pulled = place.pull(&server, Packing::TarGz).unwrap();
    assert_eq!(
        (pulled.transferred, pulled.resumed),
        (0, bytes.len() as u64)
    );
    assert_eq!(server.requests().len(), 1);
    place.assert_whole();
}

#[test]
fn too_small_disk_is_reported_before_downloading() {
    let bytes: &'static [u8] = sequence().leak();
    let server = at_first(
        move |_, stream| break_off(bytes, 100_000, TAG, stream),
        move |request, stream| serve(bytes, "\"v1\"", request, stream),
    );
    let place = Place::new();
    place.pull(&server, Packing::TarGz).unwrap_err();
    // Twice the archive, less the bytes present.
    let needed = 2 * bytes.len() as u64 - 100_000;
    let disk = |free| SmallDisk {
        room: usize::MAX,
        free: Some(free),
    };
    let e = place.pull_to(&server, Packing::TarGz, &disk(needed - 1));
    let e = e.unwrap_err();
    assert!(
        matches!(e, ArchiveError::Fetch(FetchError::Room { .. })),
        "{e}"
    );
    let said = format!("expected {needed} bytes of free space");
    assert!(e.to_string().contains(&said), "{e}");
    assert_eq!(place.names(), ["walk.bin.part", "walk.bin.part.toml"]);
    let pulled = place
        .pull_to(&server, Packing::TarGz, &disk(needed))
        .unwrap();
    assert_eq!(pulled.resumed, 100_000);
}

#[test]
fn stopping_keeps_the_partial_download() {
    let bytes: &'static [u8] = sequence().leak();
    let server = Server::of(bytes);
    let place = Place::new();
    // During unpacking, and the remains of a killed process.
    let mut stop = |state| match state {
        Progress::Unpacking { .. } => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let e = place.watched(&server, Packing::TarGz, &RealDisk, &mut stop);
    assert!(e.unwrap_err().is_stopped());
    assert_eq!(place.names(), ["walk.bin.part", "walk.bin.part.toml"]);
    let left = place.path().join(".unpacking-rgbd_walk");
    std::fs::create_dir(&left).unwrap();
    std::fs::write(left.join("rgb.txt"), "half").unwrap();
    let pulled = place.pull(&server, Packing::TarGz).unwrap();
    assert_eq!(pulled.resumed, bytes.len() as u64);
    place.assert_whole();
}
