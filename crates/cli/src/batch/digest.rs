//! Digests that tell whether a result belongs to the current input, configuration and program.
//!
//! The digest of an input covers its full path and, for every file below it, name, size and modification time, plus the first and last MiB
//! of files that are not images. Two recordings never share a path; a replacement at the same path differs in size or time and in its first
//! messages. Recordings are not read whole, which would double the reading time of a large batch.

use crate::args::ConfigArgs;
use crate::args::InputArgs;
use crate::args::batch::EachArgs;
use crate::args::forward;
use crate::config;
use crate::detector::Settled;
use crate::detector::runtime::{choose, library};
use crate::failure::Failure;
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::time::UNIX_EPOCH;
use stillpoint::datasets::open_regular;

/// Bytes that are hashed at each end of a file, 1 MiB: at least one image of 640x480 px behind the header, and the index at the end.
const PART: u64 = 1 << 20;

/// Extensions of images, whose contents are not read: a data set has thousands, and lists, sizes and times identify them.
const IMAGES: [&str; 6] = ["png", "jpg", "jpeg", "pgm", "ppm", "webp"];

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct InputDigest {
    pub(crate) sha256: String,
    /// Total size of all its files.
    pub(crate) bytes: u64,
}

/// The digest of a recording.
///
/// # Errors
/// A folder or file that cannot be read.
pub(crate) fn of_input(path: &Path) -> std::io::Result<InputDigest> {
    let full = path.canonicalize()?;
    let mut hash = Sha256::new();
    let mut bytes = 0;
    field(&mut hash, full.as_os_str().as_encoded_bytes());
    add(&mut hash, &mut bytes, &full)?;
    Ok(InputDigest {
        sha256: hex(hash),
        bytes,
    })
}

/// Adds a file, or a folder with its contents in the order of names.
fn add(hash: &mut Sha256, bytes: &mut u64, path: &Path) -> std::io::Result<()> {
    let metadata = std::fs::metadata(path)?;
    let name = path.file_name().unwrap_or_default();
    field(hash, name.as_encoded_bytes());
    if metadata.is_dir() {
        let entries: std::io::Result<Vec<_>> = std::fs::read_dir(path)?.collect();
        let mut paths: Vec<_> = entries?.into_iter().map(|e| e.path()).collect();
        paths.sort();
        field(hash, &paths.len().to_le_bytes());
        for path in &paths {
            // Dangling links are ignored.
            match add(hash, bytes, path) {
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
                other => other?,
            }
        }
        return Ok(());
    }
    let changed = metadata.modified()?.duration_since(UNIX_EPOCH);
    let changed = changed.map_or(0, |t| t.as_nanos());
    field(hash, &metadata.len().to_le_bytes());
    field(hash, &changed.to_le_bytes());
    *bytes += metadata.len();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    if metadata.is_file() && !extension.is_some_and(|e| IMAGES.contains(&e.as_str())) {
        ends(hash, &mut File::open(path)?, metadata.len())?;
    }
    Ok(())
}

/// Adds the beginning and the end of a file, which overlap in a small one.
fn ends(hash: &mut Sha256, file: &mut File, length: u64) -> std::io::Result<()> {
    let mut part = Vec::new();
    file.by_ref().take(PART).read_to_end(&mut part)?;
    field(hash, &part);
    if length > PART {
        part.clear();
        file.seek(SeekFrom::Start(length.saturating_sub(PART).max(PART)))?;
        file.by_ref().take(PART).read_to_end(&mut part)?;
        field(hash, &part);
    }
    Ok(())
}

/// Digest of everything that all runs share: the resolved configuration, the options, and the files that they name.
///
/// # Errors
/// An invalid configuration, an unreadable file, a missing runtime.
pub(crate) fn of_configuration(
    config: &ConfigArgs,
    input: &InputArgs,
    each: &EachArgs,
    settled: &Settled,
) -> Result<String, Failure> {
    let mut hash = Sha256::new();
    field(
        &mut hash,
        config::to_text(&config::resolve(config)?)?.as_bytes(),
    );
    let here = Path::new("");
    for word in [
        forward::typed(input, &ConfigArgs::default(), here),
        each.typed(here),
    ]
    .concat()
    {
        field(&mut hash, word.as_encoded_bytes());
    }
    field(&mut hash, &settled.content()?);
    // Runtimes differ in the last bits of their results.
    if settled.needs_colour()
        && let Some(library) = library(&choose(input.detector.runtime)?.runtime)
    {
        field(&mut hash, library.as_bytes());
    }
    if let Some(camera) = &input.camera
        && Path::new(camera).is_file()
    {
        let bytes = std::fs::read(camera).map_err(|e| {
            Failure::input(format!(
                "--camera {camera}: expected to read it, found: {e}"
            ))
        })?;
        field(&mut hash, &bytes);
    }
    Ok(hex(hash))
}

/// The digest of this program.
///
/// # Errors
/// A program whose file cannot be read.
pub(crate) fn of_program() -> Result<String, Failure> {
    let wrong = |e: std::io::Error| {
        Failure::input(format!("expected to read this program's file, found: {e}"))
    };
    let mut file = open_regular(&crate::program_file().map_err(wrong)?).map_err(wrong)?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(wrong)? {
            0 => return Ok(hex(hash)),
            n => hash.update(&buffer[..n]),
        }
    }
}

/// Adds bytes preceded by their length, so that different sequences of fields never give the same bytes.
fn field(hash: &mut Sha256, bytes: &[u8]) {
    hash.update((bytes.len() as u64).to_le_bytes());
    hash.update(bytes);
}

fn hex(hash: Sha256) -> String {
    hash.finalize().iter().fold(String::new(), |mut text, b| {
        let _ = write!(text, "{b:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector;
    use std::time::{Duration, SystemTime};

    fn digest(path: &Path) -> String {
        of_input(path).unwrap().sha256
    }

    #[test]
    fn changed_recording_has_another_digest() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("walk.mcap");
        let then = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000);
        let write = |bytes: &[u8], time: SystemTime| {
            std::fs::write(&file, bytes).unwrap();
            File::options()
                .write(true)
                .open(&file)
                .unwrap()
                .set_modified(time)
                .unwrap();
        };
        let mut bytes = vec![7_u8; 3 << 20];
        write(&bytes, then);
        let first = of_input(&file).unwrap();
        assert_eq!(first.bytes, 3 << 20);
        assert_eq!(of_input(&file).unwrap(), first);
        // Same size and time; the first and last messages differ.
        for at in [0, PART as usize - 1, 2 << 20, (3 << 20) - 1] {
            bytes[at] = 8;
            write(&bytes, then);
            assert_ne!(digest(&file), first.sha256, "byte {at}");
            bytes[at] = 7;
        }
        // The same bytes with another time, at another path, and with bytes appended.
        write(&bytes, then + Duration::from_nanos(1_000_000));
        assert_ne!(digest(&file), first.sha256);
        write(&bytes, then);
        assert_eq!(digest(&file), first.sha256);
        let other = dir.path().join("other");
        std::fs::create_dir(&other).unwrap();
        std::fs::copy(&file, other.join("walk.mcap")).unwrap();
        let copy = File::options()
            .write(true)
            .open(other.join("walk.mcap"))
            .unwrap();
        copy.set_modified(then).unwrap();
        assert_ne!(digest(&other.join("walk.mcap")), first.sha256);
        bytes.push(7);
        write(&bytes, then);
        assert_ne!(digest(&file), first.sha256);
    }

    #[test]
    fn folder_digest_covers_all_files() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("desk");
        std::fs::create_dir_all(folder.join("rgb")).unwrap();
        std::fs::write(folder.join("rgb/1.png"), "picture").unwrap();
        std::fs::write(folder.join("rgb.txt"), "1 rgb/1.png").unwrap();
        let first = digest(&folder);
        assert_eq!(digest(&folder), first);
        std::fs::write(folder.join("rgb/2.png"), "").unwrap();
        let second = digest(&folder);
        assert_ne!(second, first);
        std::fs::rename(folder.join("rgb/2.png"), folder.join("rgb/3.png")).unwrap();
        assert_ne!(digest(&folder), second);
        assert!(of_input(&dir.path().join("none")).is_err());
    }

    #[test]
    fn configuration_digest_covers_options_and_their_files() {
        let dir = tempfile::tempdir().unwrap();
        let script = dir.path().join("boxes.csv");
        std::fs::write(&script, "1,person,0.9,0,0,1,1\n").unwrap();
        let input = InputArgs {
            max_frames: Some(5),
            ..InputArgs::default()
        }
        .with_detector(format!("scripted:{}", script.display()));
        let of = |config: &ConfigArgs, input: &InputArgs, each: &EachArgs| {
            let settled = detector::settle(&input.detector).unwrap();
            of_configuration(config, input, each, &settled).unwrap()
        };
        let (config, each) = (ConfigArgs::default(), EachArgs::default());
        let first = of(&config, &input, &each);
        assert_eq!(of(&config, &input, &each), first);
        let seeded = ConfigArgs {
            seed: Some(3),
            ..ConfigArgs::default()
        };
        assert_ne!(of(&seeded, &input, &each), first);
        let dense = EachArgs {
            dense: true,
            ..EachArgs::default()
        };
        assert_ne!(of(&config, &input, &dense), first);
        let longer = InputArgs {
            max_frames: Some(6),
            ..input.clone()
        };
        assert_ne!(of(&config, &longer, &each), first);
        std::fs::write(&script, "2,person,0.9,0,0,1,1\n").unwrap();
        assert_ne!(of(&config, &input, &each), first);
        // A detector script named by the recording is part of the recording.
        let own = input.with_detector("scripted:{}/boxes.csv".to_owned());
        assert_ne!(of(&config, &own, &each), first);
    }
}
