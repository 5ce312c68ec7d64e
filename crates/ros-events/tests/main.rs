//! Messages of runs.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod walk;
