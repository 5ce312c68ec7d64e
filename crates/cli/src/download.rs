//! Downloads as the user sees them.

use crate::console::{self, Unit};
use stillpoint::fetch::Checksum;

/// Bytes as megabytes.
pub(crate) fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

/// Where a file came from, and how much of it came now.
pub(crate) fn came(transferred: u64, resumed: u64, url: &str) -> String {
    match (transferred, resumed) {
        (0, _) => "it was here".to_owned(),
        (bytes, 0) => format!("{} from {url}", megabytes(bytes)),
        (bytes, before) => format!(
            "{} from {url}, after {} that were here",
            megabytes(bytes),
            megabytes(before)
        ),
    }
}

/// What is known about a checksum.
pub(crate) fn about(checksum: Checksum) -> &'static str {
    match checksum {
        Checksum::Verified => "as published",
        Checksum::Recorded => {
            "none is published: it was recorded, and later downloads will be compared with it"
        }
        Checksum::MatchesRecord => "none is published: the same as that of the first download",
    }
}

/// How far it is.
#[derive(Default)]
pub(crate) struct Bar {
    shown: Option<console::Progress>,
}

impl Bar {
    /// Bytes that are here, of all where their number is known. `resumed` were here before.
    pub(crate) fn receiving(&mut self, received: u64, total: Option<u64>, resumed: u64) {
        let bar = self.shown.get_or_insert_with(|| {
            if resumed > 0 {
                console::info(&format!("going on after {}", megabytes(resumed)));
            }
            console::Progress::of(Unit::Bytes, total.map(count), count(resumed))
        });
        bar.show(count(received), "");
    }

    /// Removes it.
    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.shown.take() {
            bar.finish();
        }
    }
}

fn count(bytes: u64) -> usize {
    usize::try_from(bytes).unwrap_or(usize::MAX)
}
