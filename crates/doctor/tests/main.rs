//! Tests of the public interface.

#![allow(clippy::unwrap_used, clippy::print_stdout)] // Clippy does not recognise helpers as tests.

mod common;
mod recorded;
mod simulated;
