//! Depth images compressed by another implementation.

// The file is given by the user.
#![allow(clippy::disallowed_methods)]

use stillpoint_imaging::rvl;

/// Images made by `tools/recordings/rvl_frames.py`, and those of the file in `STILLPOINT_RVL`.
#[test]
fn images_encoded_by_another_implementation_are_decoded() {
    let mut files = vec![include_bytes!("golden/rvl.bin").to_vec()];
    files.extend(std::env::var_os("STILLPOINT_RVL").map(|p| std::fs::read(p).unwrap()));
    let mut out = Vec::new();
    for file in files {
        let mut rest = &*file;
        let mut images = 0;
        while !rest.is_empty() {
            let head = [0, 4, 8]
                .map(|at| u32::from_le_bytes(rest[at..at + 4].try_into().unwrap()) as usize);
            let (packed, values) = rest[12..].split_at(head[2]);
            let count = head[0] * head[1];
            let expected = values[..2 * count].chunks_exact(2);
            let expected: Vec<u16> = expected.map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
            assert_eq!(rvl::decode(packed, count, &mut out), Some(()));
            assert_eq!(out, expected, "image {images}");
            rest = &values[2 * count..];
            images += 1;
        }
        assert!(images >= 8, "{images}");
    }
}
