//! Maps, their laws and their corrections.

#![allow(clippy::unwrap_used)] // Clippy does not recognise test helpers as tests.

mod correction;
mod invariants;
