//! Thread priorities: other threads yield to tracking.

use stillpoint::live::Stage;

/// Nice value of a stage relative to tracking. Mapping and detection share the remaining time: where that is little, mapping does less per
/// keyframe, and the detector skips frames. Loops may come late.
fn niceness(stage: Stage) -> i32 {
    match stage {
        Stage::Tracking => 0,
        Stage::Mapping | Stage::Detection => 5,
        Stage::Looping => 10,
    }
}

/// Lowers the priority of this thread to that of its stage. Call it once per thread; threads that it starts afterwards inherit the
/// priority.
pub(crate) fn lower(stage: Stage) {
    let by = niceness(stage);
    if by > 0 {
        lower_by(by);
    }
}

/// On Linux a nice value belongs to a thread, elsewhere to the whole process, which is left alone.
#[cfg(target_os = "linux")]
fn lower_by(by: i32) {
    use rustix::process::{getpriority_process, setpriority_process};
    let thread = Some(rustix::thread::gettid());
    // Relative to the priority that the user set. If the system refuses, the priority stays.
    if let Ok(before) = getpriority_process(thread) {
        let _ = setpriority_process(thread, (before + by).min(19));
    }
}

#[cfg(not(target_os = "linux"))]
fn lower_by(_: i32) {}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use super::*;
    use rustix::process::getpriority_process;

    #[test]
    fn lowered_priority_applies_to_the_thread_and_children() {
        let nice = || getpriority_process(Some(rustix::thread::gettid())).unwrap();
        let before = nice();
        let (own, started) = std::thread::spawn(move || {
            lower(Stage::Tracking);
            assert_eq!(nice(), before);
            lower(Stage::Mapping);
            (nice(), std::thread::spawn(nice).join().unwrap())
        })
        .join()
        .unwrap();
        assert_eq!(own, (before + 5).min(19));
        assert_eq!(started, own);
        assert_eq!(nice(), before);
    }
}
