//! Databases of rosbag2.

use crate::writers::*;
use rusqlite::Connection;
use std::path::Path;
use stillpoint_imaging::FrameSource;
use stillpoint_recordings::{FrameOptions, OpenOptions, open};

pub(crate) fn write(path: &Path, messages: &[Sent]) -> Connection {
    let base = Connection::open(path).unwrap();
    base.execute_batch(
        "PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0;
         CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL);
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);",
    )
    .unwrap();
    let mut topics: Vec<&str> = Vec::new();
    for m in messages {
        if !topics.contains(&m.topic.as_str()) {
            topics.push(&m.topic);
            let sql = "INSERT INTO topics VALUES (?1, ?2, ?3, 'cdr')";
            base.execute(sql, (topics.len() as i64, &m.topic, m.type_name))
                .unwrap();
        }
        let topic = topics.iter().position(|t| *t == m.topic).unwrap() as i64 + 1;
        let sql = "INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)";
        base.execute(sql, (topic, m.time as i64, &m.cdr)).unwrap();
    }
    base
}

fn count(path: &Path) -> usize {
    let input = open(path, &OpenOptions::default()).unwrap();
    let mut frames = input.frames(&FrameOptions::default()).unwrap();
    std::iter::from_fn(|| frames.next_frame())
        .map(Result::unwrap)
        .count()
}

#[test]
fn leftover_write_ahead_log_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let live = dir.path().join("live.db3");
    let base = write(&live, &camera("/camera", 5));
    // As after a power failure: everything is in the log.
    let left = dir.path().join("left 100%?.db3");
    std::fs::copy(&live, &left).unwrap();
    std::fs::copy(
        dir.path().join("live.db3-wal"),
        dir.path().join("left 100%?.db3-wal"),
    )
    .unwrap();
    drop(base);
    assert_eq!(count(&left), 5);
    // Closing properly removes the log.
    assert!(!dir.path().join("live.db3-wal").exists());
    assert_eq!(count(&live), 5);
}

#[test]
fn split_databases_are_read_and_damage_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let messages = camera("/camera", 6);
    drop(write(&dir.path().join("a_0.db3"), &messages[..9]));
    drop(write(&dir.path().join("a_1.db3"), &messages[9..]));
    let text =
        "rosbag2_bagfile_information:\n  relative_file_paths:\n    - a_0.db3\n    - a_1.db3\n";
    std::fs::write(dir.path().join("metadata.yaml"), text).unwrap();
    assert_eq!(count(dir.path()), 6);
    let whole = std::fs::read(dir.path().join("a_0.db3")).unwrap();
    let cut = dir.path().join("cut.db3");
    for at in (1..whole.len()).step_by(whole.len() / 40) {
        std::fs::write(&cut, &whole[..at]).unwrap();
        if let Err(e) = open(&cut, &OpenOptions::default()) {
            assert!(e.to_string().contains("expected"), "{e}");
        }
    }
}
