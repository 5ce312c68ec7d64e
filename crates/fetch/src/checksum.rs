//! What is known about checksums.

use stillpoint_files::is_sha256;

/// What is known about a published file's checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checksum {
    /// It is the one that is known.
    Verified,
    /// None is known: that of this first download was recorded, and later ones will be compared with it.
    Recorded,
    /// None is known, and it is that of the first download.
    MatchesRecord,
}

impl Checksum {
    /// That of a file whose checksum is known or not, and was recorded before or not.
    #[must_use]
    pub fn of(known: Option<&str>, recorded: bool) -> Self {
        match (known, recorded) {
            (Some(_), _) => Self::Verified,
            (None, true) => Self::MatchesRecord,
            (None, false) => Self::Recorded,
        }
    }
}

/// The checksum that a file in the format of `sha256sum` begins with.
#[must_use]
pub fn recorded(text: &str) -> Option<String> {
    let sum = text.split_whitespace().next()?;
    is_sha256(sum).then(|| sum.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_sha256sum() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(recorded(&format!("{abc}  a.tgz\n")).as_deref(), Some(abc));
        for bad in ["", "banana", &abc[1..], &abc.to_uppercase()] {
            assert_eq!(recorded(bad), None, "{bad}");
        }
    }
}
