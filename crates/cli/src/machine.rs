//! The machine and the program, for reports.

use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Machine {
    /// Processor name, or its architecture if unknown.
    pub(crate) cpu: String,
    /// Cores available to the process.
    pub(crate) cores: usize,
    /// Operating system and kernel version, without the distributor's suffix.
    pub(crate) system: String,
    pub(crate) rustc: String,
    pub(crate) stillpoint: String,
}

impl Machine {
    pub(crate) fn here() -> Self {
        let read = |path| std::fs::read_to_string(path).unwrap_or_default();
        let cpu = read("/proc/cpuinfo")
            .lines()
            .find(|l| l.starts_with("model name"))
            .and_then(|l| l.split_once(':'))
            .map_or_else(
                || std::env::consts::ARCH.to_owned(),
                |(_, v)| v.trim().to_owned(),
            );
        let release = read("/proc/sys/kernel/osrelease");
        let version = release.split('-').next().unwrap_or_default();
        Self {
            cpu,
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            system: format!("{} {}", std::env::consts::OS, version.trim())
                .trim()
                .to_owned(),
            rustc: env!("STILLPOINT_RUSTC").to_owned(),
            stillpoint: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }
}

/// Peak memory of this process, bytes; `None` where the system does not report it.
pub(crate) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn peak_memory_includes_touched_pages() {
        let before = peak_memory().unwrap();
        let block = std::hint::black_box(vec![1_u8; 64 << 20]);
        assert!(peak_memory().unwrap() >= before.min(64 << 20));
        assert!(peak_memory().unwrap() >= block.len() as u64);
        assert!(Machine::here().system.starts_with("linux "));
    }
}
