//! Maps, their laws and their corrections.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod correction;
mod invariants;
