//! Errors of reading and writing map files.

use crate::Violation;

/// A problem of a map file, or of a map to be written. Messages state the expectation, the finding, the place and
/// the remedy.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MapFileError {
    /// Wrong magic bytes.
    Foreign {
        /// The first bytes, at most eight.
        found: Vec<u8>,
    },
    /// The file was written by a later version of the program.
    Newer {
        /// Its version.
        found: u32,
        /// The latest readable version.
        supported: u32,
    },
    /// The length differs from the one stated in the file.
    Length {
        /// Stated length, bytes.
        expected: u64,
        /// Actual length, bytes.
        found: u64,
    },
    /// A checksum does not match: the file is damaged.
    Checksum {
        /// The part of the file.
        section: String,
        /// The stored checksum.
        expected: u32,
        /// The computed checksum.
        found: u32,
    },
    /// The file is undamaged but its content is not a valid map.
    Invalid {
        /// The part of the file.
        section: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
    /// The sections are valid, but together they violate an invariant of maps.
    Unsound(Violation),
}

impl MapFileError {
    pub(super) fn invalid(
        section: &str,
        expected: impl Into<String>,
        found: impl std::fmt::Display,
    ) -> Self {
        Self::Invalid {
            section: section.into(),
            expected: expected.into(),
            found: found.to_string(),
        }
    }
}

impl std::fmt::Display for MapFileError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Foreign { found } => write!(
                f,
                "expected a map file, which begins with \"{}\", found \"{}\" at byte 0: it is another kind of file, or was sent as text; give a file that --save-map wrote",
                super::container::MAGIC.escape_ascii(),
                found.escape_ascii()
            ),
            Self::Newer { found, supported } => write!(
                f,
                "expected a map file of version {supported} or earlier, found version {found} at byte 8: a later version of this program wrote it; use that, or make the map again"
            ),
            Self::Length { expected, found } => write!(
                f,
                "expected a map file of {expected} bytes, as byte 16 says, found {found}: {}; copy it again, or make the map again",
                if found < expected {
                    "its end is missing"
                } else {
                    "something was added at its end"
                }
            ),
            Self::Checksum {
                section,
                expected,
                found,
            } => write!(
                f,
                "expected checksum {expected:08x} in {section}, found {found:08x}: the file was damaged after it was written; copy it again, or make the map again"
            ),
            Self::Invalid {
                section,
                expected,
                found,
            } => write!(
                f,
                "expected {expected} in {section}, found {found}: this is no map that this program can use; make it again"
            ),
            Self::Unsound(violation) => write!(
                f,
                "expected a map whose parts agree, found that this {violation}: this is no map that this program can use; make it again"
            ),
        }
    }
}

impl std::error::Error for MapFileError {}

impl From<Violation> for MapFileError {
    fn from(violation: Violation) -> Self {
        Self::Unsound(violation)
    }
}
