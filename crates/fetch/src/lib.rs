//! Published files onto the disk: resumed after whatever broke them off, compared with their checksums, and unpacked where they are archives.
//!
//! Answers: how a file gets here whole. Does not know what is in it: that is the business of who asks for it (crate `models`, the
//! command line's data sets).

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

/// Messages of other crates on one line.
#[must_use]
pub fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
