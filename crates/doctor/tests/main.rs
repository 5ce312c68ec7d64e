//! Tests of the public interface: one binary.

#![allow(clippy::unwrap_used, clippy::print_stdout)] // Helpers of tests are not recognised as tests.

mod common;
mod recorded;
mod simulated;
