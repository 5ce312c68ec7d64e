//! Files that are written whole or not at all, and checksums of files.
//!
//! Answers: how bytes get under their name without a half file ever having it, and whether they are the ones that were written. Does not know what is in a file.

mod aside;
mod digest;
mod write;

pub use aside::{Aside, sync_folder};
pub use digest::{Digest, is_sha256, sha256_hex};
pub use write::{AtomicFile, write_atomic};
