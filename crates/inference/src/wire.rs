//! The wire format of Protocol Buffers, as far as ONNX files need it: fields are read in place, and messages are built field by field. A
//! library generated from ONNX's schema would lose unknown fields when a model is written back.

/// One field of a message, borrowed from its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field<'a> {
    /// Field number in the schema.
    pub number: u64,
    /// Its value.
    pub value: Value<'a>,
    /// The encoded field with its tag.
    pub raw: &'a [u8],
}

/// Value of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value<'a> {
    /// Integers, booleans and enumerations.
    Varint(u64),
    /// Eight bytes, little endian.
    Fixed64([u8; 8]),
    /// Text, bytes, packed numbers and messages.
    Bytes(&'a [u8]),
    /// Four bytes, little endian.
    Fixed32([u8; 4]),
}

impl<'a> Value<'a> {
    /// The bytes of a text or message.
    #[must_use]
    pub fn bytes(self) -> Option<&'a [u8]> {
        match self {
            Self::Bytes(bytes) => Some(bytes),
            _ => None,
        }
    }

    /// The text, if it is one.
    #[must_use]
    pub fn text(self) -> Option<&'a str> {
        self.bytes().and_then(|b| std::str::from_utf8(b).ok())
    }

    /// The integer, if it is one.
    #[must_use]
    pub fn integer(self) -> Option<u64> {
        match self {
            Self::Varint(value) => Some(value),
            _ => None,
        }
    }
}

/// Error: a message is damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// A field extends beyond the message.
    #[error("a field at byte {at} that does not end within its {length} bytes")]
    Cut {
        /// Offset of the field.
        at: usize,
        /// Length of the message.
        length: usize,
    },
    /// An unknown wire type.
    #[error("no field of Protocol Buffers at byte {at}")]
    Tag {
        /// Offset of the field.
        at: usize,
    },
    /// Too many items.
    #[error("over {most} {what}")]
    Many {
        /// Kind of the items.
        what: &'static str,
        /// The limit.
        most: usize,
    },
}

/// The fields of a message, in order. Ends after the first error.
pub fn fields(message: &[u8]) -> impl Iterator<Item = Result<Field<'_>, WireError>> {
    let mut rest = message;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let start = rest;
        let at = message.len() - start.len();
        let cut = WireError::Cut {
            at,
            length: message.len(),
        };
        let field = take(&mut rest, at, cut).map(|(number, value)| Field {
            number,
            value,
            raw: &start[..start.len() - rest.len()],
        });
        if field.is_err() {
            rest = &[];
        }
        Some(field)
    })
}

/// The last text with this number in a message.
///
/// # Errors
/// Damaged fields before its end.
pub fn text(message: &[u8], number: u64) -> Result<Option<&str>, WireError> {
    let mut found = None;
    for field in fields(message) {
        let field = field?;
        if let (true, Some(text)) = (field.number == number, field.value.text()) {
            found = Some(text);
        }
    }
    Ok(found)
}

/// Packed integers; `None` if the last one is truncated.
#[must_use]
pub fn varints(packed: &[u8]) -> Option<Vec<u64>> {
    let (mut rest, mut values) = (packed, Vec::new());
    while !rest.is_empty() {
        values.push(varint(&mut rest)?);
    }
    Some(values)
}

fn take<'a>(rest: &mut &'a [u8], at: usize, cut: WireError) -> Result<(u64, Value<'a>), WireError> {
    let tag = varint(rest).ok_or(cut)?;
    let value = match tag & 7 {
        0 => varint(rest).map(Value::Varint),
        1 => array(rest).map(Value::Fixed64),
        2 => varint(rest)
            .and_then(|n| usize::try_from(n).ok())
            .and_then(|n| rest.split_at_checked(n))
            .map(|(bytes, after)| {
                *rest = after;
                Value::Bytes(bytes)
            }),
        5 => array(rest).map(Value::Fixed32),
        _ => return Err(WireError::Tag { at }),
    };
    Ok((tag >> 3, value.ok_or(cut)?))
}

fn array<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let (bytes, after) = rest.split_first_chunk()?;
    *rest = after;
    Some(*bytes)
}

/// Splits off a varint; `None` if it does not end within ten bytes.
fn varint(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for (i, &byte) in rest.iter().take(10).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * i);
        if byte < 0x80 {
            *rest = &rest[i + 1..];
            return Some(value);
        }
    }
    None
}

/// A message, built field by field.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Message {
    bytes: Vec<u8>,
}

impl Message {
    /// Without fields.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an integer, boolean or enumeration. Negative ones are given in two's complement (`-1_i64 as u64`).
    #[must_use]
    pub fn integer(mut self, number: u64, value: u64) -> Self {
        self.varint(number << 3);
        self.varint(value);
        self
    }

    /// Adds a 32-bit float.
    #[must_use]
    pub fn float(mut self, number: u64, value: f32) -> Self {
        self.varint(number << 3 | 5);
        self.bytes.extend(value.to_le_bytes());
        self
    }

    /// Adds text, bytes or packed numbers.
    #[must_use]
    pub fn field(mut self, number: u64, value: impl AsRef<[u8]>) -> Self {
        let value = value.as_ref();
        self.varint(number << 3 | 2);
        self.varint(value.len() as u64);
        self.bytes.extend_from_slice(value);
        self
    }

    /// Adds a message.
    #[must_use]
    pub fn message(self, number: u64, value: &Self) -> Self {
        self.field(number, &value.bytes)
    }

    /// Adds a field of another message unchanged.
    #[must_use]
    pub fn raw(mut self, field: &Field<'_>) -> Self {
        self.bytes.extend_from_slice(field.raw);
        self
    }

    /// The bytes.
    #[must_use]
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.bytes.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.bytes.push(value as u8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample() -> Vec<u8> {
        Message::new()
            .integer(1, 300)
            .field(2, "text")
            .float(3, 0.5)
            .message(4, &Message::new().integer(1, u64::MAX))
            .into_bytes()
    }

    #[test]
    fn message_fields_round_trip() {
        let bytes = sample();
        let read: Vec<Field<'_>> = fields(&bytes).map(Result::unwrap).collect();
        let numbers: Vec<u64> = read.iter().map(|f| f.number).collect();
        assert_eq!(numbers, [1, 2, 3, 4]);
        assert_eq!(read[0].value.integer(), Some(300));
        assert_eq!(read[1].value.text(), Some("text"));
        assert_eq!(read[2].value, Value::Fixed32(0.5_f32.to_le_bytes()));
        let inner = fields(read[3].value.bytes().unwrap()).next().unwrap();
        assert_eq!(inner.unwrap().value.integer(), Some(u64::MAX));
        let copy = read.iter().fold(Message::new(), Message::raw);
        assert_eq!(copy.into_bytes(), bytes);
        assert_eq!(text(&bytes, 2), Ok(Some("text")));
        assert_eq!(text(&bytes, 1), Ok(None));
    }

    #[test]
    fn packed_integers_are_read() {
        assert_eq!(varints(&[1, 0xac, 2, 0]), Some(vec![1, 300, 0]));
        assert_eq!(varints(&[]), Some(vec![]));
        assert_eq!(varints(&[1, 0xac]), None);
    }

    #[test]
    fn overflowing_lengths_are_refused() {
        let mut bytes = vec![0x08, 7, 0x3a];
        bytes.extend([0xff; 9]);
        bytes.push(1);
        let read: Vec<_> = fields(&bytes).collect();
        assert_eq!(read.len(), 2);
        assert_eq!(read[1], Err(WireError::Cut { at: 2, length: 13 }));
        assert_eq!(fields(&[0x0f]).next(), Some(Err(WireError::Tag { at: 0 })));
    }

    proptest! {
        /// Reading terminates for any bytes, and the fields are contiguous.
        #[test]
        fn reading_terminates_for_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let read: Vec<_> = fields(&bytes).collect();
            let length: usize = read.iter().flatten().map(|f| f.raw.len()).sum();
            prop_assert!(length <= bytes.len());
            prop_assert!(length == bytes.len() || read.last().is_some_and(Result::is_err));
        }

        /// Truncation within a field is detected.
        #[test]
        fn truncation_within_a_field_is_detected(keep in 0_usize..100) {
            let bytes = sample();
            let ends: Vec<usize> = fields(&bytes).map(Result::unwrap).scan(0, |end, f| {
                *end += f.raw.len();
                Some(*end)
            }).collect();
            let keep = keep % bytes.len();
            let whole = keep == 0 || ends.contains(&keep);
            prop_assert_eq!(fields(&bytes[..keep]).all(|f| f.is_ok()), whole);
        }
    }
}
