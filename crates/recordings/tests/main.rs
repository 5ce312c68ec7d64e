//! Tests of the public interface.
#![allow(missing_docs, clippy::unwrap_used)]

mod files;
#[cfg(feature = "sqlite")]
mod sqlite;
mod writers;
