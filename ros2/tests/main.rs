//! Recordings of pairs as a node writes them, and what strangers can do.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod replay;
mod strangers;
