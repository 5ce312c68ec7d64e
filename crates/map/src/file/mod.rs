//! The map as bytes, and back.
//!
//! Answers: what a map file holds, whether bytes are one, and whether they describe a map that can be used. Reads and writes
//! no files: `docs/map-file.md` describes the format and the rules for programs that write it to a disk.
//!
//! What is stored: everything that cannot be computed again bit for bit. The inverse index, the counts of observers and the
//! buckets of each keyframe are computed again.

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

/// Bytes that others keep with a map: a trajectory, calibrated delays. The map does not know what they mean.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Extension {
    /// Its name, 1 to 255 bytes, which no other extension of the file has.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// What a map file holds.
#[derive(Debug)]
pub struct MapFile {
    /// Version of the format that it has.
    pub format: u32,
    /// The map; [`Map::check`] holds.
    pub map: Map,
    /// What others keep with it, in the order in which it was written.
    pub extensions: Vec<Extension>,
}

impl MapFile {
    /// Bytes at the beginning of every map file, in every version, that say what it is.
    pub const HEADER_BYTES: usize = container::HEADER;

    /// Reads the length of a map file from its first [`MapFile::HEADER_BYTES`] bytes, so that what is none need not be read
    /// to its end.
    ///
    /// # Errors
    /// [`MapFileError`] when no map file that can be read begins like this.
    pub fn length(begin: &[u8]) -> Result<u64, MapFileError> {
        container::read_header(begin).map(|header| header.length)
    }

    /// Reads a map file.
    ///
    /// # Errors
    /// [`MapFileError`] when the bytes are damaged, of a later version, no map file, or no map that can be used. Whatever the
    /// bytes are, it takes memory and time in proportion to their length.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MapFileError> {
        let (header, sections) = container::read(bytes)?;
        let split = sections.iter().position(|s| s.kind == Kind::Extension);
        let (own, others) = sections.split_at(split.unwrap_or(sections.len()));
        let mut map = decode::map(own, bytes.len())?;
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

    /// Picks an extension by its name.
    #[must_use]
    pub fn extension(&self, name: &str) -> Option<&[u8]> {
        let found = self.extensions.iter().find(|e| e.name == name)?;
        Some(&found.bytes)
    }
}

impl Map {
    /// The map and `extensions` as the bytes of a map file. The same map gives the same bytes.
    ///
    /// # Errors
    /// [`MapFileError`] when the map is one that [`MapFile::from_bytes`] would refuse, or the name of an extension is empty,
    /// too long, given twice, or that of the map's own (`stillpoint/loops`): what cannot be read must not take the place of an older file.
    pub fn to_bytes(&self, extensions: &[Extension]) -> Result<Vec<u8>, MapFileError> {
        validate::names(extensions)?;
        validate::free(extensions)?;
        // Without the length of the file, which only adds to what is allowed.
        validate::check(self, 0)?;
        let mut sections = encode::sections(self)?;
        // In front of those of others, whose order is theirs.
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

    /// Writes [`Map::to_bytes`] somewhere.
    ///
    /// # Errors
    /// Those of `out`, and [`io::ErrorKind::InvalidData`] with a [`MapFileError`] inside, before anything is written.
    pub fn write(&self, out: &mut impl io::Write, extensions: &[Extension]) -> io::Result<()> {
        let bytes = self
            .to_bytes(extensions)
            .map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))?;
        out.write_all(&bytes)
    }

    /// The map of a map file, without its extensions.
    ///
    /// # Errors
    /// As [`MapFile::from_bytes`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MapFileError> {
        MapFile::from_bytes(bytes).map(|file| file.map)
    }
}
