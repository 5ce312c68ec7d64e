//! The embedded tree of binary words: words of descriptors and their inverse document frequencies. Trained by `lab
//! place train`.

use crate::{PlaceVector, popcnt};
use std::sync::Arc;
use stillpoint_features::Descriptor;

/// Bytes before the first centre: magic, version and shape.
const HEADER: usize = 8;
const MAGIC: [u8; 5] = *b"SPWT\x01";
/// Bytes of a centre: 256 bits.
const CENTRE: usize = 32;

/// Trained by `cargo run --release --manifest-path lab/Cargo.toml -- place train`.
static EMBEDDED: &[u8] = include_bytes!("../data/vocabulary.bin");
// An unreadable embedded file stops the build, so reading it cannot fail.
const _: () = assert!(
    problem(EMBEDDED).is_none(),
    "data/vocabulary.bin is malformed"
);

/// Reason why bytes are not a vocabulary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VocabularyError {
    /// Wrong magic or version.
    Foreign,
    /// Invalid shape: branching must be 2 to 64, levels 1 to 8, words at most 65536.
    Shape {
        /// Children of each node, as stated.
        branching: u8,
        /// Levels below the root, as stated.
        levels: u8,
        /// The level of the nodes within which features are matched, as stated.
        match_level: u8,
    },
    /// The number of bytes does not match the shape.
    Length {
        /// Bytes required by the shape.
        expected: usize,
        /// Bytes found.
        found: usize,
    },
}

impl std::fmt::Display for VocabularyError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Foreign => write!(f, "expected a vocabulary of version 1, found other bytes"),
            Self::Shape {
                branching,
                levels,
                match_level,
            } => write!(
                f,
                "expected a tree of 2 to 64 children, 1 to 8 levels and at most 65536 words, matched at one of its levels, found {branching} children, {levels} levels, matched at level {match_level}"
            ),
            Self::Length { expected, found } => {
                write!(f, "expected {expected} bytes of vocabulary, found {found}")
            }
        }
    }
}

impl std::error::Error for VocabularyError {}

/// A tree of binary words (Nister, Stewenius, "Scalable recognition with a vocabulary tree", CVPR 2006; with binary
/// centres as in Galvez-Lopez, Tardos, "Bags of binary words", T-RO 2012). Complete: all inner nodes have the same
/// number of children, and the leaves are the words.
///
/// About 200 kB, read in well under a millisecond; owned by the caller, not global.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Vocabulary {
    branching: usize,
    levels: usize,
    match_level: usize,
    /// Breadth first, without the root.
    centres: Vec<Descriptor>,
    /// Inverse document frequency of each word, in 1/1024.
    idf: Vec<u16>,
}

/// Numbers of nodes below the root and of leaves of a complete tree; `None` when the shape is out of range.
const fn tree_size(branching: u8, levels: u8) -> Option<(usize, usize)> {
    if branching < 2 || branching > 64 || levels < 1 || levels > 8 {
        return None;
    }
    let (mut nodes, mut leaves, mut level) = (0_usize, 1_usize, 0);
    while level < levels {
        leaves *= branching as usize;
        if leaves > 1 << 16 {
            return None;
        }
        nodes += leaves;
        level += 1;
    }
    Some((nodes, leaves))
}

/// The problem of `bytes`, if any. Constant, so that the compiler checks the embedded file.
const fn problem(bytes: &[u8]) -> Option<VocabularyError> {
    let mut i = 0;
    while i < MAGIC.len() {
        if i >= bytes.len() || bytes[i] != MAGIC[i] {
            return Some(VocabularyError::Foreign);
        }
        i += 1;
    }
    if bytes.len() < HEADER {
        return Some(VocabularyError::Length {
            expected: HEADER,
            found: bytes.len(),
        });
    }
    let (branching, levels, match_level) = (bytes[5], bytes[6], bytes[7]);
    let shape = VocabularyError::Shape {
        branching,
        levels,
        match_level,
    };
    let Some((nodes, leaves)) = tree_size(branching, levels) else {
        return Some(shape);
    };
    if match_level == 0 || match_level > levels {
        return Some(shape);
    }
    let expected = HEADER + nodes * CENTRE + leaves * 2;
    if bytes.len() != expected {
        return Some(VocabularyError::Length {
            expected,
            found: bytes.len(),
        });
    }
    None
}

impl Vocabulary {
    /// The vocabulary embedded in the program.
    #[must_use]
    pub fn embedded() -> Self {
        Self::decode(EMBEDDED)
    }

    /// Reads a vocabulary: "SPWT", version, branching, levels, match level (one byte each), the centres breadth first
    /// (4 words of 64 bits each), the inverse document frequencies of the leaves in 1/1024 (16 bits each); all
    /// little-endian.
    ///
    /// # Errors
    /// [`VocabularyError`] when the bytes deviate from this format.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, VocabularyError> {
        match problem(bytes) {
            Some(problem) => Err(problem),
            None => Ok(Self::decode(bytes)),
        }
    }

    fn decode(bytes: &[u8]) -> Self {
        let (header, body) = bytes.split_at(HEADER);
        let [branching, levels, match_level] = [header[5], header[6], header[7]];
        let nodes = tree_size(branching, levels).map_or(0, |(nodes, _)| nodes);
        let (centres, idf) = body.split_at(nodes * CENTRE);
        let word = |bytes: &[u8]| {
            bytes
                .iter()
                .rev()
                .fold(0, |word, byte| word << 8 | u64::from(*byte))
        };
        let centre =
            |bytes: &[u8]| Descriptor(std::array::from_fn(|i| word(&bytes[8 * i..8 * i + 8])));
        Self {
            branching: branching.into(),
            levels: levels.into(),
            match_level: match_level.into(),
            centres: centres.chunks_exact(CENTRE).map(centre).collect(),
            idf: idf.chunks_exact(2).map(|b| word(b) as u16).collect(),
        }
    }

    /// Number of words.
    #[must_use]
    pub fn len(&self) -> usize {
        self.idf.len()
    }

    /// Always false: a tree has leaves.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.idf.is_empty()
    }

    /// The word of each descriptor, below [`Vocabulary::len`]: descends from the root to the nearest child, the first
    /// one on ties.
    #[must_use]
    pub fn words(&self, descriptors: &[Descriptor]) -> Vec<u16> {
        popcnt::words(self, descriptors)
    }

    /// [`Vocabulary::words`], inlined to be compiled for the caller's instruction set.
    #[inline(always)]
    pub(crate) fn words_portable(&self, descriptors: &[Descriptor]) -> Vec<u16> {
        let k = self.branching;
        let word = |descriptor: &Descriptor| {
            // `node` counts within its level; `level` is the index of the first centre of the level below.
            let (mut node, mut level, mut width) = (0, 0, k);
            for _ in 0..self.levels {
                let children = &self.centres[level + node * k..][..k];
                let (mut best, mut least) = (0, u32::MAX);
                for (child, centre) in children.iter().enumerate() {
                    let distance = descriptor.distance(centre);
                    if distance < least {
                        (best, least) = (child, distance);
                    }
                }
                node = node * k + best;
                level += width;
                width *= k;
            }
            node as u16
        };
        descriptors.iter().map(word).collect()
    }

    /// Inverse document frequency of a word, in 1/1024; 0 for an unknown word.
    pub(crate) fn idf(&self, word: u16) -> u16 {
        self.idf.get(usize::from(word)).copied().unwrap_or(0)
    }

    /// Number of words below one node of the match level.
    pub(crate) fn words_per_group(&self) -> u16 {
        let below = (self.levels - self.match_level) as u32;
        // A group is smaller than the vocabulary, which has at most 65536 words in at least two groups.
        self.branching.pow(below) as u16
    }

    /// The vector of an image, from the descriptors of all its features.
    #[must_use]
    pub fn vector(&self, descriptors: &[Descriptor]) -> PlaceVector {
        self.vector_of(&Arc::new(descriptors.to_vec()), |_| true)
    }

    /// The vector of an image, from the descriptors of the features accepted by `admit`, which should exclude moving
    /// objects. Pairs of features ([`PlaceVector::candidate_pairs`]) index `descriptors`, admitted or not. Shares
    /// `descriptors`. Features from number 65535 on are ignored.
    #[must_use]
    pub fn vector_of(
        &self,
        descriptors: &Arc<Vec<Descriptor>>,
        admit: impl Fn(usize) -> bool,
    ) -> PlaceVector {
        PlaceVector::new(self, descriptors, admit)
    }
}
