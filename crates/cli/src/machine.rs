//! The machine and the program, for reports.

use serde::{Deserialize, Serialize};

/// Where figures were measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Machine {
    /// Processor, as it names itself; its architecture where that is not known.
    pub(crate) cpu: String,
    /// Cores that the process may use.
    pub(crate) cores: usize,
    /// Operating system and version of its kernel, without what distributors add to that.
    pub(crate) system: String,
    /// Compiler of this program.
    pub(crate) rustc: String,
    /// Version of this program.
    pub(crate) stillpoint: String,
}

impl Machine {
    /// This machine.
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

/// The largest amount of memory that this process has held so far, bytes; `None` where the system does not say.
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
    fn memory_is_at_least_what_was_touched() {
        let before = peak_memory().unwrap();
        let block = std::hint::black_box(vec![1_u8; 64 << 20]);
        assert!(peak_memory().unwrap() >= before.min(64 << 20));
        assert!(peak_memory().unwrap() >= block.len() as u64);
        assert!(Machine::here().system.starts_with("linux "));
    }
}
