//! Tests that need a full disk or a fake conversion.

use super::job::Job;
use super::*;
use std::io::{ErrorKind, Write};
use std::path::Path;
use stillpoint_fetch::{Disk, RealDisk};
use stillpoint_inference::{Form, sha256_hex};

#[path = "../../tests/pull_support/mod.rs"]
mod pull_support;
use pull_support::*;

/// A disk with this much free space, bytes.
struct SmallDisk(usize);

struct SmallFile {
    file: Box<dyn Write>,
    room: usize,
}

impl Disk for SmallDisk {
    fn append(&self, path: &Path) -> std::io::Result<Box<dyn Write>> {
        let (file, room) = (RealDisk.append(path)?, self.0);
        Ok(Box::new(SmallFile { file, room }))
    }

    fn create(&self, path: &Path) -> std::io::Result<Box<dyn Write>> {
        RealDisk.create(path)
    }

    fn free(&self, _folder: &Path) -> Option<u64> {
        None
    }
}

impl Write for SmallFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match bytes.len().min(self.room) {
            0 => Err(ErrorKind::StorageFull.into()),
            fits => {
                self.room -= fits;
                self.file.write_all(&bytes[..fits]).map(|()| fits)
            }
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

/// A fake conversion of bytes that begin with `PK`: prepends `onnx of `.
fn converted(checkpoint: &[u8], name: &str) -> Result<(Vec<u8>, String), String> {
    match checkpoint.strip_prefix(b"PK") {
        Some(rest) => Ok(([b"onnx of ", rest].concat(), format!("card of {name}"))),
        None => Err("no checkpoint".to_owned()),
    }
}

fn run(
    model: &KnownModel,
    scratch: &Scratch,
    server: &Server,
    disk: &dyn Disk,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Pulled, PullError> {
    Job {
        model,
        cache: &scratch.cache,
        options: &options(server),
        disk,
        convert: &converted,
    }
    .run(progress)
}

fn watch_all(_: Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

#[test]
fn full_disk_keeps_the_partial_download() {
    let bytes = made_up_bytes();
    let (server, scratch, model) = (Server::of(bytes), Scratch::with_older(), model(bytes));
    let mut here = 0;
    for room in [0, 10_000, 100_001] {
        let e = run(&model, &scratch, &server, &SmallDisk(room), &mut watch_all).unwrap_err();
        here += room;
        assert_eq!(e.part(), Some(scratch.part().as_path()));
        let PullError::Fetch(FetchError::Write { received, .. }) = &e else {
            panic!("{e}");
        };
        assert_eq!(*received, here as u64);
        for part in ["free some space", "the same command goes on from it"] {
            assert!(e.to_string().contains(part), "{e}");
        }
        assert_eq!(
            std::fs::read(scratch.part()).unwrap_or_default(),
            &bytes[..here]
        );
        let older = scratch.cache.find("made-up").unwrap().unwrap();
        assert_eq!(older.read().unwrap(), b"older");
    }
    let pulled = run(&model, &scratch, &server, &RealDisk, &mut watch_all).unwrap();
    assert_eq!(pulled.resumed, here as u64);
    assert_eq!(pulled.model.read().unwrap(), bytes);
    let starts: Vec<_> = server.requests().iter().map(Request::start).collect();
    assert_eq!(starts, [None, None, Some(10_000), Some(110_001)]);
}

#[test]
fn pulled_checkpoints_are_converted() {
    let checkpoint: &'static [u8] = b"PK weights";
    let (server, scratch) = (Server::of(checkpoint), Scratch::with_older());
    let model = KnownModel {
        form: Form::Checkpoint,
        ..unknown()
    };
    let mut seen = Vec::new();
    let pulled = run(&model, &scratch, &server, &RealDisk, &mut |progress| {
        seen.push(progress);
        ControlFlow::Continue(())
    })
    .unwrap();
    assert_eq!(seen.last(), Some(&Progress::Converting));
    assert_eq!(pulled.sha256, sha256_hex(checkpoint));
    assert_eq!(pulled.checksum, Checksum::Recorded);
    assert_eq!(pulled.model.read().unwrap(), b"onnx of  weights");
    let card = pulled.model.card_text().unwrap();
    assert_eq!(card.as_deref(), Some("card of made-up"));
    let record = pulled.model.record.clone().unwrap();
    assert_eq!(record.form(), Form::Checkpoint);
    assert_eq!(record.source_sha256, Some(sha256_hex(checkpoint)));
    assert_eq!(record.sha256, sha256_hex(b"onnx of  weights"));
    // The checkpoint itself is not kept.
    let files = [
        "made-up.onnx",
        "made-up.record.toml",
        "made-up.sha256",
        "made-up.toml",
    ];
    assert_eq!(scratch.files(), files);
    let again = get_once(&model, &scratch.cache, &server).unwrap();
    assert_eq!(
        (again.checksum, again.transferred),
        (Checksum::MatchesRecord, 0)
    );
}

#[test]
fn invalid_checkpoint_is_not_recorded() {
    for (bytes, hint) in [
        (b"something".as_slice(), "found: no checkpoint"),
        (b" <HTML>Log in</HTML>", "looks like a web page"),
        (b"", "no checkpoint"),
    ] {
        let (server, scratch) = (Server::of(bytes), Scratch::with_older());
        let model = KnownModel {
            form: Form::Checkpoint,
            ..unknown()
        };
        let e = run(&model, &scratch, &server, &RealDisk, &mut watch_all).unwrap_err();
        assert!(matches!(e, PullError::Convert { .. }), "{e}");
        assert!(e.to_string().contains(hint), "{e}");
        assert!(e.to_string().contains(&sha256_hex(bytes)), "{e}");
        scratch.assert_older(&[]);
    }
}

/// Stopped when all bytes were present: they are not transferred again, although their number was unknown.
#[test]
fn complete_part_of_unknown_size_is_reused() {
    let checkpoint: &'static [u8] = b"PK weights";
    let (server, scratch) = (Server::of(checkpoint), Scratch::with_older());
    let model = KnownModel {
        form: Form::Checkpoint,
        ..unknown()
    };
    let e = run(
        &model,
        &scratch,
        &server,
        &RealDisk,
        &mut |progress| match progress {
            Progress::Converting => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        },
    )
    .unwrap_err();
    assert!(
        matches!(
            e,
            PullError::Fetch(FetchError::Stopped { received: 10, .. })
        ),
        "{e}"
    );
    scratch.assert_older(&["made-up.part", "made-up.part.toml"]);
    let pulled = run(&model, &scratch, &server, &RealDisk, &mut watch_all).unwrap();
    assert_eq!((pulled.transferred, pulled.resumed), (0, 10));
    assert_eq!(pulled.model.read().unwrap(), b"onnx of  weights");
}

#[test]
fn blocking_folders_are_reported() {
    let bytes = made_up_bytes();
    let (server, scratch, model) = (Server::of(bytes), Scratch::with_older(), model(bytes));
    for name in ["made-up.part", "made-up.lock"] {
        let path = scratch.cache.folder().join(name);
        let _ = std::fs::remove_file(&path);
        std::fs::create_dir(&path).unwrap();
        let e = run(&model, &scratch, &server, &RealDisk, &mut watch_all).unwrap_err();
        assert!(e.to_string().contains(&path.display().to_string()), "{e}");
        std::fs::remove_dir(&path).unwrap();
        scratch.assert_older(&[]);
    }
    // The download is complete, and the model cannot be renamed.
    let scratch = Scratch::new();
    let onnx = scratch.cache.onnx_path("made-up");
    std::fs::create_dir_all(onnx.join("full")).unwrap();
    let e = run(&model, &scratch, &server, &RealDisk, &mut watch_all).unwrap_err();
    assert!(e.to_string().contains(&onnx.display().to_string()), "{e}");
    assert_eq!(std::fs::read(scratch.part()).unwrap(), bytes);
    std::fs::remove_dir_all(&onnx).unwrap();
    let asked = server.requests().len();
    let pulled = run(&model, &scratch, &server, &RealDisk, &mut watch_all).unwrap();
    assert_eq!(pulled.transferred, 0);
    assert_eq!(server.requests().len(), asked, "all of it was here");
}
