//! Archives with forbidden contents: refused, without remains inside or outside.

use crate::packed::*;
use std::io::Write;
use stillpoint_fetch::archive::ArchiveError;
use stillpoint_fetch::archive::Packing::{TarGz, Zip};
use stillpoint_testdata::server::Server;
use tar::EntryType;

#[test]
fn paths_outside_the_folder_are_refused() {
    for name in [
        "../outside.txt",
        "walk/../../outside.txt",
        "/tmp/outside.txt",
        "walk\\..\\..\\outside.txt",
        "C:/outside.txt",
    ] {
        let list = file("walk/rgb.txt", b"");
        let said = refused(tgz(&[list.clone(), file(name, b"out")]), TarGz);
        assert!(said.contains("a path that"), "{said}");
        let folder = entry(name, EntryType::Directory, b"");
        refused(tgz(&[list, folder]), TarGz);
        let said = refused(zipped(&[("walk/rgb.txt", b""), (name, b"out")]), Zip);
        assert!(said.contains("a path that"), "{said}");
    }
}

#[test]
fn links_and_devices_are_refused() {
    for kind in [
        EntryType::Symlink,
        EntryType::Link,
        EntryType::Char,
        EntryType::Fifo,
    ] {
        let said = refused(
            tgz(&[file("walk/rgb.txt", b""), entry("walk/rgb", kind, b"")]),
            TarGz,
        );
        assert!(
            said.contains("a link or device (walk/rgb)"),
            "{kind:?}: {said}"
        );
    }
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(zipped(&[])));
    let options = zip::write::SimpleFileOptions::default();
    zip.start_file("walk/rgb.txt", options).unwrap();
    zip.add_symlink("walk/rgb", "../../", options).unwrap();
    let said = refused(zip.finish().unwrap().into_inner(), Zip);
    assert!(said.contains("a link or device (walk/rgb)"), "{said}");
}

/// A header that claims 2 GB costs nothing; as the length of a file name it would be allocated.
#[test]
fn decompression_bombs_are_refused() {
    let mut large = file("walk/rgb.txt", b"");
    let mut header = tar::Header::from_byte_slice(&large[..512]).clone();
    header.set_size(2 << 30);
    header.set_cksum();
    large[..512].copy_from_slice(header.as_bytes());
    let said = refused(tgz(&[large]), TarGz);
    assert!(said.contains("more than 10 times its size"), "{said}");

    let name = entry(
        "././@LongLink",
        EntryType::GNULongName,
        &vec![b'a'; 2 << 20],
    );
    let said = refused(tgz(&[name, file("x", b"")]), TarGz);
    assert!(said.contains("too much between two files"), "{said}");
    let blanks = [file("walk/rgb.txt", b""), vec![0; 2 << 20]].concat();
    let said = refused(gzip(&blanks), TarGz);
    assert!(said.contains("too much between two files"), "{said}");

    let mut zip = zipped(&[("walk/rgb.txt", &[0; 3000])]);
    // The size in the directory at the end.
    let at = zip.windows(4).rposition(|w| w == b"PK\x01\x02").unwrap() + 24;
    for (size, part) in [
        (2_u32 << 30, "more than 10 times its size"),
        (10, "larger than its declared"),
        (4000, "not as long as it says"),
    ] {
        zip[at..at + 4].copy_from_slice(&size.to_le_bytes());
        let said = refused(zip.clone(), Zip);
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn damaged_archives_are_refused() {
    let whole = sequence();
    let mut wrong = whole.clone();
    wrong[100_000] ^= 1;
    // The checksum of gzip is in its last eight bytes.
    let mut sum = whole.clone();
    let last = sum.len() - 8;
    sum[last] ^= 1;
    for bytes in [
        whole[..150_000].to_vec(),
        wrong,
        sum,
        b"no archive".to_vec(),
    ] {
        let said = refused(bytes, TarGz);
        assert!(said.contains("was removed: try again"), "{said}");
    }
    let page = refused(b"<html>Please log in</html>".to_vec(), TarGz);
    assert!(page.contains("looks like a web page"), "{page}");
    let mut zip = zipped(&[("walk/rgb.txt", b"1.0 a"), ("walk/rgb/1.png", image())]);
    refused(zip[..100_000].to_vec(), Zip);
    zip[100_000] ^= 1;
    refused(zip, Zip);
    refused(b"no archive".to_vec(), Zip);
}

#[test]
fn archives_without_a_sequence_are_refused() {
    let said = refused(tgz(&[file("walk/depth.txt", b"")]), TarGz);
    assert!(said.contains("no file rgb.txt"), "{said}");
    let said = refused(zipped(&[("deep/walk/rgb.txt", b"")]), Zip);
    assert!(said.contains("no file rgb.txt"), "{said}");
    for twice in [
        [file("walk/rgb.txt", b"a"), file("walk/./rgb.txt", b"b")],
        [file("walk", b"a"), file("walk/rgb.txt", b"b")],
    ] {
        let said = refused(tgz(&twice), TarGz);
        assert!(said.contains("a path twice"), "{said}");
    }
    let said = refused(tgz(&[file(".", b"a")]), TarGz);
    assert!(said.contains("without a name"), "{said}");
    let mut other = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    other.start_file("walk/rgb.txt", options).unwrap();
    other.write_all(b"1.0 a").unwrap();
    let mut other = other.finish().unwrap().into_inner();
    // An unused method, in both headers.
    for magic in [b"PK\x03\x04", b"PK\x01\x02"] {
        let at = other.windows(4).position(|w| w == magic).unwrap();
        let method = at + if magic[2] == 3 { 8 } else { 10 };
        other[method] = 97;
    }
    refused(other, Zip);
}

/// With one byte changed, packed or not, the result is a folder or an error.
#[test]
fn changed_archives_give_a_folder_or_an_error() {
    let tar = [
        entry("walk/", EntryType::Directory, b""),
        file("walk/rgb.txt", b"1.0 rgb/1.png"),
        file("walk/rgb/1.png", b"picture"),
        vec![0; 1024],
    ]
    .concat();
    let files: [(&str, &[u8]); 2] = [("walk/rgb.txt", b"1.0 a"), ("walk/rgb/1.png", b"picture")];
    let (tgz, zip) = (gzip(&tar), zipped(&files));
    let mut state = 1_u32;
    let mut random = |below: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as usize % below
    };
    let mut refused = 0;
    for round in 0..150 {
        let mut bytes = [&tar, &tgz, &zip][round % 3].clone();
        let at = random(bytes.len());
        bytes[at] ^= 1 << random(8);
        let (bytes, packing) = match round % 3 {
            0 => (gzip(&bytes), TarGz),
            1 => (bytes, TarGz),
            _ => (bytes, Zip),
        };
        let (place, server) = (Place::new(), Server::of(bytes.leak()));
        match place.pull(&server, packing) {
            Ok(_) => assert_eq!(place.names(), ["rgbd_walk", "walk.bin.sha256"], "{round}"),
            Err(e) => {
                assert!(matches!(e, ArchiveError::Unusable { .. }), "{round}: {e}");
                assert_eq!(place.names(), [""; 0], "{round}");
                refused += 1;
            }
        }
    }
    assert!((30..150).contains(&refused), "{refused}");
}
