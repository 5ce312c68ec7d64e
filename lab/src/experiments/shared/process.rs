//! Time and memory of this process, on Linux.

use std::sync::LazyLock;
use std::time::Instant;

/// CPU time of this thread, s, independent of the machine's load; wall-clock time if unavailable.
pub(crate) fn computed() -> f64 {
    static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
    // The kernel updates the time only at ticks, some milliseconds apart, and when a thread yields.
    std::thread::yield_now();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split_whitespace().next().and_then(|w| w.parse().ok());
    nanoseconds.map_or_else(|| BEGIN.elapsed().as_secs_f64(), |ns: f64| 1e-9 * ns)
}

/// Memory such as `VmRSS` (current) or `VmHWM` (peak), MB; NaN if unavailable.
pub(crate) fn memory_mb(figure: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with(figure));
    let kb = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    kb.map_or(f64::NAN, |kb| kb * 1024e-6)
}
