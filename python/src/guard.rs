//! Work without the interpreter's lock: panics, exclusive access, and shutdown.
//!
//! Python threads modify a value one at a time. No Python code runs meanwhile, so there are no deadlocks.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread::ThreadId;
use std::time::Duration;

/// A panic, which is a defect of this package, becomes a `RuntimeError` instead of ending the interpreter.
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let done = py.detach(|| {
        let done = catch_unwind(AssertUnwindSafe(work));
        stay_if_over();
        done
    });
    done.map_err(|panic| {
        let said = panic.downcast_ref::<&str>().map(ToString::to_string);
        let said = said.or_else(|| panic.downcast_ref::<String>().cloned());
        PyRuntimeError::new_err(format!(
            "a defect of stillpoint_slam, please report it: {}",
            said.unwrap_or_default()
        ))
    })
}

/// Whether the interpreter is shutting down.
static ENDS: AtomicBool = AtomicBool::new(false);
/// The thread that shuts it down.
static ENDING: Mutex<Option<ThreadId>> = Mutex::new(None);
/// Number of running calls of user functions.
static CALLS: Mutex<usize> = Mutex::new(0);
static RETURNED: Condvar = Condvar::new();
/// Maximum time that shutdown waits for user functions.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time for threads waiting for the interpreter's lock to get it.
const PAUSE: Duration = Duration::from_millis(30);

fn is_over() -> bool {
    let here = Some(std::thread::current().id());
    let ending = || *ENDING.lock().unwrap_or_else(PoisonError::into_inner);
    ENDS.load(Ordering::SeqCst) && ending() != here
}

/// The interpreter kills a thread that requests the lock during shutdown, which ends the process with an error. Parking it here avoids
/// that.
fn stay_if_over() {
    while is_over() {
        std::thread::park();
    }
}

/// Calls a user function; `None` during shutdown.
pub(crate) fn calling<R>(call: impl FnOnce() -> R) -> Option<R> {
    struct Returned;
    impl Drop for Returned {
        fn drop(&mut self) {
            *CALLS.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
            RETURNED.notify_all();
        }
    }
    let mut calls = CALLS.lock().unwrap_or_else(PoisonError::into_inner);
    if is_over() {
        return None;
    }
    *calls += 1;
    drop(calls);
    let _returned = Returned;
    Some(call())
}

/// Prepares for shutdown: no more user functions are called, and running ones return first. Registered with `atexit`.
#[pyfunction]
pub(crate) fn prepare_for_end(py: Python<'_>) {
    *ENDING.lock().unwrap_or_else(PoisonError::into_inner) = Some(std::thread::current().id());
    ENDS.store(true, Ordering::SeqCst);
    py.detach(|| {
        let calls = CALLS.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = RETURNED.wait_timeout_while(calls, PATIENCE, |calls| *calls > 0);
        drop(waited);
        std::thread::sleep(PAUSE);
    });
}

/// A value with exclusive access.
pub(crate) struct Turn<T> {
    /// `None` after a panic, which may have left an invalid state.
    value: Mutex<Option<T>>,
}

impl<T: Send> Turn<T> {
    pub(crate) fn new(value: T) -> Self {
        Self {
            value: Mutex::new(Some(value)),
        }
    }

    /// Waits for the value, and works on it without the interpreter's lock.
    pub(crate) fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut T) -> R + Send,
    ) -> PyResult<R> {
        let done = detached(py, || {
            let mut guard = self.value.lock().unwrap_or_else(PoisonError::into_inner);
            let mut value = guard.take()?;
            let result = work(&mut value);
            // Not reached after a panic.
            *guard = Some(value);
            Some(result)
        })?;
        done.ok_or_else(|| {
            PyRuntimeError::new_err(
                "cannot be used any more after the defect reported before; begin a new one",
            )
        })
    }
}
