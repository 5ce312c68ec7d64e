//! Downloads published files: resumes interrupted downloads, compares checksums, and unpacks archives.
//!
//! Answers: how to obtain a complete file. Does not know its content: that is up to the callers (crate `models`, the command line's data
//! sets).

mod address;
pub mod archive;
mod checksum;
mod disk;
mod download;
mod error;
mod http;
mod part;
mod tls;

pub use address::shown as shown_address;
pub use checksum::{Checksum, recorded};
pub use disk::{Disk, RealDisk};
pub use download::{Fetched, Progress, Waits, Wanted, Watch, fetch};
pub use error::FetchError;
pub use http::page_hint;
pub use part::{Lock, Part};

/// Joins the lines of other crates' messages.
#[must_use]
pub fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
