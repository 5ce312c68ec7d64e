//! Why bytes are no map, or a map cannot become bytes.

use crate::Violation;

/// What is wrong with a map file, or with a map that was to become one. Each message says what was expected, what was
/// found, where, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MapFileError {
    /// The bytes do not begin as a map file does.
    Foreign {
        /// The first bytes, at most eight.
        found: Vec<u8>,
    },
    /// The file was written by a later version of the program.
    Newer {
        /// The version that it states.
        found: u32,
        /// The latest that can be read.
        supported: u32,
    },
    /// The file is longer or shorter than it says.
    Length {
        /// Bytes that it should have.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
    /// Some bits are not the ones that were written.
    Checksum {
        /// The part of the file.
        section: String,
        /// The checksum that was written with it.
        expected: u32,
        /// That of the bytes that are there.
        found: u32,
    },
    /// The bytes are those that were written, but they do not describe a map.
    Invalid {
        /// The part of the file.
        section: String,
        /// What has to be there.
        expected: String,
        /// What is.
        found: String,
    },
    /// The parts are well, but together they break an invariant of maps.
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
