//! Origins of checksums.

use stillpoint_files::is_sha256;

/// Origin of a published file's checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checksum {
    /// It matches the known one.
    Verified,
    /// None is known: that of this first download was recorded, and is compared with later ones.
    Recorded,
    /// None is known, and it matches the first download.
    MatchesRecord,
}

impl Checksum {
    /// For a file with or without a known checksum, and with or without a previous record.
    #[must_use]
    pub fn of(known: Option<&str>, recorded: bool) -> Self {
        match (known, recorded) {
            (Some(_), _) => Self::Verified,
            (None, true) => Self::MatchesRecord,
            (None, false) => Self::Recorded,
        }
    }
}

/// The checksum at the beginning of a file in the format of `sha256sum`.
#[must_use]
pub fn recorded(text: &str) -> Option<String> {
    let sum = text.split_whitespace().next()?;
    is_sha256(sum).then(|| sum.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksum_files_follow_sha256sum() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(recorded(&format!("{abc}  a.tgz\n")).as_deref(), Some(abc));
        for bad in ["", "banana", &abc[1..], &abc.to_uppercase()] {
            assert_eq!(recorded(bad), None, "{bad}");
        }
    }
}
