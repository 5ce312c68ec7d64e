//! Sequential reading of a pickle's bytes.

use crate::import::error::{ImportError, Result, shown};

/// A position in a pickle. Nothing is copied or allocated by a claimed length: missing bytes are an error.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    pub(super) fn at(&self) -> usize {
        self.at
    }

    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        match rest.get(..length) {
            Some(taken) => {
                self.at += length;
                Ok(taken)
            }
            None => Err(self.fault(
                "the value to end within the pickle",
                format!("{length} bytes announced, {} left", rest.len()),
            )),
        }
    }

    pub(super) fn byte(&mut self) -> Result<u8> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    /// A length of `N` bytes, little endian.
    pub(super) fn length<const N: usize>(&mut self) -> Result<usize> {
        let mut wide = [0; 8];
        wide[..N].copy_from_slice(&self.array::<N>()?);
        // A length that does not fit is larger than the pickle; `take` reports it.
        Ok(usize::try_from(u64::from_le_bytes(wide)).unwrap_or(usize::MAX))
    }

    pub(super) fn text(&mut self, length: usize) -> Result<&'a str> {
        let at = self.at;
        let bytes = self.take(length)?;
        std::str::from_utf8(bytes).map_err(|_| ImportError::Pickle {
            at,
            expected: "text in UTF-8",
            found: "other bytes".to_owned(),
        })
    }

    /// Text up to the end of the line.
    pub(super) fn line(&mut self) -> Result<&'a str> {
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(|&b| b == b'\n');
        let length =
            length.ok_or_else(|| self.fault("a line", "the end of the pickle".to_owned()))?;
        let text = self.text(length)?;
        self.at += 1;
        Ok(text)
    }

    /// An integer of this many bytes, two's complement, little endian; `None` above 64 bits.
    pub(super) fn long(&mut self, length: usize) -> Result<Option<i64>> {
        let bytes = self.take(length)?;
        if length > 8 {
            return Ok(None);
        }
        let sign = bytes.last().is_some_and(|b| b & 0x80 != 0);
        let mut wide = if sign { [0xff; 8] } else { [0; 8] };
        wide[..length].copy_from_slice(bytes);
        Ok(Some(i64::from_le_bytes(wide)))
    }

    pub(super) fn fault(&self, expected: &'static str, found: String) -> ImportError {
        ImportError::Pickle {
            at: self.at,
            expected,
            found: shown(&found),
        }
    }
}
