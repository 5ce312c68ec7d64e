//! Primitive values, strings and sequences in both serialisations, read within bounds.
//!
//! CDR: OMG DDS-XTYPES 1.3, section 7.4 (XCDR version 1, plain). ROS 1: <https://wiki.ros.org/msg>, little-endian, without padding.

use std::borrow::Cow;

/// Serialisation of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// CDR of ROS 2, little-endian. A reader takes the byte order from the encapsulation header, and treats this and the next alike.
    CdrLittleEndian,
    /// CDR of ROS 2, big-endian.
    CdrBigEndian,
    /// ROS 1.
    Ros1,
}

/// Error: bytes are not a message of the expected type. Offsets are in bytes from the message's first.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// A value extends beyond the end.
    #[error("expected {needed} bytes at byte {at}, found {left}")]
    Short {
        /// Offset of the value.
        at: usize,
        /// Bytes needed.
        needed: usize,
        /// Bytes left.
        left: usize,
    },
    /// Not the encapsulation of plain CDR.
    #[error("expected an encapsulation header of plain CDR (00 00 or 00 01), found {found:02x?}")]
    Encapsulation {
        /// The first two bytes.
        found: [u8; 2],
    },
    /// A CDR string without its final zero byte.
    #[error("expected a zero byte at the end of the string at byte {at}")]
    Unterminated {
        /// Offset of the string.
        at: usize,
    },
    /// One of the above, with its place in the message.
    #[error("{message}, field {field}: {reason}")]
    InField {
        /// The message, by its name in ROS 2.
        message: &'static str,
        /// Path to the field: `poses[3].header.stamp`.
        field: String,
        /// The error.
        reason: Box<WireError>,
    },
}

impl WireError {
    /// The error without the place.
    #[must_use]
    pub fn reason(&self) -> &Self {
        match self {
            Self::InField { reason, .. } => reason.reason(),
            other => other,
        }
    }

    /// The same error within a field of an enclosing message.
    #[cold]
    pub(crate) fn within(self, message: &'static str, field: &str) -> Self {
        let (inner, reason) = self.split();
        let field = field.trim_start_matches("r#");
        let dot = if inner.is_empty() || inner.starts_with('[') {
            ""
        } else {
            "."
        };
        let field = format!("{field}{dot}{inner}");
        Self::InField {
            message,
            field,
            reason,
        }
    }

    /// The same error within an element of a sequence.
    #[cold]
    fn of_element(self, index: usize) -> Self {
        self.within("", &format!("[{index}]"))
    }

    fn split(self) -> (String, Box<Self>) {
        match self {
            Self::InField { field, reason, .. } => (field, reason),
            other => (String::new(), Box::new(other)),
        }
    }
}

/// Reads values sequentially.
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    format: Format,
}

/// Length of CDR's encapsulation header; alignment counts from its end.
const ENCAPSULATION: usize = 4;

impl<'a> Reader<'a> {
    /// A reader at the first value of a message.
    ///
    /// # Errors
    /// CDR without the header of plain CDR.
    pub fn new(bytes: &'a [u8], format: Format) -> Result<Self, WireError> {
        let mut reader = Self {
            bytes,
            at: 0,
            format,
        };
        if format != Format::Ros1 {
            let header = reader.take(ENCAPSULATION)?;
            reader.format = match [header[0], header[1]] {
                [0, 0] => Format::CdrBigEndian,
                [0, 1] => Format::CdrLittleEndian,
                found => return Err(WireError::Encapsulation { found }),
            };
        }
        Ok(reader)
    }

    /// The serialisation, with the byte order stated in the header.
    #[must_use]
    pub fn format(&self) -> Format {
        self.format
    }

    fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take(&mut self, needed: usize) -> Result<&'a [u8], WireError> {
        let (at, left) = (self.at, self.left());
        if needed > left {
            return Err(WireError::Short { at, needed, left });
        }
        self.at += needed;
        Ok(&self.bytes[at..at + needed])
    }

    /// The bytes of a number, in little-endian order. CDR aligns numbers to their size.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        if self.format != Format::Ros1 {
            self.take(padding(self.at - ENCAPSULATION, N))?;
        }
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if self.format == Format::CdrBigEndian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// The number of elements of a sequence, each of at least one byte.
    fn length(&mut self) -> Result<usize, WireError> {
        let needed = u32::from_le_bytes(self.number()?) as usize;
        let (at, left) = (self.at, self.left());
        if needed > left {
            return Err(WireError::Short { at, needed, left });
        }
        Ok(needed)
    }
}

/// Writes values sequentially.
#[derive(Debug)]
pub struct Writer {
    bytes: Vec<u8>,
    format: Format,
}

impl Writer {
    /// The serialisation.
    #[must_use]
    pub fn format(&self) -> Format {
        self.format
    }

    fn number<const N: usize>(&mut self, mut bytes: [u8; N]) {
        if self.format != Format::Ros1 {
            let padding = padding(self.bytes.len() - ENCAPSULATION, N);
            self.bytes.resize(self.bytes.len() + padding, 0);
        }
        if self.format == Format::CdrBigEndian {
            bytes.reverse();
        }
        self.bytes.extend_from_slice(&bytes);
    }

    /// No message written here comes near 2^32 elements; a longer one would be truncated rather than misread.
    fn length(&mut self, length: usize) -> usize {
        let length = u32::try_from(length).unwrap_or(u32::MAX);
        self.number(length.to_le_bytes());
        length as usize
    }
}

/// Bytes from `at` to the next multiple of `size`.
fn padding(at: usize, size: usize) -> usize {
    at.next_multiple_of(size) - at
}

/// A type that can be read and written.
pub trait Wire<'a>: Sized {
    /// Reads a value.
    ///
    /// # Errors
    /// Bytes that are not of this type.
    fn read(from: &mut Reader<'a>) -> Result<Self, WireError>;
    /// Writes a value.
    fn write(&self, to: &mut Writer);
}

/// Reads a message. Trailing bytes are ignored: writers of CDR may pad.
///
/// # Errors
/// Bytes that are not of this type.
pub fn from_bytes<'a, T: Wire<'a>>(bytes: &'a [u8], format: Format) -> Result<T, WireError> {
    T::read(&mut Reader::new(bytes, format)?)
}

/// Writes a message.
#[must_use]
pub fn to_bytes<'a, T: Wire<'a>>(message: &T, format: Format) -> Vec<u8> {
    let bytes = match format {
        Format::CdrLittleEndian => vec![0, 1, 0, 0],
        Format::CdrBigEndian => vec![0; ENCAPSULATION],
        Format::Ros1 => Vec::new(),
    };
    let mut writer = Writer { bytes, format };
    message.write(&mut writer);
    writer.bytes
}

macro_rules! numbers {
    ($($type:ty),*) => {$(
        impl Wire<'_> for $type {
            fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
                from.number().map(<$type>::from_le_bytes)
            }
            fn write(&self, to: &mut Writer) {
                to.number(self.to_le_bytes());
            }
        }
    )*};
}
numbers!(u8, i8, u16, i16, u32, i32, u64, i64, f32, f64);

/// One byte; any non-zero value is true.
impl Wire<'_> for bool {
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        u8::read(from).map(|byte| byte != 0)
    }

    fn write(&self, to: &mut Writer) {
        u8::from(*self).write(to);
    }
}

/// Text that is not UTF-8 is read with replacement characters: a misspelt name is no reason to lose an image.
impl<'a> Wire<'a> for Cow<'a, str> {
    fn read(from: &mut Reader<'a>) -> Result<Self, WireError> {
        let length = from.length()?;
        let at = from.at;
        let mut bytes = from.take(length)?;
        // Some writers of CDR give empty strings no terminator.
        if from.format != Format::Ros1 && length > 0 {
            let terminated = bytes.strip_suffix(&[0]);
            bytes = terminated.ok_or(WireError::Unterminated { at })?;
        }
        Ok(String::from_utf8_lossy(bytes))
    }

    fn write(&self, to: &mut Writer) {
        let terminator: &[u8] = if to.format == Format::Ros1 { &[] } else { &[0] };
        to.length(self.len() + terminator.len());
        to.bytes.extend_from_slice(self.as_bytes());
        to.bytes.extend_from_slice(terminator);
    }
}

impl<'a> Wire<'a> for Cow<'a, [u8]> {
    fn read(from: &mut Reader<'a>) -> Result<Self, WireError> {
        let length = from.length()?;
        from.take(length).map(Cow::Borrowed)
    }

    fn write(&self, to: &mut Writer) {
        let length = to.length(self.len());
        to.bytes.extend_from_slice(&self[..length]);
    }
}

/// Grows as elements are read: a length alone reserves nothing.
impl<'a, T: Wire<'a>> Wire<'a> for Vec<T> {
    fn read(from: &mut Reader<'a>) -> Result<Self, WireError> {
        let length = from.length()?;
        let element = |i| T::read(from).map_err(|e| e.of_element(i));
        (0..length).map(element).collect()
    }

    fn write(&self, to: &mut Writer) {
        let length = to.length(self.len());
        self[..length].iter().for_each(|element| element.write(to));
    }
}

impl<'a, T: Wire<'a> + Copy + Default, const N: usize> Wire<'a> for [T; N] {
    fn read(from: &mut Reader<'a>) -> Result<Self, WireError> {
        let mut array = [T::default(); N];
        for element in &mut array {
            *element = T::read(from)?;
        }
        Ok(array)
    }

    fn write(&self, to: &mut Writer) {
        self.iter().for_each(|element| element.write(to));
    }
}
