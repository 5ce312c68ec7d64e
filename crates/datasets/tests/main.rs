//! Tests of valid and invalid data sets.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod bad_input;
mod common;
mod disturb;
mod fuzz;
mod layouts;
mod read_ahead;
mod real_data;
mod scripted;
mod splice;
