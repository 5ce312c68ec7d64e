//! Place recognition: which keyframes show what an image shows.
//!
//! Answers: what an image looks like as a whole ([`PlaceVector`]), how alike two images are, which of a thousand keyframes are most alike to one
//! ([`PlaceIndex`]), and which features of two images may be the same point. Judges by descriptors alone: it knows no poses, no geometry and no map, so
//! what it finds are candidates that the caller verifies. What may enter a vector (nothing that moves) is the caller's to say.
//!
//! A small tree of binary words is embedded in the program ([`Vocabulary::embedded`]); it is made by `lab place train`. How it was chosen, and
//! what else was tried, is in `docs/decisions/0010-place-recognition.md`, made by `lab place compare`.
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
