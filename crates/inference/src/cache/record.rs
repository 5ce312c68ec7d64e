//! The record beside a model: its origin and checksum.

use serde::{Deserialize, Serialize};
use std::time::{SystemTime, UNIX_EPOCH};
use stillpoint_files::{is_sha256, sha256_hex};

/// Format of a published file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// An ONNX network, kept as it is.
    Onnx,
    /// A PyTorch checkpoint: converted to ONNX, and not kept.
    Checkpoint,
}

/// Origin of a model, stored beside it as `NAME.record.toml`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// SHA-256 of the ONNX file. Filled in by [`Cache::install`](super::Cache::install).
    #[serde(default)]
    pub sha256: String,
    /// Size of the ONNX file, bytes. Filled in by [`Cache::install`](super::Cache::install).
    #[serde(default)]
    pub bytes: u64,
    /// Address of the download, or path of the imported file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// SHA-256 of the file at the source; differs from `sha256` after conversion to ONNX.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source_sha256: Option<String>,
    /// Licence of the weights, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub licence: Option<String>,
    /// Time of installation, UTC: `2026-01-31T12:00:00Z`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub installed: Option<String>,
}

impl Record {
    /// Record of a file with these bytes from `source`, an address or a path.
    #[must_use]
    pub fn of(source: &str, published: &[u8]) -> Self {
        Self {
            source: Some(source.to_owned()),
            source_sha256: Some(sha256_hex(published)),
            ..Self::default()
        }
    }

    /// Whether the ONNX file was converted from another file.
    #[must_use]
    pub fn form(&self) -> Form {
        match &self.source_sha256 {
            Some(source) if *source != self.sha256 => Form::Checkpoint,
            _ => Form::Onnx,
        }
    }

    /// Parses a record; errors are one line.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let record: Self = toml::from_str(text).map_err(|e| one_line(e.message()))?;
        let sound = |sum: &String| is_sha256(sum);
        if sound(&record.sha256) && record.source_sha256.as_ref().is_none_or(sound) {
            Ok(record)
        } else {
            Err("a checksum that is not 64 lower-case hexadecimal digits".to_owned())
        }
    }

    pub(crate) fn to_toml(&self) -> Result<String, String> {
        let text = toml::to_string(self).map_err(|e| one_line(&e.to_string()))?;
        Ok(format!(
            "# Where this model came from. Written by `stillpoint models`.\n{text}"
        ))
    }
}

/// The time now, UTC: `2026-01-31T12:00:00Z`.
#[must_use]
pub fn now() -> String {
    let seconds = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |d| d.as_secs());
    utc(seconds)
}

/// Seconds since 1970 as date and time. The date is Hinnant's `civil_from_days` (<https://howardhinnant.github.io/date_algorithms.html>),
/// for days after 1970.
fn utc(seconds: u64) -> String {
    let days = seconds / 86_400 + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 {
        shifted + 3
    } else {
        shifted - 9
    };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (seconds / 3_600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Joins the lines of other crates' messages.
pub(crate) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_formatted_as_utc() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (951_868_800, "2000-03-01T00:00:00Z"),
            (1_767_225_599, "2025-12-31T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc(seconds), text);
        }
        assert!(now().as_str() > "2025");
    }

    #[test]
    fn record_round_trips() {
        let record = Record {
            sha256: sha256_hex(b"onnx"),
            bytes: 4,
            installed: Some(now()),
            licence: Some("GPL-3.0".to_owned()),
            ..Record::of("a \"quoted\"\n path", b"pt")
        };
        let text = record.to_toml().unwrap();
        assert_eq!(Record::parse(&text).unwrap(), record);
        assert_eq!(record.form(), Form::Checkpoint);
        assert_eq!(record.licence.as_deref(), Some("GPL-3.0"));
    }

    #[test]
    fn damaged_records_are_reported() {
        for (text, part) in [
            ("sha256 = ", "string"),
            ("sha256 = \"12\"", "64"),
            ("colour = \"red\"", "colour"),
            ("bytes = 4", "64"),
            ("\u{0}", ""),
        ] {
            let e = Record::parse(text).unwrap_err();
            assert!(e.contains(part), "{e}");
            assert!(!e.contains('\n'), "{e}");
        }
    }
}
