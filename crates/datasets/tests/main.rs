//! Data sets as they lie on disk, good and bad.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod bad_input;
mod common;
mod disturb;
mod fuzz;
mod layouts;
mod read_ahead;
mod real_data;
mod scripted;
mod splice;
