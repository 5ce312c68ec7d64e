//! Invalid map files.

use super::saved;
use crate::common::{check, shell, stillpoint};

#[test]
fn invalid_map_files_are_refused_with_a_reason() {
    let dir = tempfile::tempdir().unwrap();
    let good = std::fs::read(saved()).unwrap();
    let path = dir.path().join("odd.spmap");
    let refused = |bytes: &[u8], parts: &[&str]| {
        std::fs::write(&path, bytes).unwrap();
        let file = path.to_str().unwrap();
        let parts = [parts, &["odd.spmap: expected", "found"]].concat();
        check(&stillpoint(["map", "check", file]), 1, &parts);
        check(&stillpoint(["map", "info", file]), 2, &parts);
        let ply = dir.path().join("odd.ply");
        let export = ["map", "export", file, "--points", ply.to_str().unwrap()];
        check(&stillpoint(export), 2, &parts);
        assert!(!ply.exists());
    };
    refused(b"", &["its end is missing"]);
    refused(b"ply\nformat ascii 1.0\n", &["another kind of file"]);
    refused(&good[..good.len() / 2], &["its end is missing"]);
    refused(&good[..20], &["its end is missing"]);
    refused(&[&good[..], b"x"].concat(), &["something was added"]);
    let mut bytes = good.clone();
    bytes[good.len() / 2] ^= 1;
    refused(&bytes, &["checksum", "damaged after it was written"]);
    let mut bytes = good.clone();
    bytes[8] = 3;
    let checksum = crc32(&bytes[..24]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    refused(&bytes, &["version 3", "a later version"]);
    // The header states a size above the limit.
    let mut bytes = good;
    bytes[23] = 1;
    let checksum = crc32(&bytes[..24]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    refused(&bytes, &["at most", "as a whole"]);

    for (file, part) in [
        (dir.path().join("none.spmap"), "check that it exists"),
        (dir.path().to_owned(), "is a directory"),
    ] {
        let file = file.to_str().unwrap();
        for command in ["check", "info"] {
            check(&stillpoint(["map", command, file]), 2, &[file, part]);
        }
    }
    // An endless device is not read; a folder is not a file either.
    if cfg!(target_os = "linux") {
        for command in ["check", "info"] {
            let parts = ["/dev/zero", "a device, where a regular file is needed"];
            check(&stillpoint(["map", command, "/dev/zero"]), 2, &parts);
        }
    }
}

/// CRC-32 as in zlib and PNG, from its definition, independent of the program's code.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ 0xedb8_8320
            } else {
                crc >> 1
            };
        }
    }
    !crc
}

/// A small file whose counts ask for gigabytes, with valid checksums.
#[test]
#[cfg(target_os = "linux")]
fn huge_counts_allocate_no_memory() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("greedy.spmap");
    let good = std::fs::read(saved()).unwrap();
    // The first section is "header": kind, compression, length of the name, name, two lengths, checksum.
    assert_eq!(&good[28..37], b"\x00\x00\x06header");
    let (begin, content) = (28, 28 + 9 + 20);
    let length = u64::from_le_bytes(good[37..45].try_into().unwrap()) as usize;
    // Version and features in 8 bytes each, then counts in 4 each: cameras, slots of keyframes, keyframes, tombstones, pairs, slots of
    // landmarks, landmarks, levels.
    let places = [
        (8, 8),
        (16, 4),
        (20, 4),
        (24, 4),
        (28, 4),
        (32, 4),
        (36, 4),
        (40, 4),
        (44, 4),
    ];
    for (at, size) in places {
        for value in [u64::MAX, 1 << 31, 1 << 24] {
            let mut bytes = good.clone();
            let place = content + at..content + at + size;
            bytes[place].copy_from_slice(&value.to_le_bytes()[..size]);
            let section = [
                &bytes[begin..content - 4],
                &bytes[content..content + length],
            ]
            .concat();
            bytes[content - 4..content].copy_from_slice(&crc32(&section).to_le_bytes());
            let end = bytes.len() - 4;
            let whole = crc32(&bytes[..end]);
            bytes[end..].copy_from_slice(&whole.to_le_bytes());
            std::fs::write(&path, &bytes).unwrap();
            // A quarter of a gigabyte, including the program itself.
            let output = shell(
                "ulimit -v 262144; exec \"$0\" map check \"$1\"",
                [path.as_os_str()],
            );
            // That many keyframe ids are allowed, most of them unused.
            let code = i32::from((at, value) != (20, 1 << 24));
            check(&output, code, &[]);
        }
    }
}
