//! Files with well-formed records and wrong contents: mutated single bytes are mostly caught by a checksum or a length. Each test uses 50
//! fixed seeds; `STILLPOINT_MUTATIONS` sets more, as in `mutations.rs`.

use crate::damage::{chunk, chunk_of, records_of};
use crate::mutations::{Random, campaign};
use crate::writers::*;

const SEEDS: usize = 50;

/// Extreme values of an integer of this many bytes.
fn extreme(random: &mut Random, bytes: usize) -> Vec<u8> {
    let all = [
        0,
        1,
        2,
        0x7f,
        0x80,
        0xff,
        0xffff,
        i32::MAX as u64,
        u64::from(u32::MAX),
        i64::MAX as u64,
        u64::MAX,
        1 << 20,
        1 << 28,
    ];
    all[random.below(all.len())].to_le_bytes()[..bytes].to_vec()
}

/// Removes, duplicates or reorders records, or changes a number in one.
fn rearranged<K: Clone>(records: &mut Vec<(K, Vec<u8>)>, random: &mut Random) {
    for _ in 0..1 + random.below(6) {
        if records.is_empty() {
            return;
        }
        let at = random.below(records.len());
        match random.below(6) {
            0 => drop(records.remove(at)),
            1 => {
                let copy = records[at].clone();
                let times = 1 + random.below(50);
                let to = random.below(records.len());
                records.splice(to..to, vec![copy; times]);
            }
            2 => {
                let other = random.below(records.len());
                records.swap(at, other);
            }
            3 => {
                let kind = records[random.below(records.len())].0.clone();
                records[at].0 = kind;
            }
            4 => {
                let body = &mut records[at].1;
                body.truncate(random.below(body.len() + 1));
            }
            _ => {
                let body = &mut records[at].1;
                let width = [1, 2, 4, 8][random.below(4)];
                if body.len() >= width {
                    // Numbers are at the beginning of most records.
                    let reach = if random.below(2) == 0 { 64 } else { usize::MAX };
                    let place = random.below((body.len() - width + 1).min(reach));
                    let value = extreme(random, width);
                    body[place..place + width].copy_from_slice(&value);
                }
            }
        }
    }
}

fn written(records: &[(u8, Vec<u8>)]) -> Vec<u8> {
    let mut out = Vec::new();
    records
        .iter()
        .for_each(|(op, body)| record(&mut out, *op, body));
    out
}

#[test]
fn rearranged_mcap_records_never_panic() {
    let whole = mcap(&camera("/camera", 3), Some((7, true)));
    let (magic, inner) = (&whole[..8], &whole[8..whole.len() - 8]);
    campaign("records.mcap", SEEDS, |random| {
        let mut records = records_of(inner);
        for (_, body) in records.iter_mut().filter(|(op, _)| *op == 6) {
            let (how, unpacked) = chunk_of(body);
            let mut within = records_of(&unpacked);
            if random.below(2) == 0 {
                rearranged(&mut within, random);
            }
            let bytes = written(&within);
            // With a valid checksum, as in a deliberate attack.
            let crc = crc32fast::hash(&bytes);
            *body = chunk(["", "lz4", "zstd", &how][random.below(4)], &bytes, crc);
        }
        if random.below(3) == 0 {
            rearranged(&mut records, random);
        }
        [magic, &written(&records), magic].concat()
    });
}

fn bag_records(mut bytes: &[u8]) -> Vec<(Vec<u8>, Vec<u8>)> {
    let mut all = Vec::new();
    let part = |bytes: &mut &[u8]| {
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let part = bytes[4..4 + length].to_vec();
        *bytes = &bytes[4 + length..];
        part
    };
    while !bytes.is_empty() {
        let header = part(&mut bytes);
        let data = part(&mut bytes);
        all.push((header, data));
    }
    all
}

fn bag_written(records: &[(Vec<u8>, Vec<u8>)]) -> Vec<u8> {
    let mut out = Vec::new();
    for part in records.iter().flat_map(|(header, data)| [header, data]) {
        out.extend((part.len() as u32).to_le_bytes());
        out.extend(part);
    }
    out
}

#[test]
fn rearranged_bag_records_never_panic() {
    let whole = bag(&camera("/camera", 3), "none");
    let (magic, inner) = whole.split_at(13);
    campaign("records.bag", SEEDS, |random| {
        let mut records = bag_records(inner);
        for (header, data) in records.iter_mut().skip(1) {
            let mut within = bag_records(data);
            rearranged(&mut within, random);
            if random.below(3) == 0 && !within.is_empty() {
                // Changes a number in a header and keeps its fields.
                let at = random.below(within.len());
                let field = &mut within[at].0;
                if field.len() > 20 {
                    let place = field.len() - 4;
                    let value = extreme(random, 4);
                    field[place..].copy_from_slice(&value);
                }
            }
            let bytes = bag_written(&within);
            let how = ["none", "lz4", "bz2"][random.below(3)];
            let packed = match how {
                "lz4" => lz4(&bytes),
                "bz2" => bz2(&bytes),
                _ => bytes.clone(),
            };
            *header = fields(&[
                ("op", vec![5]),
                ("compression", how.as_bytes().to_vec()),
                ("size", (bytes.len() as u32).to_le_bytes().to_vec()),
            ]);
            *data = packed;
        }
        if random.below(3) == 0 {
            rearranged(&mut records, random);
        }
        [magic, &bag_written(&records)].concat()
    });
}

#[cfg(feature = "sqlite")]
#[test]
fn altered_database_rows_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rows.db3");
    drop(crate::sqlite::write(&path, &camera("/camera", 3)));
    let whole = std::fs::read(&path).unwrap();
    campaign("rows.db3", SEEDS, |random| {
        std::fs::write(&path, &whole).unwrap();
        let base = rusqlite::Connection::open(&path).unwrap();
        for _ in 0..1 + random.below(4) {
            let table = ["topics", "messages"][random.below(2)];
            let column = match table {
                "topics" => ["id", "name", "type", "serialization_format"][random.below(4)],
                _ => ["id", "topic_id", "timestamp", "data"][random.below(4)],
            };
            let value = [
                "0",
                "-1",
                "9223372036854775807",
                "-9223372036854775808",
                "1e300",
                "'text'",
                "''",
                "x''",
                "x'00010000'",
                "zeroblob(3000000)",
                "hex(zeroblob(600000))",
                "'sensor_msgs/msg/Image'",
                "'sensor_msgs/msg/CameraInfo'",
                "'sensor_msgs/msg/Imu'",
                "char(10)",
            ][random.below(15)];
            let row = random.below(12);
            // Statements that violate the table's constraints have no effect.
            let _ = base.execute_batch(&match random.below(5) {
                0 => format!("DELETE FROM {table} WHERE id = {row}"),
                1 => format!("INSERT OR IGNORE INTO {table} SELECT id + 100, * FROM {table} WHERE 0"),
                2 => format!("UPDATE {table} SET {column} = {value}"),
                3 => format!("DROP TABLE {table}; CREATE TABLE {table}(id, topic_id, timestamp, data, name, type, serialization_format)"),
                _ => format!("UPDATE {table} SET {column} = {value} WHERE id = {row}"),
            });
        }
        drop(base);
        std::fs::read(&path).unwrap()
    });
}
