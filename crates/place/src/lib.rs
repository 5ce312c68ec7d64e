//! Place recognition: finds keyframes that show the same place as an image.
//!
//! [`PlaceVector`] describes an image's appearance, [`PlaceIndex`] finds the most similar of a thousand keyframes, and
//! pairs of features that may show the same point can be extracted. Everything is based on descriptors alone, without
//! poses, geometry or map: results are candidates that the caller verifies. The caller also excludes features on moving
//! objects.
//!
//! A small tree of binary words is embedded in the program ([`Vocabulary::embedded`]), trained by `lab place train`.
//! The choice and its alternatives are in `docs/decisions/0010-place-recognition.md`, made by `lab place compare`.
//!
//! ```
//! use std::sync::Arc;
//! use stillpoint_features::Descriptor;
//! use stillpoint_place::{PlaceIndex, Vocabulary};
//!
//! let vocabulary = Vocabulary::embedded();
//! let image = |seed: u64| -> Vec<Descriptor> {
//!     let word = |i: u64| (seed * 1000 + i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
//!     (0..200).map(|i| Descriptor([word(4 * i), word(4 * i + 1), word(4 * i + 2), word(4 * i + 3)])).collect()
//! };
//! let mut index = PlaceIndex::default();
//! for keyframe in 0..10_u32 {
//!     index.insert(keyframe, Arc::new(vocabulary.vector(&image(keyframe.into()))));
//! }
//! let seen = vocabulary.vector(&image(7));
//! let found = index.query(&seen, |_| true, 3);
//! assert_eq!(found[0].key, 7);
//! ```

mod index;
mod popcnt;
mod vector;
mod vocabulary;

pub use index::{PlaceIndex, PlaceMatch};
pub use vector::{FeaturePair, PlaceVector};
pub use vocabulary::{Vocabulary, VocabularyError};
