//! Ctrl-C: the first asks the loop to end after the current frame, the second ends the process. Before the loop starts there is nothing to
//! save, and the first ends the process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a process ended by a signal.
const ENDED: i32 = 130;

#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt {
    requested: Arc<AtomicBool>,
    /// The next signal ends the process.
    at_once: Arc<AtomicBool>,
}

impl Interrupt {
    /// Handles Ctrl-C (SIGINT), SIGTERM and SIGHUP. A terminal sends SIGHUP when it closes; a process started with `nohup` ignores it. A
    /// signal that cannot be handled ends the process at once, as usual.
    pub(crate) fn listen() -> Self {
        let interrupt = Self::prepare();
        interrupt.begin();
        interrupt
    }

    /// Like [`Self::listen`], but the first signal ends the process until [`Self::begin`] is called.
    pub(crate) fn prepare() -> Self {
        let interrupt = Self::default();
        interrupt.at_once.store(true, Ordering::SeqCst);
        for signal in signals() {
            use signal_hook::flag::{register, register_conditional_shutdown};
            // The order matters: the shutdown handler must see the flag from before this signal.
            let (requested, at_once) = (&interrupt.requested, &interrupt.at_once);
            let armed = register_conditional_shutdown(signal, ENDED, Arc::clone(at_once))
                .and_then(|_| register(signal, Arc::clone(requested)))
                .and_then(|_| register(signal, Arc::clone(at_once)));
            if let Err(e) = armed {
                crate::console::warn(&format!("Ctrl-C will end the program at once: {e}"));
            }
        }
        interrupt
    }

    /// From here on there are results to save: the next signal is a request.
    pub(crate) fn begin(&self) {
        if !self.requested() {
            self.at_once.store(false, Ordering::SeqCst);
        }
    }

    pub(crate) fn flag(&self) -> &AtomicBool {
        &self.requested
    }

    /// True once the user asked to stop.
    pub(crate) fn requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }
}

fn signals() -> Vec<i32> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let mut signals = vec![SIGINT, SIGTERM];
    #[cfg(unix)]
    if !ignores_hangup() {
        signals.push(signal_hook::consts::SIGHUP);
    }
    signals
}

/// Whether the process was started with SIGHUP ignored. Known only on Linux; elsewhere false.
#[cfg(unix)]
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status
        .lines()
        .find_map(|l| l.strip_prefix("SigIgn:"))
        .and_then(|m| u64::from_str_radix(m.trim(), 16).ok());
    mask.is_some_and(|m| m >> (signal_hook::consts::SIGHUP - 1) & 1 == 1)
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::low_level::raise;
    use std::process::Command;

    /// Environment variable that selects the case of the child process.
    const CASE: &str = "STILLPOINT_TEST_INTERRUPT";

    /// Not a test: the child process that receives signals. Reports by its exit code that it reached its end.
    #[test]
    fn child_that_is_interrupted() {
        let Some(case) = std::env::var_os(CASE) else {
            return;
        };
        if case == "prepared" {
            let _interrupt = Interrupt::prepare();
            raise(SIGINT).unwrap();
            std::process::exit(50);
        }
        let interrupt = Interrupt::listen();
        let signal = match case.to_str() {
            Some("hup") => SIGHUP,
            Some("term") => SIGTERM,
            _ => SIGINT,
        };
        assert!(!interrupt.requested());
        raise(signal).unwrap();
        assert!(interrupt.requested());
        // Too late to re-arm.
        interrupt.begin();
        raise(SIGINT).unwrap();
        std::process::exit(51);
    }

    fn ends_with(case: &str) -> Option<i32> {
        let test = "interrupt::tests::child_that_is_interrupted";
        let mut child = Command::new(std::env::current_exe().unwrap());
        child.args(["--exact", test]).env(CASE, case);
        child.output().unwrap().status.code()
    }

    #[test]
    fn second_signal_or_first_before_the_loop_ends_process() {
        for case in ["int", "term", "hup", "prepared"] {
            if case == "hup" && ignores_hangup() {
                println!("skipped: SIGHUP is ignored here, as under nohup");
                continue;
            }
            assert_eq!(ends_with(case), Some(ENDED), "{case}");
        }
    }
}
