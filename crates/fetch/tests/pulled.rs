//! Successful downloads of archives, with their checksums.

use crate::packed::*;
use std::fs;
use stillpoint_fetch::archive::{ArchiveError, Packing};
use stillpoint_fetch::{Checksum, Progress, RealDisk};
use stillpoint_testdata::server::{Server, serve};

#[test]
fn archive_is_unpacked_and_fetched_only_once() {
    let bytes = sequence().leak();
    let (place, server) = (Place::new(), Server::of(bytes));
    let mut seen = Vec::new();
    let pulled = place.watched(&server, Packing::TarGz, &RealDisk, &mut |state| {
        seen.push(state);
        std::ops::ControlFlow::Continue(())
    });
    let pulled = pulled.unwrap();
    place.assert_whole();
    let (sha256, checksum) = pulled.sha256.unwrap();
    assert_eq!(checksum, Checksum::Recorded);
    let record = fs::read_to_string(&pulled.record).unwrap();
    assert_eq!(record, format!("{sha256}  walk.bin\n"));
    assert_eq!(pulled.transferred, bytes.len() as u64);
    // The size is known before the first byte.
    let total = Some(bytes.len() as u64);
    assert!(matches!(&seen[0], Progress::Connecting { .. }));
    assert!(matches!(&seen[1], Progress::Receiving { received: 0, total: t, .. } if *t == total));
    assert!(matches!(
        seen.last(),
        Some(Progress::Unpacking { done, total }) if 0 < *done && done <= total
    ));

    let again = place.pull(&server, Packing::TarGz).unwrap();
    assert_eq!(again.sha256, Some((sha256, Checksum::MatchesRecord)));
    assert_eq!((again.transferred, again.folder), (0, pulled.folder));
    assert_eq!(server.requests().len(), 1);
}

#[test]
fn zip_is_unpacked_with_or_without_a_top_folder() {
    let image = image();
    for top in ["walk/", ""] {
        let names = ["rgb.txt", "rgb/1.png", "empty.txt"].map(|n| format!("{top}{n}"));
        let files: Vec<(&str, &[u8])> = names
            .iter()
            .map(String::as_str)
            .zip([b"1.0 rgb/1.png\n".as_slice(), image, b""])
            .collect();
        let (place, server) = (Place::new(), Server::of(zipped(&files).leak()));
        place.pull(&server, Packing::Zip).unwrap();
        place.assert_whole();
    }
}

#[test]
fn later_download_is_compared_with_the_first() {
    let (bytes, other) = (sequence().leak(), tgz(&[file("walk/rgb.txt", b"")]).leak());
    let (first, second): (&'static [u8], &'static [u8]) = (bytes, other);
    let server = Server::start(move |number, request, stream| match number {
        0 | 1 => serve(first, "\"v1\"", request, stream),
        _ => serve(second, "\"v2\"", request, stream),
    });
    let place = Place::new();
    let pulled = place.pull(&server, Packing::TarGz).unwrap();
    fs::remove_dir_all(&pulled.folder).unwrap();
    let again = place.pull(&server, Packing::TarGz).unwrap();
    assert_eq!(again.sha256.unwrap().1, Checksum::MatchesRecord);
    fs::remove_dir_all(&pulled.folder).unwrap();
    let e = place.pull(&server, Packing::TarGz).unwrap_err();
    assert!(matches!(e, ArchiveError::Checksum { .. }), "{e}");
    let advice = format!("remove {} and try again", pulled.record.display());
    assert!(e.to_string().contains(&advice), "{e}");
    assert_eq!(place.names(), ["walk.bin.sha256"]);
    fs::write(&pulled.record, "banana").unwrap();
    let e = place.pull(&server, Packing::TarGz).unwrap_err();
    assert!(e.to_string().contains("remove this file"), "{e}");
    fs::remove_file(&pulled.record).unwrap();
    assert!(place.pull(&server, Packing::TarGz).is_ok());
}

#[test]
fn existing_folder_is_not_changed() {
    let (place, server) = (Place::new(), Server::of(sequence().leak()));
    let folder = place.path().join("rgbd_walk");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("mine.txt"), "mine").unwrap();
    let e = place.pull(&server, Packing::TarGz).unwrap_err();
    assert!(matches!(e, ArchiveError::InTheWay { .. }), "{e}");
    assert_eq!(fs::read(folder.join("mine.txt")).unwrap(), b"mine");
    // A folder that was unpacked by hand is accepted.
    fs::write(folder.join("rgb.txt"), "").unwrap();
    let here = place.pull(&server, Packing::TarGz).unwrap();
    assert_eq!((here.sha256, here.transferred), (None, 0));
    assert!(server.requests().is_empty());
    // A path that cannot be a folder.
    let place = Place::new();
    fs::write(place.path(), "a file").unwrap();
    let e = place.pull(&server, Packing::TarGz).unwrap_err();
    assert!(e.to_string().contains("data"), "{e}");
}
