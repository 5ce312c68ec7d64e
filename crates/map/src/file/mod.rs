//! Map files as bytes, and their validation. Performs no file access: `docs/map-file.md` describes the format and rules
//! for programs that write it to a disk.
//!
//! Everything that cannot be recomputed bit for bit is stored. The inverse index, the counts of observers and the
//! feature grids are recomputed.

mod blocks;
mod bytes;
mod container;
mod decode;
mod encode;
mod error;
mod loops;
mod sections;
#[cfg(test)]
mod tests;
mod validate;

use crate::Map;
use container::{Kind, Section};
pub use error::MapFileError;
use std::borrow::Cow;
use std::io;

/// Additional data stored with a map, such as a trajectory or calibrated delays, which the map does not interpret.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Extension {
    /// Its unique name, 1 to 255 bytes.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// Content of a map file.
#[derive(Debug)]
pub struct MapFile {
    /// Version of the format.
    pub format: u32,
    /// The map; [`Map::check`] holds.
    pub map: Map,
    /// Extensions, in the order of the file.
    pub extensions: Vec<Extension>,
}

impl MapFile {
    /// Length of the header of a map file, in every version.
    pub const HEADER_BYTES: usize = container::HEADER;

    /// Reads the length of a map file from its first [`MapFile::HEADER_BYTES`] bytes, to reject other files early.
    ///
    /// # Errors
    /// [`MapFileError`] when the bytes are not the header of a readable map file.
    pub fn length(begin: &[u8]) -> Result<u64, MapFileError> {
        container::read_header(begin).map(|header| header.length)
    }

    /// Reads a map file.
    ///
    /// # Errors
    /// [`MapFileError`] when the bytes are damaged, of a later version, not a map file, or an invalid map. Memory and
    /// time are proportional to the length for any input.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MapFileError> {
        let (header, sections) = container::read(bytes)?;
        let split = sections.iter().position(|s| s.kind == Kind::Extension);
        let (own, others) = sections.split_at(split.unwrap_or(sections.len()));
        let mut map = decode::map((own, header.version), bytes.len())?;
        let mut extensions: Vec<Extension> = Vec::new();
        for section in others {
            if section.kind == Kind::Map {
                let place = "the extensions";
                return Err(MapFileError::invalid(
                    place,
                    "extensions only",
                    section.name,
                ));
            }
            extensions.push(Extension {
                name: section.name.to_owned(),
                bytes: section.bytes()?.into_owned(),
            });
        }
        validate::names(&extensions)?;
        if let Some(at) = extensions.iter().position(|e| e.name == loops::NAME) {
            let edges = loops::from_bytes(&extensions.remove(at).bytes)?;
            map.view.loops = edges.into();
        }
        validate::check(&map, bytes.len())?;
        Ok(Self {
            format: header.version,
            map,
            extensions,
        })
    }

    /// Finds an extension by name.
    #[must_use]
    pub fn extension(&self, name: &str) -> Option<&[u8]> {
        let found = self.extensions.iter().find(|e| e.name == name)?;
        Some(&found.bytes)
    }
}

impl Map {
    /// Encodes the map and `extensions` as a map file, deterministically.
    ///
    /// # Errors
    /// [`MapFileError`] when [`MapFile::from_bytes`] would reject the result, or the name of an extension is empty, too
    /// long, duplicate, or reserved (`stillpoint/loops`): an unreadable file must not replace an older one.
    pub fn to_bytes(&self, extensions: &[Extension]) -> Result<Vec<u8>, MapFileError> {
        validate::names(extensions)?;
        validate::free(extensions)?;
        // Length 0 gives the strictest limits.
        validate::check(self, 0)?;
        let mut sections = encode::sections(self)?;
        // First, since the order of the others is up to the caller.
        sections.extend(loops::to_bytes(self).map(|bytes| Section {
            kind: Kind::Extension,
            name: loops::NAME,
            bytes: Cow::Owned(bytes),
            compress: false,
        }));
        sections.extend(extensions.iter().map(|e| Section {
            kind: Kind::Extension,
            name: &e.name,
            bytes: Cow::Borrowed(&e.bytes),
            compress: true,
        }));
        Ok(container::write(&sections))
    }

    /// Writes [`Map::to_bytes`] to `out`.
    ///
    /// # Errors
    /// Those of `out`, and [`io::ErrorKind::InvalidData`] containing a [`MapFileError`], before anything is written.
    pub fn write(&self, out: &mut impl io::Write, extensions: &[Extension]) -> io::Result<()> {
        let bytes = self
            .to_bytes(extensions)
            .map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))?;
        out.write_all(&bytes)
    }

    /// Reads the map of a map file, without extensions.
    ///
    /// # Errors
    /// As [`MapFile::from_bytes`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MapFileError> {
        MapFile::from_bytes(bytes).map(|file| file.map)
    }
}
