//! Resources of a batch, planned before the first run: number of parallel runs, threads of each, and total memory.

use crate::args::batch::BatchArgs;
use crate::batch::row::Job;
use crate::console;
use crate::detector::Settled;
use std::path::Path;
use stillpoint::recordings;

/// Memory of a run without images and map, bytes: program, tables, images of the report. Measured: 45 MB (release build on Linux).
const BASE: u64 = 60_000_000;
/// Memory per image pixel, bytes: eight frames read ahead and those being processed, each with grey (1), colour (3), depth (4) and
/// pyramids. With `BASE`, a run of 640x480 px is estimated at 155 to 224 MB; measured: 90 to 123 MB.
const PER_PIXEL: u64 = 250;
/// Memory per frame of the recording, bytes: map, trajectory and report. An upper bound, chosen: the map of a long run grows far slower
/// (docs/scale.md).
const PER_FRAME: u64 = 60_000;
/// Memory of a detector network with its runtime, bytes. An upper bound, chosen for networks as large as YOLOv7-tiny; YOLOX-nano takes some
/// 40 MB (docs/benchmarks.md).
const NETWORK: u64 = 400_000_000;
/// Memory of a surface, bytes: a room at 2 cm. An upper bound, chosen; measured on one run: 130 MB in all.
const SURFACE: u64 = 400_000_000;
/// Share of the free memory that a batch uses by default, chosen: the rest is left to the disk cache, without which recordings are read
/// slowly.
const SHARE: f64 = 0.8;
/// Maximum number of recordings that are opened for the estimate: if none of them can be read, the runs report it.
const TRIED: usize = 8;
/// Maximum number of threads per frame; chosen, since little of a frame's work can run in parallel (decision 38).
const MOST_THREADS: usize = 4;

/// Expected memory of the largest run, and how it was estimated.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Memory {
    pub(crate) bytes: u64,
    pub(crate) of: String,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Budget {
    pub(crate) workers: usize,
    /// Worker threads per run; `None` where the environment sets them.
    pub(crate) threads: Option<usize>,
}

impl Memory {
    /// Estimates the largest job: image size of the first recording that opens, number of frames in proportion to the file size.
    pub(crate) fn estimate(jobs: &[Job], args: &BatchArgs, settled: &Settled) -> Self {
        let options = crate::input::options(&args.input);
        let opened = jobs.iter().take(TRIED).find_map(|job| {
            let input = recordings::open(&job.item.path, &options).ok()?;
            let camera = &input.camera().camera;
            let frames = input.stamps().len() as u64;
            let size = (camera.width, camera.height);
            Some((&job.item, job.row.input_bytes, frames, size))
        });
        let Some((item, bytes, frames, (width, height))) = opened else {
            return Self {
                bytes: of_run(640 * 480, 10_000, args, settled),
                of: "10000 frames of 640x480, since none of the first was opened".to_owned(),
            };
        };
        let largest = jobs.iter().map(|j| j.row.input_bytes).max();
        let largest = largest.unwrap_or(bytes);
        let longest = (frames as f64 * largest as f64 / bytes.max(1) as f64).ceil() as u64;
        let most = args.input.max_frames.unwrap_or(u64::MAX);
        let longest = longest.max(frames).min(most);
        Self {
            bytes: of_run(u64::from(width) * u64::from(height), longest, args, settled),
            of: format!(
                "{longest} frames of {width}x{height}, as {} has them",
                item.name
            ),
        }
    }
}

fn of_run(pixels: u64, frames: u64, args: &BatchArgs, settled: &Settled) -> u64 {
    let mut bytes = BASE + PER_PIXEL * pixels + PER_FRAME * frames;
    if settled.needs_colour() {
        bytes += NETWORK;
    }
    if args.each.dense {
        bytes += SURFACE;
    }
    bytes
}

impl Budget {
    /// Budget of an empty batch.
    pub(crate) const NONE: Self = Self {
        workers: 0,
        threads: None,
    };

    /// Plans and prints the budget of `runs` runs that need `memory` each.
    pub(crate) fn plan(runs: usize, memory: &Memory, asked: Option<u16>) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let free = free_memory();
        let workers = match asked {
            Some(n) => usize::from(n),
            None => affordable(cores, memory.bytes, free),
        };
        let workers = workers.min(runs).max(1);
        let said = std::env::var_os("STILLPOINT_WORKERS").filter(|v| !v.is_empty() && v != "auto");
        let threads = said.is_none().then(|| threads_of(cores / workers));
        let all = memory.bytes * workers as u64;
        console::info(&format!(
            "{} on {} for {}, {} for each frame and one that reads; memory: {} each at most, estimated for {}, {} of all{}",
            console::counted(workers, "worker"),
            console::counted(cores, "core"),
            console::counted(runs, "recording"),
            threads.map_or_else(
                || "threads as STILLPOINT_WORKERS says".to_owned(),
                |n| console::counted(n, "thread"),
            ),
            gigabytes(memory.bytes),
            memory.of,
            gigabytes(all),
            free.map_or_else(String::new, |f| format!(", {} free", gigabytes(f))),
        ));
        if free.is_some_and(|f| all > f) {
            console::warn(
                "that is more memory than is free: give fewer --workers, or end other programs",
            );
        }
        Self { workers, threads }
    }
}

/// Worker threads of a run with this many cores: one core reads images ahead, as in a single run.
fn threads_of(cores: usize) -> usize {
    cores.saturating_sub(1).clamp(1, MOST_THREADS)
}

/// Parallel runs: one per core, as far as memory allows.
fn affordable(cores: usize, each: u64, free: Option<u64>) -> usize {
    let fit = free.map_or(usize::MAX, |f| (f as f64 * SHARE / each as f64) as usize);
    cores.min(fit).max(1)
}

fn gigabytes(bytes: u64) -> String {
    format!("{:.2} GB", bytes as f64 * 1e-9)
}

/// Available memory, bytes: that of the machine, or the rest of the control group's limit. `None` where the system does not report it.
fn free_memory() -> Option<u64> {
    let meminfo = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = meminfo
        .lines()
        .find_map(|l| l.strip_prefix("MemAvailable:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let group = groups.lines().find_map(|l| l.strip_prefix("0::/"));
    let left = group.and_then(|g| left_of_group(Path::new("/sys/fs/cgroup"), Path::new(g)));
    Some((kilobytes * 1024).min(left.unwrap_or(u64::MAX)))
}

/// Memory left within the limits of a control group and its parents, bytes.
fn left_of_group(root: &Path, group: &Path) -> Option<u64> {
    let number =
        |path: &Path| -> Option<u64> { std::fs::read_to_string(path).ok()?.trim().parse().ok() };
    let left = group.ancestors().filter_map(|group| {
        let folder = root.join(group);
        // A group without a limit has "max".
        let most = number(&folder.join("memory.max"))?;
        Some(most.saturating_sub(number(&folder.join("memory.current"))?))
    });
    left.min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_are_shared_among_runs() {
        assert_eq!([1, 2, 3, 32].map(threads_of), [1, 1, 2, 4]);
    }

    #[test]
    fn memory_limits_parallel_runs() {
        assert_eq!(affordable(8, 1_000, None), 8);
        assert_eq!(affordable(8, 1_000, Some(100_000)), 8);
        assert_eq!(affordable(8, 1_000, Some(4_000)), 3);
        assert_eq!(affordable(8, 1_000, Some(10)), 1);
    }

    #[test]
    fn tightest_cgroup_limit_applies() {
        let dir = tempfile::tempdir().unwrap();
        let write = |group: &str, most: &str, now: &str| {
            let folder = dir.path().join(group);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("memory.max"), most).unwrap();
            std::fs::write(folder.join("memory.current"), now).unwrap();
        };
        write("job", "1000\n", "300\n");
        write("job/step", "max\n", "200\n");
        let left = |group: &str| left_of_group(dir.path(), Path::new(group));
        assert_eq!(left("job/step"), Some(700));
        assert_eq!(left("other"), None);
        write("job/step", "250\n", "200\n");
        assert_eq!(left("job/step"), Some(50));
    }
}
