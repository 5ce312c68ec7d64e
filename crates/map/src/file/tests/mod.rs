//! Tests of map files and of damaged ones.

mod damage;
mod made;
mod refused;
mod round_trip;
mod versions;

use crate::file::container::{self, Kind, Section};
use crate::file::sections::Part;
use std::borrow::Cow;

/// A section taken out for modification.
type Raw = (Kind, String, Vec<u8>);

fn taken_apart(bytes: &[u8]) -> Vec<Raw> {
    let (_, sections) = container::read(bytes).unwrap();
    let raw =
        |s: &container::Stored<'_>| (s.kind, s.name.to_owned(), s.bytes().unwrap().into_owned());
    sections.iter().map(raw).collect()
}

/// The sections with correct checksums.
fn sealed(raw: &[Raw], compress: bool) -> Vec<u8> {
    let section = |(kind, name, bytes): &'_ Raw| -> Section<'static> {
        let part = Part::ALL.iter().find(|p| p.name() == name);
        Section {
            kind: *kind,
            name: Box::leak(name.clone().into_boxed_str()),
            bytes: Cow::Owned(bytes.clone()),
            compress: compress && part.is_none_or(|p| p.may_compress()),
        }
    };
    container::write(&raw.iter().map(section).collect::<Vec<_>>())
}
