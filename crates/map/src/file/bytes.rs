//! Little-endian encoding of numbers, single or in columns.
//!
//! A column is written in planes: the first bytes of all its numbers, then all second bytes, and so on. Exponents and
//! high bytes, which vary little, are then adjacent and compress well, separate from noisy low bits.

use super::MapFileError;

#[derive(Default)]
pub(super) struct Writer {
    pub(super) bytes: Vec<u8>,
}

impl Writer {
    pub(super) fn u32(&mut self, value: u32) {
        self.bytes.extend(value.to_le_bytes());
    }

    pub(super) fn u64(&mut self, value: u64) {
        self.bytes.extend(value.to_le_bytes());
    }

    pub(super) fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    pub(super) fn column32(&mut self, values: impl Iterator<Item = u32>) {
        self.planes(values.map(u32::to_le_bytes).collect());
    }

    pub(super) fn column64(&mut self, values: impl Iterator<Item = u64>) {
        self.planes(values.map(u64::to_le_bytes).collect());
    }

    fn planes<const N: usize>(&mut self, values: Vec<[u8; N]>) {
        self.bytes.reserve(N * values.len());
        for plane in 0..N {
            self.bytes.extend(values.iter().map(|v| v[plane]));
        }
    }
}

/// Reads numbers from a section. Nothing is allocated before the bytes for it are known to exist.
pub(super) struct Reader<'a> {
    section: &'static str,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(section: &'static str, bytes: &'a [u8]) -> Self {
        Self {
            section,
            bytes,
            at: 0,
        }
    }

    pub(super) fn take(&mut self, count: usize, size: usize) -> Result<&'a [u8], MapFileError> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let wanted = count.checked_mul(size).and_then(|n| rest.get(..n));
        let Some(bytes) = wanted else {
            return Err(MapFileError::invalid(
                self.section,
                format!("{count} elements of {size} bytes from byte {} on", self.at),
                format!("{} bytes", rest.len()),
            ));
        };
        self.at += bytes.len();
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], MapFileError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(1, N)?);
        Ok(array)
    }

    pub(super) fn u32(&mut self) -> Result<u32, MapFileError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(super) fn u64(&mut self) -> Result<u64, MapFileError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    pub(super) fn f64(&mut self) -> Result<f64, MapFileError> {
        Ok(f64::from_bits(self.u64()?))
    }

    pub(super) fn column32(&mut self, count: usize) -> Result<Vec<u32>, MapFileError> {
        let bytes = self.take(count, 4)?;
        let plane = |i: usize| &bytes[i * count..(i + 1) * count];
        let (a, b, c, d) = (plane(0), plane(1), plane(2), plane(3));
        Ok((0..count)
            .map(|i| u32::from_le_bytes([a[i], b[i], c[i], d[i]]))
            .collect())
    }

    pub(super) fn floats32(&mut self, count: usize) -> Result<Vec<f32>, MapFileError> {
        let bits = self.column32(count)?;
        Ok(bits.into_iter().map(f32::from_bits).collect())
    }

    pub(super) fn floats64(&mut self, count: usize) -> Result<Vec<f64>, MapFileError> {
        let bytes = self.take(count, 8)?;
        let plane = |p: usize| &bytes[p * count..(p + 1) * count];
        let planes: [&[u8]; 8] = std::array::from_fn(plane);
        Ok((0..count)
            .map(|i| f64::from_le_bytes(std::array::from_fn(|p| planes[p][i])))
            .collect())
    }

    pub(super) fn end(&self) -> Result<(), MapFileError> {
        if self.at == self.bytes.len() {
            return Ok(());
        }
        Err(MapFileError::invalid(
            self.section,
            format!("{} bytes", self.at),
            self.bytes.len(),
        ))
    }
}
