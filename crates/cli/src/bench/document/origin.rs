//! Where and when a document was made: the commit and the day.

use serde::Serialize;
use std::process::{Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

/// The source and the day of a document.
#[derive(Debug, Serialize)]
pub(crate) struct Origin {
    /// The commit of the working copy that the program is run in, and whether files differ from it; `unknown` outside of one.
    pub(crate) commit: String,
    /// UTC, as in `2026-01-31`.
    pub(crate) date: String,
}

impl Origin {
    /// Of the folder that the program was started in, now.
    pub(crate) fn here() -> Self {
        let seconds = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(0, |d| d.as_secs());
        Self {
            commit: commit(),
            date: date(seconds / 86_400),
        }
    }
}

/// As git tells it. The program does not know what it was built from, but `cargo run` builds it from the folder it is started in.
fn commit() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git")
            .args(arguments)
            .stdin(Stdio::null())
            .output()
            .ok()?;
        let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success().then_some(text)
    };
    match (
        git(&["rev-parse", "--short=12", "HEAD"]),
        git(&["status", "--porcelain", "--untracked-files=no"]),
    ) {
        (Some(commit), Some(changes)) if changes.is_empty() => commit,
        (Some(commit), _) => format!("{commit}, with changes that are not committed"),
        (None, _) => "unknown".to_owned(),
    }
}

/// The date of a day since 1970-01-01 in the Gregorian calendar.
fn date(day: u64) -> String {
    let leap = |y: u64| y.is_multiple_of(4) && (!y.is_multiple_of(100) || y.is_multiple_of(400));
    let (mut year, mut left) = (1970, day);
    while left >= 365 + u64::from(leap(year)) {
        left -= 365 + u64::from(leap(year));
        year += 1;
    }
    let february = 28 + u64::from(leap(year));
    let mut month = 1;
    for days in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if left < days {
            break;
        }
        left -= days;
        month += 1;
    }
    format!("{year}-{month:02}-{:02}", left + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_have_dates() {
        for (day, expected) in [
            (0, "1970-01-01"),
            (58, "1970-02-28"),
            (59, "1970-03-01"),
            (11_016, "2000-02-29"),
            (20_453, "2025-12-31"),
            (20_454, "2026-01-01"),
        ] {
            assert_eq!(date(day), expected);
        }
        assert_eq!(Origin::here().date.len(), 10);
    }
}
