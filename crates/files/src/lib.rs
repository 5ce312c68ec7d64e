//! Atomic file writes, and checksums of files.
//!
//! Answers: how to write a file so that its name never denotes a partial one, and whether its bytes are unchanged. Does not know the
//! content of files.

mod aside;
mod digest;
mod write;

pub use aside::{Aside, sync_folder};
pub use digest::{Digest, is_sha256, sha256_hex};
pub use write::{AtomicFile, write_atomic};
