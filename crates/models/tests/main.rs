//! Downloads and the import of checkpoints.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod import;
mod pull;
mod pull_checkpoint;
mod pull_content;
mod pull_faults;
#[cfg(feature = "pull")]
mod pull_support;
