//! Priorities of threads: threads that do not track give way to tracking.

use stillpoint::live::Stage;

/// By how much less urgent a stage is than tracking, as a nice value. Mapping and detection share what tracking leaves: where that is
/// little, mapping puts less work into each keyframe, and the detector looks at fewer frames. Loops may come late.
fn niceness(stage: Stage) -> i32 {
    match stage {
        Stage::Tracking => 0,
        Stage::Mapping | Stage::Detection => 5,
        Stage::Looping => 10,
    }
}

/// Lowers the priority of this thread to what its stage needs. To be called once per thread. Threads that it starts
/// from now on have the same.
pub(crate) fn lower(stage: Stage) {
    let by = niceness(stage);
    if by > 0 {
        lower_by(by);
    }
}

/// In Linux a nice value is a thread's, elsewhere the whole process's, which is left alone.
#[cfg(target_os = "linux")]
fn lower_by(by: i32) {
    use rustix::process::{getpriority_process, setpriority_process};
    let thread = Some(rustix::thread::gettid());
    // Lowers the thread further even if the user lowered it already. If the system refuses, all threads keep
    // the same priority.
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
    fn only_the_thread_itself_and_those_it_starts_give_way() {
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
