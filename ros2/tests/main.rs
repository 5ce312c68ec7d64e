//! Recordings of pairs as a node writes them.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod replay;
