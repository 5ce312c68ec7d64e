//! Work without the interpreter's lock, and what a panic in it becomes.
//!
//! Answers: how a value that several threads of Python hold is changed by one at a time. No code of Python ever runs while one has it, so
//! nobody waits for the other in a circle.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError};

/// Runs `work` without the interpreter's lock. A panic is a defect of this package; it becomes a `RuntimeError` like any other, since
/// nothing of it may end the interpreter.
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| catch_unwind(AssertUnwindSafe(work)))
        .map_err(|panic| {
            let said = panic.downcast_ref::<&str>().map(ToString::to_string);
            let said = said.or_else(|| panic.downcast_ref::<String>().cloned());
            PyRuntimeError::new_err(format!(
                "a defect of stillpoint_slam, please report it: {}",
                said.unwrap_or_default()
            ))
        })
}

/// A value that one thread has at a time.
pub(crate) struct Turn<T> {
    /// Nothing once a panic left it in a state that means nothing.
    value: Mutex<Option<T>>,
}

impl<T: Send> Turn<T> {
    pub(crate) fn new(value: T) -> Self {
        Self {
            value: Mutex::new(Some(value)),
        }
    }

    /// Waits for the value, and works with it without the interpreter's lock.
    pub(crate) fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut T) -> R + Send,
    ) -> PyResult<R> {
        let done = detached(py, || {
            let mut guard = self.value.lock().unwrap_or_else(PoisonError::into_inner);
            let mut value = guard.take()?;
            let result = work(&mut value);
            // Not reached by a panic.
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
