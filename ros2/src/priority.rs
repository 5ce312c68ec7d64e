//! Thread priorities: threads other than tracking get lower ones, as in live runs of the command line.

use std::cell::Cell;
use stillpoint::live::Stage;

thread_local! {
    static LOWERED: Cell<bool> = const { Cell::new(false) };
}

/// Lowers the priority of this thread for its stage, once.
pub fn lower_once(stage: Stage) {
    let by = match stage {
        Stage::Tracking => 0,
        Stage::Mapping | Stage::Detection => 5,
        Stage::Looping => 10,
    };
    if !LOWERED.replace(true) && by > 0 {
        lower_by(by);
    }
}

#[cfg(target_os = "linux")]
fn lower_by(by: i32) {
    use rustix::process::{getpriority_process, setpriority_process};
    // In Linux nice values apply to threads.
    let thread = Some(rustix::thread::gettid());
    if let Ok(before) = getpriority_process(thread) {
        let _ = setpriority_process(thread, (before + by).min(19));
    }
}

#[cfg(not(target_os = "linux"))]
fn lower_by(_: i32) {}
