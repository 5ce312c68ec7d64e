//! What this process takes: time and memory, where Linux tells.

use std::sync::LazyLock;
use std::time::Instant;

/// Seconds that this thread has computed, which a loaded machine does not stretch; seconds that have passed where the system does not tell.
pub(crate) fn computed() -> f64 {
    static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
    // The kernel counts a running thread's time at its ticks, some milliseconds apart, and whenever it makes way for another.
    std::thread::yield_now();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split_whitespace().next().and_then(|w| w.parse().ok());
    nanoseconds.map_or_else(|| BEGIN.elapsed().as_secs_f64(), |ns: f64| 1e-9 * ns)
}

/// A figure of this process's memory, such as `VmRSS` (now) or `VmHWM` (at most so far), MB; not a number where the system does not tell.
pub(crate) fn memory_mb(figure: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with(figure));
    let kb = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    kb.map_or(f64::NAN, |kb| kb * 1024e-6)
}
