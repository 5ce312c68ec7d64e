//! SHA-256, of bytes at hand and of files.

use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::io::Read;

/// SHA-256 as 64 lower-case hexadecimal digits.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// SHA-256 of what the reader yields, and how many bytes that were.
pub(crate) fn sha256_of(reader: &mut dyn Read) -> std::io::Result<(String, u64)> {
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    let mut bytes = 0;
    loop {
        match reader.read(&mut buffer) {
            Ok(0) => return Ok((hex(&hash.finalize()), bytes)),
            Ok(n) => {
                hash.update(&buffer[..n]);
                bytes += n as u64;
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}

/// Whether the text is a checksum as this crate writes them.
#[must_use]
pub fn is_sha256(text: &str) -> bool {
    text.len() == 64 && text.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f'))
}

fn hex(digest: &[u8]) -> String {
    digest
        .iter()
        .fold(String::with_capacity(64), |mut text, byte| {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
            text
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples of FIPS 180-2, appendix B.1, and of the empty message.
    #[test]
    fn known_digests() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(sha256_hex(b"abc"), abc);
        assert_eq!(sha256_hex(b""), empty);
        assert_eq!(
            sha256_of(&mut b"abc".as_slice()).unwrap(),
            (abc.to_owned(), 3)
        );
        let long = vec![7; 200_000];
        assert_eq!(
            sha256_of(&mut long.as_slice()).unwrap(),
            (sha256_hex(&long), 200_000)
        );
        assert!(is_sha256(abc));
        assert!(!is_sha256(&abc.to_uppercase()) && !is_sha256(&abc[1..]) && !is_sha256(""));
    }
}
