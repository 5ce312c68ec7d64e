//! The embedded tree of binary words.
//!
//! Answers: which word a descriptor is, and how rare that word is. Does not train: see `lab place train`.

use crate::{PlaceVector, popcnt};
use std::sync::Arc;
use stillpoint_features::Descriptor;

/// Bytes before the first centre: the magic and the version, the shape.
const HEADER: usize = 8;
const MAGIC: [u8; 5] = *b"SPWT\x01";
/// Bytes of a centre: 256 bits.
const CENTRE: usize = 32;

/// Trained by `cargo run --release --manifest-path lab/Cargo.toml -- place train`.
static EMBEDDED: &[u8] = include_bytes!("../data/vocabulary.bin");
// A file that cannot be read stops the build, so reading the embedded one cannot fail.
const _: () = assert!(
    problem(EMBEDDED).is_none(),
    "data/vocabulary.bin is malformed"
);

/// Why bytes are no vocabulary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VocabularyError {
    /// They do not begin as a vocabulary of this version does.
    Foreign,
    /// A tree of this shape is not possible: the branching is 2 to 64, there are 1 to 8 levels and at most 65536 words.
    Shape {
        /// Children of each node, as stated.
        branching: u8,
        /// Levels below the root, as stated.
        levels: u8,
        /// The level of the nodes in which features are matched, as stated.
        match_level: u8,
    },
    /// There are more or fewer bytes than the shape says.
    Length {
        /// Bytes that the shape asks for.
        expected: usize,
        /// Bytes that are there.
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

/// A tree of binary words (Nister, Stewenius, "Scalable recognition with a vocabulary tree", CVPR 2006; with binary centres as in Galvez-Lopez, Tardos,
/// "Bags of binary words", T-RO 2012). Complete: every inner node has the same number of children, and the leaves are the words.
///
/// About 200 kB, read in well under a millisecond; the owner keeps it, there is no global.
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

/// The number of nodes below the root of a complete tree, and how many of them are leaves; `None` when the shape is out of range.
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

/// Why `bytes` cannot be read. Constant, so that the embedded file is checked by the compiler.
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
    /// The vocabulary that is part of the program.
    #[must_use]
    pub fn embedded() -> Self {
        Self::decode(EMBEDDED)
    }

    /// Reads a vocabulary: "SPWT", version, branching, levels, level of matching (one byte each), the centres breadth first (4 words of 64 bits each), the inverse document frequencies of the leaves in 1/1024 (16 bits each); all little-endian.
    ///
    /// # Errors
    /// [`VocabularyError`] when the bytes are not that, exactly.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, VocabularyError> {
        match problem(bytes) {
            Some(problem) => Err(problem),
            None => Ok(Self::decode(bytes)),
        }
    }

    /// Reads bytes in which [`problem`] has found nothing wrong.
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

    /// Never true: a tree has leaves.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.idf.is_empty()
    }

    /// The word of each descriptor, below [`Vocabulary::len`]: from the root, always on to the nearest child, the first one of equally near ones.
    #[must_use]
    pub fn words(&self, descriptors: &[Descriptor]) -> Vec<u16> {
        popcnt::words(self, descriptors)
    }

    /// [`Vocabulary::words`] for the instruction set of its caller, into which it is inlined.
    #[inline(always)]
    pub(crate) fn words_portable(&self, descriptors: &[Descriptor]) -> Vec<u16> {
        let k = self.branching;
        let word = |descriptor: &Descriptor| {
            // `node` counts within its level, `level` points to the first centre of the level below it.
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

    /// Inverse document frequency of a word, in 1/1024; 0 for a word that does not exist.
    pub(crate) fn idf(&self, word: u16) -> u16 {
        self.idf.get(usize::from(word)).copied().unwrap_or(0)
    }

    /// Number of words below one node of the level at which features are matched.
    pub(crate) fn words_per_group(&self) -> u16 {
        let below = (self.levels - self.match_level) as u32;
        // A group is smaller than the vocabulary, which has at most 65536 words in at least two groups.
        self.branching.pow(below) as u16
    }

    /// What an image looks like, from the descriptors of all its features.
    #[must_use]
    pub fn vector(&self, descriptors: &[Descriptor]) -> PlaceVector {
        self.vector_of(&Arc::new(descriptors.to_vec()), |_| true)
    }

    /// What an image looks like, from the descriptors of those of its features that `admit` lets in: leave out what moves. Pairs of features
    /// ([`PlaceVector::candidate_pairs`]) count in `descriptors`, admitted or not. It shares these. Features from number 65535 on are left out.
    #[must_use]
    pub fn vector_of(
        &self,
        descriptors: &Arc<Vec<Descriptor>>,
        admit: impl Fn(usize) -> bool,
    ) -> PlaceVector {
        PlaceVector::new(self, descriptors, admit)
    }
}
