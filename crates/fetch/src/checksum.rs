//! SHA-256 of files, and what is known about them.

use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::fs::File;
use std::io::{ErrorKind, Read, Result};
use std::path::Path;

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

/// A checksum that grows with the file.
#[derive(Default)]
pub(crate) struct Hash(Sha256);

impl Hash {
    /// Of what is here of a file.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        let mut hash = Self::default();
        let mut file = File::open(path)?;
        let mut buffer = vec![0; 1 << 16];
        loop {
            match file.read(&mut buffer) {
                Ok(0) => return Ok(hash),
                Ok(n) => hash.add(&buffer[..n]),
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
    }

    pub(crate) fn add(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// 64 lower-case hexadecimal digits.
    pub(crate) fn hex(self) -> String {
        let mut text = String::with_capacity(64);
        for byte in self.0.finalize() {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        text
    }
}

/// The checksum that a file in the format of `sha256sum` begins with.
pub(crate) fn recorded(text: &str) -> Option<String> {
    let sum = text.split_whitespace().next()?;
    let digits = sum.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f'));
    (sum.len() == 64 && digits).then(|| sum.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_sha256sum() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let mut hash = Hash::default();
        hash.add(b"ab");
        hash.add(b"c");
        assert_eq!(hash.hex(), abc);
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"abc").unwrap();
        assert_eq!(Hash::of(file.path()).unwrap().hex(), abc);
        assert_eq!(recorded(&format!("{abc}  a.tgz\n")).as_deref(), Some(abc));
        for bad in ["", "banana", &abc[1..], &abc.to_uppercase()] {
            assert_eq!(recorded(bad), None, "{bad}");
        }
    }
}
