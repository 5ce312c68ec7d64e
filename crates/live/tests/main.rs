//! Threads, queues and what a live run leaves.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod live;
