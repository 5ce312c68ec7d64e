//! Damaged files of every format must not cause a panic. Each test uses 200 fixed seeds; `STILLPOINT_MUTATIONS=20000` sets more, and also
//! checks the limits of time and memory: at most 10 s per file, and 1 GB peak.

use crate::files::{put, variants};
use crate::orbbec;
use crate::writers::*;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};
use stillpoint_imaging::FrameSource;
use stillpoint_recordings::{FrameOptions, OpenOptions, open};

const SEEDS: usize = 200;
const LONGEST: Duration = Duration::from_secs(10);
const MOST_MEMORY: u64 = 1_000_000;

pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % n
    }
}

/// Modifies some bytes or a block, moves a part, or truncates.
fn mutated(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..1 + random.below(8) {
        let at = random.below(bytes.len());
        match random.below(6) {
            0 => bytes[at] = random.below(256) as u8,
            1 => bytes[at] = 0xff,
            2 => bytes[at] ^= 1 << random.below(8),
            3 => {
                let end = (at + random.below(16)).min(bytes.len());
                bytes[at..end].fill(random.below(2) as u8 * 0xff);
            }
            4 => {
                let from = random.below(bytes.len());
                let length = random.below(64).min(bytes.len() - at.max(from));
                bytes.copy_within(from..from + length, at);
            }
            _ => {
                let end = (at + random.below(32)).min(bytes.len());
                bytes.drain(at..end);
                if bytes.is_empty() {
                    bytes.push(0);
                }
            }
        }
    }
    if random.below(4) == 0 {
        bytes.truncate(1 + random.below(bytes.len()));
    }
    bytes
}

fn read(path: &Path) {
    if let Ok(input) = open(path, &OpenOptions::default())
        && let Ok(mut source) = input.frames(&FrameOptions::default())
    {
        while source.next_frame().is_some() {}
    }
}

/// Peak memory of this process, kB; unknown except on Linux.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

fn mutate(name: &str, whole: &[u8]) {
    campaign(name, SEEDS, |random| mutated(whole, random));
}

pub(crate) fn campaign(name: &str, seeds: usize, mut make: impl FnMut(&mut Random) -> Vec<u8>) {
    let asked = std::env::var("STILLPOINT_MUTATIONS");
    let asked = asked.ok().and_then(|n| n.parse::<usize>().ok());
    let dir = tempfile::tempdir().unwrap();
    let mut random = Random(1);
    let mut slowest = Duration::ZERO;
    for seed in 0..asked.unwrap_or(seeds) {
        let path = put(dir.path(), name, &make(&mut random));
        let start = Instant::now();
        read(&path);
        slowest = slowest.max(start.elapsed());
        if asked.is_some() {
            assert!(
                slowest < LONGEST,
                "{name}: mutation {seed} took {slowest:?}"
            );
        }
    }
    if let Some(count) = asked {
        let peak = peak_memory();
        let line = format!("{name}: {count} mutations, slowest {slowest:?}, peak {peak:?} kB\n");
        std::io::stderr().write_all(line.as_bytes()).unwrap();
        assert!(peak.is_none_or(|p| p < MOST_MEMORY), "{name}: {peak:?} kB");
    }
}

fn variant(name: &str) {
    let all = variants(&camera("/camera", 3));
    let (_, whole) = all.iter().find(|(n, _)| *n == name).unwrap();
    mutate(name, whole);
}

#[test]
fn damaged_mcap_never_panics() {
    variant("plain.mcap");
}

#[test]
fn damaged_chunked_mcap_never_panics() {
    variant("chunks.mcap");
}

#[test]
fn damaged_lz4_mcap_never_panics() {
    variant("lz4.mcap");
}

#[test]
fn damaged_bag_never_panics() {
    variant("plain.bag");
}

#[test]
fn damaged_lz4_bag_never_panics() {
    variant("lz4.bag");
}

#[test]
fn damaged_bzip2_bag_never_panics() {
    variant("bz2.bag");
}

#[test]
fn damaged_orbbec_bag_never_panics() {
    mutate(
        "orbbec.bag",
        &crate::writers::bag(&orbbec::messages(2), "lz4"),
    );
}

#[cfg(feature = "sqlite")]
#[test]
fn damaged_database_never_panics() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.db3");
    drop(crate::sqlite::write(&path, &camera("/camera", 3)));
    mutate("a.db3", &std::fs::read(path).unwrap());
}
