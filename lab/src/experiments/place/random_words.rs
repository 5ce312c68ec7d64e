//! Untrained words: in each of several tables a word is a few bits of the descriptor at random positions (bit sampling: Indyk, Motwani,
//! STOC 1998). Weights are the document frequencies in the index.

use super::method::{Method, best};
use stillpoint::features::Descriptor;

pub(crate) struct RandomWords {
    /// Positions of the bits, by table.
    tables: Vec<Vec<u8>>,
    images: Vec<(usize, Vec<(u32, u32)>)>,
    documents: Vec<u32>,
}

impl RandomWords {
    pub(crate) fn new(tables: usize, bits: usize) -> Self {
        let mut state = 1_u64;
        let mut draw = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        };
        let tables: Vec<Vec<u8>> = (0..tables)
            .map(|_| (0..bits).map(|_| draw()).collect())
            .collect();
        Self {
            documents: vec![0; tables.len() << bits],
            tables,
            images: Vec::new(),
        }
    }

    fn words(&self, descriptors: &[Descriptor]) -> Vec<(u32, u32)> {
        let mut words: Vec<u32> = Vec::new();
        for (number, bits) in self.tables.iter().enumerate() {
            for d in descriptors {
                let bit = |b: &u8| (d.0[usize::from(b / 64)] >> (b % 64) & 1) as u32;
                let word = bits.iter().fold(0, |word, b| word << 1 | bit(b));
                words.push((number as u32) << bits.len() | word);
            }
        }
        words.sort_unstable();
        let runs = words.chunk_by(|a, b| a == b);
        runs.map(|run| (run[0], run.len() as u32)).collect()
    }

    fn weights(&self) -> Vec<f64> {
        let all = self.images.len() as f64 + 1.0;
        let weight = |count: &u32| libm::log(all / (f64::from(*count) + 1.0)).max(0.0);
        self.documents.iter().map(weight).collect()
    }
}

impl Method for RandomWords {
    fn name(&self) -> String {
        format!(
            "random words, {} tables of {} bits",
            self.tables.len(),
            self.tables[0].len()
        )
    }

    fn clear(&mut self) {
        self.images.clear();
        self.documents.fill(0);
    }

    fn insert(&mut self, key: usize, descriptors: &[Descriptor]) {
        let words = self.words(descriptors);
        for (word, _) in &words {
            self.documents[*word as usize] += 1;
        }
        self.images.push((key, words));
    }

    fn query(
        &self,
        descriptors: &[Descriptor],
        admit: &dyn Fn(usize) -> bool,
        limit: usize,
    ) -> Vec<(usize, f64)> {
        let own = self.words(descriptors);
        let mut table = vec![0_u32; self.documents.len()];
        for (word, count) in &own {
            table[*word as usize] = *count;
        }
        let weights = self.weights();
        let weight = |word: u32, count: u32| f64::from(count) * weights[word as usize];
        let all: f64 = own.iter().map(|(word, count)| weight(*word, *count)).sum();
        let score = |words: &[(u32, u32)]| {
            let (mut common, mut theirs) = (0.0, 0.0);
            for (word, count) in words {
                common += weight(*word, (*count).min(table[*word as usize]));
                theirs += weight(*word, *count);
            }
            2.0 * common / (all + theirs).max(1e-9)
        };
        let images = self.images.iter().filter(|(key, _)| admit(*key));
        best(
            images.map(|(key, words)| (*key, score(words))).collect(),
            limit,
        )
    }

    fn bytes(&self) -> usize {
        let images: usize = self
            .images
            .iter()
            .map(|(_, w)| w.len() * size_of::<(u32, u32)>())
            .sum();
        images + 4 * self.documents.len()
    }
}
