//! SHA-256 of bytes and of files.

use sha2::{Digest as _, Sha256};
use std::fmt::Write;
use std::io::{ErrorKind, Read, Result};

/// An incremental SHA-256.
#[derive(Default)]
pub struct Digest(Sha256);

impl Digest {
    /// Adds bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// Adds all data of a reader, and returns its number of bytes.
    ///
    /// # Errors
    /// Those of the reader.
    pub fn add_all(&mut self, reader: &mut dyn Read) -> Result<u64> {
        let mut buffer = vec![0; 1 << 16];
        let mut bytes = 0;
        loop {
            match reader.read(&mut buffer) {
                Ok(0) => return Ok(bytes),
                Ok(n) => {
                    self.add(&buffer[..n]);
                    bytes += n as u64;
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
    }

    /// 64 lower-case hexadecimal digits.
    #[must_use]
    pub fn hex(self) -> String {
        let mut text = String::with_capacity(64);
        for byte in self.0.finalize() {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        text
    }
}

/// SHA-256 as 64 lower-case hexadecimal digits.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    let mut digest = Digest::default();
    digest.add(bytes);
    digest.hex()
}

/// Whether the text is a checksum in the format of [`Digest::hex`].
#[must_use]
pub fn is_sha256(text: &str) -> bool {
    text.len() == 64 && text.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f'))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples of FIPS 180-2, appendix B.1, and of the empty message.
    #[test]
    fn sha256_matches_known_digests() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(sha256_hex(b"abc"), abc);
        assert_eq!(sha256_hex(b""), empty);
        let mut digest = Digest::default();
        digest.add(b"a");
        assert_eq!(digest.add_all(&mut b"bc".as_slice()).unwrap(), 2);
        assert_eq!(digest.hex(), abc);
        let long = vec![7; 200_000];
        let mut digest = Digest::default();
        assert_eq!(digest.add_all(&mut long.as_slice()).unwrap(), 200_000);
        assert_eq!(digest.hex(), sha256_hex(&long));
        assert!(is_sha256(abc));
        assert!(!is_sha256(&abc.to_uppercase()) && !is_sha256(&abc[1..]) && !is_sha256(""));
    }
}
