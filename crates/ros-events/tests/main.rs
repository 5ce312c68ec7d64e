//! Messages of runs.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod walk;
