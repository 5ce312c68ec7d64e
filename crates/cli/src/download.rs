//! Progress and messages of downloads.

use crate::console::{self, Unit};
use stillpoint::fetch::Checksum;

pub(crate) fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

/// The source of a file, and how much of it was transferred this time.
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

/// Describes how a checksum was verified.
pub(crate) fn about(checksum: Checksum) -> &'static str {
    match checksum {
        Checksum::Verified => "as published",
        Checksum::Recorded => {
            "none is published: it was recorded, and later downloads will be compared with it"
        }
        Checksum::MatchesRecord => "none is published: the same as that of the first download",
    }
}

#[derive(Default)]
pub(crate) struct Bar {
    shown: Option<console::Progress>,
}

impl Bar {
    /// Bytes received, and in total if known. `resumed` of them came from an earlier download.
    pub(crate) fn receiving(&mut self, received: u64, total: Option<u64>, resumed: u64) {
        let bar = self.shown.get_or_insert_with(|| {
            if resumed > 0 {
                console::info(&format!("going on after {}", megabytes(resumed)));
            }
            console::Progress::of(Unit::Bytes, total.map(count), count(resumed))
        });
        bar.show(count(received), "");
    }

    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.shown.take() {
            bar.finish();
        }
    }
}

fn count(bytes: u64) -> usize {
    usize::try_from(bytes).unwrap_or(usize::MAX)
}
