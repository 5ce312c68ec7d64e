//! Tests of threads, queues and results of live runs.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod live;
