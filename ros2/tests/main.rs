//! Recordings of pairs as written by a node, and robustness against forged packets.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod replay;
mod strangers;
