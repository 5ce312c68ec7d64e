//! Foreign, damaged or inconsistent archives: an error each, with its offset in the file.

use super::small::{Small, TensorSpec};
use super::support::{Entry, Lies, entries, error_of, fixture, message_of, zip};
use stillpoint_models::import::{ImportError, import_checkpoint};

#[test]
fn foreign_files_are_recognised() {
    for (bytes, found) in [
        (
            b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.\x80\x02".as_slice(),
            "before 1.6",
        ),
        (b"\x80\x04N.", "a bare pickle"),
        (b"\n<!DOCTYPE html><html>", "a web page"),
        (b"", "an empty file"),
        (b"\x08\x08\x12\x07pytorch", "another format"),
    ] {
        let message = import_checkpoint(bytes, "x").unwrap_err().to_string();
        assert!(message.contains(found), "{message}");
    }
    for (name, found) in [
        ("archive/constants.pkl", "a TorchScript program"),
        ("archive/code/m.py", "a TorchScript program"),
        ("b/data.pkl", "several"),
    ] {
        let entries = [
            Entry::new("archive/data.pkl", *b"\x80\x02N."),
            Entry::new(name, *b"x"),
        ];
        let message = import_checkpoint(&zip(&entries, Lies::default()), "x")
            .unwrap_err()
            .to_string();
        assert!(message.contains(found), "{message}");
    }
    let entries = [Entry::new("readme.txt", *b"x")];
    let message = import_checkpoint(&zip(&entries, Lies::default()), "x")
        .unwrap_err()
        .to_string();
    assert!(message.contains("a zip archive without one"), "{message}");
}

#[test]
fn truncated_files_are_refused() {
    let bytes = fixture("idetect.pt");
    for i in 0..200 {
        let error = error_of(&bytes[..bytes.len() * i / 200]);
        let expected = matches!(
            error,
            ImportError::Archive { .. } | ImportError::NoCheckpoint { .. }
        );
        assert!(expected, "{error}");
    }
    for missing in 1..100 {
        error_of(&bytes[..bytes.len() - missing]);
    }
}

#[test]
fn inconsistent_archives_are_refused() {
    let pickle = || Entry::new("archive/data.pkl", *b"\x80\x02N.");
    let both = [pickle(), Entry::new("archive/version", *b"3")];
    let lies = Lies::default();
    for (bytes, expected) in [
        (
            zip(
                &both,
                Lies {
                    compressed: true,
                    ..lies
                },
            ),
            "a compressed `archive/data.pkl`",
        ),
        (
            zip(&both, Lies { larger: 1, ..lies }),
            "the size that the directory says",
        ),
        (
            zip(
                &both,
                Lies {
                    larger: 1 << 30,
                    ..lies
                },
            ),
            "sizes and places within the file",
        ),
        (
            zip(
                &both,
                Lies {
                    overlapping: true,
                    ..lies
                },
            ),
            "another name or method",
        ),
        (
            zip(
                &[pickle(), pickle()],
                Lies {
                    overlapping: true,
                    ..lies
                },
            ),
            "a second `archive/data.pkl`",
        ),
        (
            zip(&[pickle(), pickle()], lies),
            "a second `archive/data.pkl`",
        ),
        (
            zip(
                &both,
                Lies {
                    huge: Some(u64::MAX),
                    ..lies
                },
            ),
            "sizes and places within the file",
        ),
        (
            zip(
                &both,
                Lies {
                    huge: Some(1 << 40),
                    ..lies
                },
            ),
            "sizes and places within the file",
        ),
        (
            zip(&both, Lies { more: 1, ..lies }),
            "an entry of the directory",
        ),
        (
            zip(
                &both,
                Lies {
                    more: 60_000,
                    ..lies
                },
            ),
            "an entry of the directory",
        ),
    ] {
        let message = message_of(&bytes);
        assert!(message.contains(expected), "{message}");
    }
    let mut broken = zip(&both, lies);
    broken[30 + 16 + 1] ^= 1;
    assert!(message_of(&broken).contains("content that matches its checksum"));
}

#[test]
fn overlapping_entries_are_refused() {
    // The content of the first entry is a complete second entry, which the directory lists as well.
    let inner = zip(
        &[Entry::new("archive/data/0", vec![7; 32])],
        Lies::default(),
    );
    let header = 30 + 14;
    let outer = zip(
        &[Entry::new("archive/data.pkl", &inner[..header + 32])],
        Lies::default(),
    );
    let place = 30 + 16;
    let mut listed = inner[header + 32..inner.len() - 22].to_vec();
    listed[42..46].copy_from_slice(&(place as u32).to_le_bytes());
    let end = outer.len() - 22;
    let mut bytes = [&outer[..end], &listed, &outer[end..]].concat();
    let end = end + listed.len();
    bytes[end + 8] = 2;
    bytes[end + 10] = 2;
    let size =
        u32::from_le_bytes(bytes[end + 12..end + 16].try_into().unwrap()) + listed.len() as u32;
    bytes[end + 12..end + 16].copy_from_slice(&size.to_le_bytes());
    let message = message_of(&bytes);
    assert!(message.contains("entries apart"), "{message}");
}

#[test]
fn entry_names_never_become_paths() {
    let names = [
        "../../etc/passwd",
        "/etc/passwd",
        "archive/data/../../x",
        "C:\\x",
        "archive/data/\0",
    ];
    let mut all = entries(&fixture("idetect.pt"));
    all.extend(names.map(|n| Entry::new(n, *b"x")));
    import_checkpoint(&zip(&all, Lies::default()), "x").unwrap();
    let key = Box::leak("../../../../etc/passwd".to_owned().into_boxed_str());
    let weight = TensorSpec {
        key,
        ..TensorSpec::new("w", &[6, 3, 1, 1])
    };
    let message = message_of(
        &Small {
            weight,
            ..Small::default()
        }
        .bytes(),
    );
    assert!(
        message.contains("no `archive/data/../../../../etc/passwd`"),
        "{message}"
    );
}
