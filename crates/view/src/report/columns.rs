//! Columns of numbers as text: little-endian bytes in base 64, which a browser converts to a typed array.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt::{Display, Formatter};

/// Numbers of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Column<T>(pub Vec<T>);

impl<T> Default for Column<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Column<T> {
    /// Whether it is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Element type of a column.
pub trait Number: Copy {
    /// Appends its bytes.
    fn put(self, bytes: &mut Vec<u8>);
    /// Reads numbers; `None` if bytes are left over.
    fn all(bytes: &[u8]) -> Option<Vec<Self>>;
}

macro_rules! number {
    ($($t:ty),*) => {$(
        impl Number for $t {
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }

            fn all(bytes: &[u8]) -> Option<Vec<Self>> {
                let (each, rest) = bytes.as_chunks::<{ size_of::<$t>() }>();
                rest.is_empty().then(|| each.iter().map(|b| Self::from_le_bytes(*b)).collect())
            }
        }
    )*};
}
number!(u8, u16, u32, f32, f64);

impl<T: Number> Serialize for Column<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&Text(&self.0))
    }
}

/// Number of elements encoded at once: their bytes are a multiple of three, so that base 64 needs no padding.
const TOGETHER: usize = 768;

/// Encodes in pieces, to avoid copies of several megabytes.
struct Text<'a, T>(&'a [T]);

impl<T: Number> Display for Text<'_, T> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let (mut bytes, mut text) = (Vec::new(), String::new());
        for numbers in self.0.chunks(TOGETHER) {
            bytes.clear();
            text.clear();
            numbers.iter().for_each(|n| n.put(&mut bytes));
            STANDARD.encode_string(&bytes, &mut text);
            f.write_str(&text)?;
        }
        Ok(())
    }
}

impl<'de, T: Number> Deserialize<'de> for Column<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let bytes = STANDARD.decode(text).map_err(D::Error::custom)?;
        let numbers = T::all(&bytes);
        numbers.map(Self).ok_or_else(|| {
            D::Error::custom(format!(
                "expected whole numbers of {} bytes, found {} bytes",
                size_of::<T>(),
                bytes.len()
            ))
        })
    }
}

impl<T> FromIterator<T> for Column<T> {
    fn from_iter<I: IntoIterator<Item = T>>(numbers: I) -> Self {
        Self(numbers.into_iter().collect())
    }
}

impl<T> Extend<T> for Column<T> {
    fn extend<I: IntoIterator<Item = T>>(&mut self, numbers: I) {
        self.0.extend(numbers);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn columns_round_trip(a: Vec<f32>, b: Vec<u16>) {
            let text = serde_json::to_string(&(Column(a.clone()), Column(b.clone()))).unwrap();
            let (back, other): (Column<f32>, Column<u16>) = serde_json::from_str(&text).unwrap();
            let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&back.0), bits(&a));
            prop_assert_eq!(other.0, b);
        }
    }

    #[test]
    fn piecewise_encoding_equals_one_text() {
        for count in [0, 1, 767, 768, 769, 2000] {
            let column: Column<u16> = (0..count).map(|i| (i as u16).wrapping_mul(77)).collect();
            let mut bytes = Vec::new();
            column.0.iter().for_each(|n| n.put(&mut bytes));
            let text = serde_json::to_string(&column).unwrap();
            assert_eq!(text, format!("\"{}\"", STANDARD.encode(bytes)), "{count}");
        }
    }

    #[test]
    fn truncated_columns_are_refused() {
        let read = serde_json::from_str::<Column<f32>>;
        assert_eq!(read("\"AACAPw==\"").unwrap().0, [1.0]);
        let error = read("\"AACA\"").unwrap_err().to_string();
        assert!(error.contains("found 3 bytes"), "{error}");
        assert!(read("\"?\"").is_err());
    }
}
