//! Training of the vocabulary: a tree of binary centres by majority votes.
//!
//! Each level distributes the descriptors of a node among its children: first centres as in k-means++ (Arthur, Vassilvitskii, SODA 2007),
//! then rounds of "each descriptor to the nearest centre, each centre to the majority of its descriptors' bits" (Grana et al., "A fast
//! approach for integrating ORB descriptors in the bag of words model", 2013).

use super::keyframes::{Simulated, recorded, simulated};
use crate::Failure;
use crate::inputs::data_folder;
use crate::origin::root;
use std::path::PathBuf;
use std::process::ExitCode;
use stillpoint::features::Descriptor;
use stillpoint::place::Vocabulary;

/// Trains on every 4th image of the recording `fr1_xyz` and every 12th of `corridor_fixed`. `lab place compare` tests on another recording
/// and on rooms of other seeds, so training and test data are disjoint.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Output file [default: the file that is embedded]
    file: Option<PathBuf>,
    /// Also train on images of simulated rooms, of seeds from 1000 on
    #[arg(long)]
    rooms: bool,
    /// Train without the recordings
    #[arg(long, requires = "rooms")]
    no_recordings: bool,
}

/// 4680 centres of 32 bytes, 4096 of which are words. Features are matched within 512 groups of 8 words.
const SHAPE: Shape = Shape {
    branching: 8,
    levels: 4,
    match_level: 3,
};

/// Maximum number of rounds at each node.
const ROUNDS: usize = 10;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Shape {
    branching: u8,
    levels: u8,
    /// Level of the nodes in which features are matched.
    match_level: u8,
}

/// SplitMix64 (Steele, Lea, Flood, OOPSLA 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// Returns the bytes of a vocabulary for [`Vocabulary::from_bytes`].
fn train(images: &[&[Descriptor]], shape: Shape, seed: u64) -> Result<Vec<u8>, Failure> {
    let all: Vec<Descriptor> = images.iter().flat_map(|i| i.iter().copied()).collect();
    let mut random = Random(seed);
    let mut bytes = b"SPWT\x01".to_vec();
    bytes.extend([shape.branching, shape.levels, shape.match_level]);
    let mut nodes = vec![all];
    for _ in 0..shape.levels {
        let mut children = Vec::new();
        for node in &nodes {
            let centres = centres(node, shape.branching.into(), &mut random);
            let mut parts = vec![Vec::new(); centres.len()];
            for descriptor in node {
                parts[nearest(descriptor, &centres).0].push(*descriptor);
            }
            for word in centres.iter().flat_map(|c| c.0) {
                bytes.extend(word.to_le_bytes());
            }
            children.extend(parts);
        }
        nodes = children;
    }
    // Document frequencies need the words as the library assigns them.
    let words = nodes.len();
    let mut unweighted = bytes.clone();
    unweighted.resize(bytes.len() + 2 * words, 0);
    let tree = Vocabulary::from_bytes(&unweighted)?;
    let mut documents = vec![0_u32; words];
    for image in images {
        let mut present = tree.words(image);
        present.sort_unstable();
        present.dedup();
        for word in present {
            documents[usize::from(word)] += 1;
        }
    }
    let all = images.len() as f64;
    for count in documents {
        // A virtual image with every word makes words absent from training rare, not impossible.
        let idf = libm::log((all + 1.0) / (f64::from(count) + 1.0));
        bytes.extend(((1024.0 * idf).round() as u16).to_le_bytes());
    }
    Ok(bytes)
}

fn nearest(descriptor: &Descriptor, centres: &[Descriptor]) -> (usize, u32) {
    let mut best = (0, u32::MAX);
    for (i, centre) in centres.iter().enumerate() {
        let distance = descriptor.distance(centre);
        if distance < best.1 {
            best = (i, distance);
        }
    }
    best
}

/// The centres of one node's children. With few descriptors some are equal, and the later ones get no words.
fn centres(descriptors: &[Descriptor], count: usize, random: &mut Random) -> Vec<Descriptor> {
    if descriptors.is_empty() {
        return vec![Descriptor::default(); count];
    }
    let mut centres = first_centres(descriptors, count, random);
    let mut before = Vec::new();
    for _ in 0..ROUNDS {
        let assigned: Vec<usize> = descriptors.iter().map(|d| nearest(d, &centres).0).collect();
        if assigned == before {
            break;
        }
        let mut ones = vec![[0_u32; 256]; count];
        let mut sizes = vec![0_u32; count];
        for (descriptor, centre) in descriptors.iter().zip(&assigned) {
            sizes[*centre] += 1;
            for (bit, ones) in ones[*centre].iter_mut().enumerate() {
                *ones += (descriptor.0[bit / 64] >> (bit % 64) & 1) as u32;
            }
        }
        for (centre, (ones, size)) in centres.iter_mut().zip(ones.iter().zip(&sizes)) {
            if *size > 0 {
                let majority = |bit: usize| u64::from(2 * ones[bit] > *size);
                *centre = Descriptor(std::array::from_fn(|word| {
                    (0..64).fold(0, |bits, i| bits | majority(64 * word + i) << i)
                }));
            }
        }
        before = assigned;
    }
    centres
}

/// k-means++: draws each centre in proportion to its squared distance from the nearest previous one.
fn first_centres(descriptors: &[Descriptor], count: usize, random: &mut Random) -> Vec<Descriptor> {
    let mut centres = vec![descriptors[(random.bits() % descriptors.len() as u64) as usize]];
    let mut distances = vec![u64::MAX; descriptors.len()];
    while centres.len() < count {
        let last = centres[centres.len() - 1];
        for (distance, descriptor) in distances.iter_mut().zip(descriptors) {
            let d = u64::from(descriptor.distance(&last));
            *distance = (*distance).min(d * d);
        }
        let sum: u64 = distances.iter().sum();
        let mut draw = random.bits() % sum.max(1);
        let chosen = distances.iter().position(|d| {
            let here = draw < *d;
            draw = draw.saturating_sub(*d);
            here
        });
        centres.push(descriptors[chosen.unwrap_or(0)]);
    }
    centres
}

fn images(real: bool, simulated_rooms: bool) -> Result<Vec<Vec<Descriptor>>, Failure> {
    let mut keyframes = Vec::new();
    for (name, every) in [("fr1_xyz", 4), ("corridor_fixed", 12)] {
        let folder = data_folder().join(name);
        if real && folder.is_dir() {
            keyframes.extend(recorded(&folder, Some(every))?);
        }
    }
    for seed in 1000..if simulated_rooms { 1004 } else { 1000 } {
        for (scene, frames) in [
            ("loop_two_rooms", None),
            ("halfsphere", Some(300)),
            ("rpy", Some(300)),
        ] {
            keyframes.extend(simulated(&Simulated {
                scene,
                seed,
                frames,
            })?);
        }
    }
    Ok(keyframes.into_iter().map(|k| k.descriptors).collect())
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let images = images(!arguments.no_recordings, arguments.rooms)?;
    if images.is_empty() {
        let folder = data_folder();
        return Err(format!("expected recordings in {}, found none", folder.display()).into());
    }
    let images: Vec<&[Descriptor]> = images.iter().map(Vec::as_slice).collect();
    let bytes = train(&images, SHAPE, 1)?;
    let embedded = || root().join("crates/place/data/vocabulary.bin");
    let file = arguments.file.clone().unwrap_or_else(embedded);
    std::fs::write(&file, &bytes)?;
    println!(
        "{} images, {} descriptors; {} bytes in {}",
        images.len(),
        images.iter().map(|i| i.len()).sum::<usize>(),
        bytes.len(),
        file.display()
    );
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trained_vocabulary_separates_descriptor_clusters() {
        let mut random = Random(7);
        let [low, high] = [0, u64::MAX].map(|base| {
            // A centre with a random bit flipped in each word.
            let near = |_| Descriptor([base ^ (1 << (random.bits() % 64)); 4]);
            (0..40).map(near).collect::<Vec<_>>()
        });
        let shape = Shape {
            branching: 2,
            levels: 1,
            match_level: 1,
        };
        let bytes = train(&[&low, &high], shape, 1).unwrap();
        assert_eq!(bytes, train(&[&low, &high], shape, 1).unwrap());
        let vocabulary = Vocabulary::from_bytes(&bytes).unwrap();
        let [of_low, of_high] = [&low, &high].map(|all| vocabulary.words(all));
        assert!(of_low.iter().all(|w| *w == of_low[0]));
        assert!(of_high.iter().all(|w| *w == of_high[0]));
        assert_ne!(of_low[0], of_high[0]);
    }
}
