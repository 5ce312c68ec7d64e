//! Small files that request large resources: each ends early, and reports the omitted parts.

use crate::damage::chunk;
use crate::files::put;
use crate::writers::*;
use std::path::Path;
use stillpoint_recordings::{Info, OpenOptions, info, open};
use stillpoint_ros_messages::*;

fn packed(records: &[u8]) -> Vec<u8> {
    let mut file = b"\x89MCAP0\r\n".to_vec();
    record(&mut file, 6, &chunk("lz4", records, 0));
    file
}

fn schema(to: &mut Vec<u8>, id: u16, name: &str) {
    let mut body = id.to_le_bytes().to_vec();
    text(&mut body, name);
    text(&mut body, "ros2msg");
    text(&mut body, "");
    record(to, 3, &body);
}

fn channel(to: &mut Vec<u8>, id: u16, schema: u16, topic: &str) {
    let mut body = id.to_le_bytes().to_vec();
    body.extend(schema.to_le_bytes());
    text(&mut body, topic);
    text(&mut body, "cdr");
    body.extend(0_u32.to_le_bytes());
    record(to, 4, &body);
}

fn message(to: &mut Vec<u8>, channel: u16, data: &[u8]) {
    let mut body = channel.to_le_bytes().to_vec();
    body.extend([0; 20]);
    body.extend(data);
    record(to, 5, &body);
}

fn of(folder: &Path, name: &str, bytes: &[u8]) -> Info {
    info(&put(folder, name, bytes)).unwrap()
}

#[test]
fn number_of_topics_is_bounded_and_ids_are_unique() {
    let dir = tempfile::tempdir().unwrap();
    let mut records = Vec::new();
    schema(&mut records, 1, "std_msgs/msg/String");
    for i in 0..5000 {
        channel(&mut records, i, 1, &format!("/t{i}"));
    }
    let found = of(dir.path(), "many.mcap", &packed(&records));
    assert_eq!(found.topics.len(), 4096);
    let said = found.remarks.join("\n");
    assert!(said.contains("904 topics are left out"), "{said}");

    let mut records = Vec::new();
    schema(&mut records, 1, "std_msgs/msg/String");
    for i in 0..5000 {
        channel(&mut records, 7, 1, &format!("/t{i}"));
    }
    message(&mut records, 7, &[0; 20]);
    let found = of(dir.path(), "again.mcap", &packed(&records));
    assert_eq!((found.topics.len(), found.topics[0].messages), (1, 1));
    assert_eq!(found.topics[0].name, "/t0");
    let said = found.remarks.join("\n");
    assert!(
        said.contains("contradicts an earlier one") && said.contains("more remarks"),
        "{said}"
    );

    let header = |topic: &str| {
        let connection = [
            ("op", vec![7]),
            ("conn", 1_u32.to_le_bytes().to_vec()),
            ("topic", topic.as_bytes().to_vec()),
        ];
        let inner = fields(&[("type", b"std_msgs/String".to_vec())]);
        (connection, inner)
    };
    let mut file = b"#ROSBAG V2.0\n".to_vec();
    for i in 0..5000 {
        let (connection, inner) = header(&format!("/t{i}"));
        bag_record(&mut file, &connection, &inner);
    }
    let found = of(dir.path(), "again.bag", &file);
    assert_eq!(found.topics.len(), 1);
    assert!(
        found
            .remarks
            .join("\n")
            .contains("contradicts an earlier one")
    );
}

#[test]
fn topic_names_are_bounded_and_escaped() {
    let dir = tempfile::tempdir().unwrap();
    let mut records = Vec::new();
    schema(&mut records, 1, "std_msgs/msg/String");
    schema(&mut records, 2, "sensor_msgs/msg/Image");
    channel(&mut records, 1, 1, &"/x".repeat(10_000));
    channel(&mut records, 2, 2, "/a\nerror: forged\x1b[2J\u{202e}");
    let image = Image {
        encoding: "rgb8\nwarning: forged".into(),
        ..Image::default()
    };
    message(&mut records, 2, &to_bytes(&image, Format::CdrLittleEndian));
    let found = of(dir.path(), "names.mcap", &packed(&records));
    assert_eq!(found.topics.len(), 1, "{:?}", found.topics);
    let name = &found.topics[0].name;
    assert_eq!(name, "/a\\nerror: forged\\u{1b}[2J\\u{202e}");
    let refused = open(&dir.path().join("names.mcap"), &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("forged") && refused.lines().count() == 1,
        "{refused}"
    );
}

#[test]
fn flood_of_remarks_is_only_counted() {
    let dir = tempfile::tempdir().unwrap();
    let mut records = Vec::new();
    for _ in 0..20_000 {
        record(&mut records, 3, &[]);
    }
    let found = of(dir.path(), "flood.mcap", &packed(&records));
    assert!(found.remarks.len() < 100, "{}", found.remarks.len());
    let last = found.remarks.last().unwrap();
    assert!(last.contains("19950 more remarks"), "{last}");
}

#[test]
fn number_of_image_topics_is_bounded() {
    let dir = tempfile::tempdir().unwrap();
    let mut records = Vec::new();
    schema(&mut records, 1, "sensor_msgs/msg/Image");
    for i in 0..400 {
        let shows = ["image", "depth"][usize::from(i % 2)];
        channel(&mut records, i, 1, &format!("/c/{i}/{shows}"));
        let image = Image {
            width: 1,
            height: 1,
            step: 3,
            encoding: if i % 2 == 0 { "rgb8" } else { "16UC1" }.into(),
            data: vec![0; 3].into(),
            ..Image::default()
        };
        message(&mut records, i, &to_bytes(&image, Format::CdrLittleEndian));
    }
    let path = put(dir.path(), "images.mcap", &packed(&records));
    let refused = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("4096: ") && refused.len() < 2000,
        "{refused}"
    );
    let said = info(&path).unwrap().remarks.join("\n");
    assert!(said.contains("272 topics are left out"), "{said}");
}

#[test]
fn number_of_transforms_is_bounded() {
    let dir = tempfile::tempdir().unwrap();
    let message = |n: usize| {
        let one = |i: usize| {
            let mut t = TransformStamped::default();
            t.header.frame_id = "base".into();
            t.child_frame_id = format!("f{i}").into();
            t.transform.rotation.w = 1.0;
            t
        };
        let transforms = (0..n).map(one).collect();
        sent("/tf_static", 1, &TfMessage { transforms })
    };
    let with = |n: usize| {
        let mut all = camera("/camera", 3);
        all.push(message(n));
        let path = put(dir.path(), "tf.mcap", &mcap(&all, None));
        let input = open(&path, &OpenOptions::default()).unwrap();
        input.warnings().join("\n")
    };
    assert_eq!(with(1500), "");
    let said = with(5000);
    assert!(said.contains("3000 transforms are left out"), "{said}");
    let said = with(20_000);
    assert!(said.contains("bytes on /tf_static is left out"), "{said}");
}

/// A Zstandard frame that unpacks to this many blocks of 128 kB of one byte.
fn blocks_of_zeros(before: &[u8], blocks: usize) -> Vec<u8> {
    // No size, no checksum, a window of 128 kB.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x38];
    let head = |last: bool, kind: u32, size: usize| {
        let word = u32::from(last) | kind << 1 | (size as u32) << 3;
        word.to_le_bytes()[..3].to_vec()
    };
    if !before.is_empty() {
        frame.extend(head(false, 0, before.len()));
        frame.extend(before);
    }
    for i in 0..blocks {
        frame.extend(head(i + 1 == blocks, 1, 1 << 17));
        frame.push(0);
    }
    frame
}

#[test]
fn decompression_bomb_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let frame = blocks_of_zeros(b"\x89MCAP0\r\n", 1 << 17);
    let path = put(dir.path(), "input.mcap.zstd", &frame);
    let refused = info(&path).unwrap_err().to_string();
    assert!(
        refused.contains("expected a recording that unpacks to at most"),
        "{refused}"
    );
}

#[cfg(feature = "sqlite")]
#[test]
fn database_views_are_not_queried() {
    let dir = tempfile::tempdir().unwrap();
    for (name, change) in [
        (
            "topics.db3",
            "ALTER TABLE topics RENAME TO t; CREATE VIEW topics AS SELECT 1 AS id, printf('%.9000c', 'x') AS name, 'a/b' AS type, 'cdr' AS serialization_format;",
        ),
        (
            "messages.db3",
            "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS
             WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(1000) AS data FROM n;",
        ),
        (
            "column.db3",
            "ALTER TABLE topics RENAME TO t; CREATE TABLE topics(id INTEGER PRIMARY KEY, type TEXT, serialization_format TEXT,
             name TEXT GENERATED ALWAYS AS (printf('%.9000c', 'x')) VIRTUAL); INSERT INTO topics(id, type, serialization_format) SELECT id, type, serialization_format FROM t;",
        ),
    ] {
        let path = dir.path().join(name);
        let base = crate::sqlite::write(&path, &camera("/camera", 2));
        base.execute_batch(change).unwrap();
        drop(base);
        let refused = info(&path).unwrap_err().to_string();
        assert!(
            refused.contains("computed") && refused.contains("a table of"),
            "{name}: {refused}"
        );
    }
    let path = dir.path().join("long.db3");
    let base = crate::sqlite::write(&path, &camera("/camera", 2));
    base.execute_batch("INSERT INTO topics VALUES (99, hex(zeroblob(1000000)), 'a/b', 'cdr')")
        .unwrap();
    drop(base);
    let found = info(&path).unwrap();
    assert_eq!(found.topics.len(), 3);
    assert!(found.remarks[0].contains("a topic without a name"));
}
