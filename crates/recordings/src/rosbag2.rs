//! Folders of rosbag2: their files and compression.

use crate::budget::{Remarks, Unpacking};
use crate::error::{RecordingError, Result};
use crate::store::blocks::wrong_checksum;
use crate::store::temporary::Temporary;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// File that describes a folder.
const METADATA: &str = "metadata.yaml";
const LARGEST: u64 = 1 << 24;
/// Maximum number of files: the range of their index.
const MOST_FILES: usize = u16::MAX as usize;
/// Decompressed bytes between checks of the limit.
const STEP: u64 = 1 << 24;
/// Share of the free disk space that decompression leaves free, as a divisor.
#[cfg(unix)]
const KEPT_FREE: u64 = 20;
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

#[derive(Debug, Default, PartialEq)]
pub(crate) struct Plan {
    pub(crate) files: Vec<PathBuf>,
    pub(crate) compressed_messages: bool,
    pub(crate) remarks: Remarks,
}

pub(crate) fn is_folder(path: &Path) -> bool {
    path.is_dir()
        && (path.join(METADATA).is_file()
            || (!path.join("rgb.txt").is_file() && !listed(path).is_empty()))
}

/// The files of a path: itself, or those of its folder, as described, else by name.
pub(crate) fn plan(path: &Path) -> Result<Plan> {
    if !path.is_dir() {
        // A file of a folder is compressed as its description says.
        let beside = path
            .parent()
            .map(|p| p.join(METADATA))
            .filter(|p| p.is_file());
        let described =
            beside.and_then(|p| stillpoint_datasets::read_regular_text(&p, LARGEST).ok());
        return Ok(Plan {
            files: vec![path.to_owned()],
            compressed_messages: described.is_some_and(|text| parse(&text).1),
            remarks: Remarks::default(),
        });
    }
    let metadata = path.join(METADATA);
    let mut plan = Plan::default();
    if metadata.is_file() {
        let text = stillpoint_datasets::read_regular_text(&metadata, LARGEST);
        let text = text.map_err(RecordingError::read(&metadata))?;
        let (names, compressed) = parse(&text);
        plan.compressed_messages = compressed;
        // Only file names, so that a description cannot refer to files outside of the folder; each once and up to the limit, so that
        // repeated entries are not read repeatedly.
        let mut seen = BTreeSet::new();
        let names = names.iter().filter_map(|n| Path::new(n).file_name());
        let names = names.filter(|n| seen.len() < MOST_FILES && seen.insert(n.to_owned()));
        let (there, gone): (Vec<PathBuf>, Vec<PathBuf>) =
            names.map(|n| path.join(n)).partition(|p| p.is_file());
        plan.files = there;
        for path in gone {
            plan.remarks
                .add(|| format!("{} is missing and left out", path.display()));
        }
    }
    if plan.files.is_empty() {
        plan.files = listed(path);
    }
    if plan.files.is_empty() {
        let found = "none of the files that metadata.yaml lists";
        return Err(RecordingError::format(
            path,
            "a folder of rosbag2",
            found,
            "copy the whole folder",
        ));
    }
    Ok(plan)
}

fn listed(path: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten();
    let wanted = |p: &PathBuf| {
        let name = p.to_string_lossy().into_owned();
        [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"]
            .iter()
            .any(|e| name.ends_with(e))
    };
    let mut files: Vec<PathBuf> = entries.map(|e| e.path()).filter(wanted).collect();
    files.sort();
    files
}

/// File names, and whether messages are compressed individually. A minimal parser for the YAML that rosbag2 writes.
fn parse(text: &str) -> (Vec<String>, bool) {
    let mut names = Vec::new();
    let mut within = false;
    let mut compressed = false;
    for line in text.lines() {
        let line = line.trim();
        let unquoted = |t: &str| t.trim().trim_matches(['"', '\'']).to_owned();
        if let Some(name) = line.strip_prefix("- ").filter(|_| within) {
            names.push(unquoted(name));
            continue;
        }
        within = line == "relative_file_paths:";
        if let Some(mode) = line.strip_prefix("compression_mode:") {
            compressed = unquoted(mode).eq_ignore_ascii_case("message");
        }
    }
    (names, compressed)
}

/// Decompresses a file that is compressed as a whole; `None` for any other.
pub(crate) fn unpack(path: &Path) -> Result<Option<Temporary>> {
    use std::io::Read;
    let file = stillpoint_datasets::open_regular(path).map_err(RecordingError::read(path))?;
    let mut file = std::io::BufReader::new(file);
    let mut head = Vec::new();
    file.by_ref()
        .take(4)
        .read_to_end(&mut head)
        .map_err(RecordingError::read(path))?;
    if head != ZSTD {
        return Ok(None);
    }
    let packed = file.get_ref().metadata().map_or(0, |m| m.len());
    let whole = std::io::Cursor::new(head).chain(file);
    let mut decoder =
        ruzstd::decoding::StreamingDecoder::new(whole).map_err(|e| broken(path, e.to_string()))?;
    let (temporary, mut to) = Temporary::create(path, ".unpacked")?;
    let allowed = Unpacking::of_file().allowed(packed);
    let mut done = 0;
    loop {
        let left = room(&temporary.path).min(allowed.saturating_sub(done));
        if left < STEP {
            return Err(too_large(path, done, allowed));
        }
        // On an error the part already written is scanned as a truncated file.
        match std::io::copy(&mut decoder.by_ref().take(STEP), &mut to) {
            Err(e) if e.kind() == std::io::ErrorKind::StorageFull => {
                return Err(broken(path, e.to_string()));
            }
            Err(_) | Ok(0) => break,
            Ok(n) => done += n,
        }
    }
    match wrong_checksum(&decoder.decoder) {
        Some(found) => Err(broken(path, found)),
        None => Ok(Some(temporary)),
    }
}

fn broken(path: &Path, found: String) -> RecordingError {
    RecordingError::format(
        path,
        "a file that Zstandard compressed",
        found,
        "copy it again",
    )
}

fn too_large(path: &Path, done: u64, allowed: u64) -> RecordingError {
    let (expected, advice) = if done + STEP > allowed {
        (
            format!("a recording that unpacks to at most {} MB", allowed >> 20),
            "unpack it with `zstd -d` if what it holds is real",
        )
    } else {
        (
            "free space to unpack it".to_owned(),
            "free some space, or name another folder with TMPDIR",
        )
    };
    let found = format!("more than {} MB", done >> 20);
    RecordingError::format(path, &expected, found, advice)
}

/// Number of bytes that may be written to a file's file system.
#[cfg(unix)]
fn room(path: &Path) -> u64 {
    rustix::fs::statvfs(path).map_or(u64::MAX, |fs| {
        let all = fs.f_bavail.saturating_mul(fs.f_frsize);
        all - all / KEPT_FREE
    })
}

#[cfg(not(unix))]
fn room(_: &Path) -> u64 {
    u64::MAX
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bag_metadata_is_parsed() {
        let text = "rosbag2_bagfile_information:\n  compression_mode: MESSAGE\n  files:\n  - path: no.db3\n  relative_file_paths:\n    - a_0.db3\n    - \"a_1.db3\"\n  ros_distro: jazzy\n  - x\n";
        let expected = (vec!["a_0.db3".to_owned(), "a_1.db3".to_owned()], true);
        assert_eq!(parse(text), expected);
    }

    #[test]
    fn bag_metadata_cannot_reference_outside_files() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.mcap"), "").unwrap();
        let text = "relative_file_paths:\n- ../../etc/a.mcap\n- gone.mcap\n- a.mcap\n";
        std::fs::write(dir.path().join(METADATA), text).unwrap();
        let plan = plan(dir.path()).unwrap();
        assert_eq!(plan.files, [dir.path().join("a.mcap")]);
        let said = plan.remarks.lines();
        assert!(said[0].contains("gone.mcap is missing"), "{plan:?}");
    }
}
