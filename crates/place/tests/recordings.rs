//! Place recognition in rendered and recorded images. `lab place compare` measures its quality.
#![allow(clippy::print_stdout)] // Measurements are printed.

// The laboratory includes this file too (`lab place`) and names the crates by the facade: imports needed by the file
// are here.
use stillpoint_datasets as datasets;
use stillpoint_features as features;
use stillpoint_geometry as geometry;
use stillpoint_imaging as imaging;
use stillpoint_simulator as simulator;

mod keyframes;

use keyframes::{Keyframe, recorded};
use std::sync::Arc;
use stillpoint_features::{Features, OrbConfig, OrbExtractor};
use stillpoint_imaging::Simd;
use stillpoint_place::{PlaceIndex, PlaceVector, Vocabulary};
use stillpoint_simulator::{Simulator, SimulatorConfig};

/// A walk through two rooms returns to its start: its last images must find the first ones among images of the rest of
/// the way, which show the same chairs, shelves and posters at other places.
#[test]
fn loop_walk_recognises_its_start() {
    let sim = Simulator::new(&SimulatorConfig {
        scene: "loop_two_rooms".to_owned(),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let vocabulary = Vocabulary::embedded();
    let mut extractor = OrbExtractor::new(&OrbConfig::default(), Simd::detect());
    let mut features = Features::default();
    let mut vector = |frame: usize| {
        extractor.extract(&sim.frame(frame).gray, &mut features);
        Arc::new(vocabulary.vector(&features.descriptors))
    };
    let last = sim.len() - 1;
    let far = |a: usize, b: usize| {
        let place = |frame: usize| sim.world_from_camera(sim.stamp(frame)).translation;
        (place(a) - place(b)).norm()
    };
    let mut index = PlaceIndex::default();
    for frame in (0..last - 150).step_by(25) {
        index.insert(frame, vector(frame));
    }
    let mut worst_right = f64::MAX;
    for frame in [last - 90, last - 60, last - 30, last] {
        let found = index.query(&vector(frame), |_| true, 1);
        assert!(
            far(frame, found[0].key) < 1.0,
            "frame {frame} found {found:?}"
        );
        worst_right = worst_right.min(found[0].score);
    }
    // Without the start in the index nothing else is as similar.
    for frame in [last - 90, last - 60, last - 30, last] {
        let elsewhere = index.query(&vector(frame), |key| far(frame, key) > 4.0, 1);
        assert!(elsewhere[0].score < worst_right, "{elsewhere:?}");
    }
}

fn vectors(keyframes: &[Keyframe]) -> Vec<Arc<PlaceVector>> {
    let vocabulary = Vocabulary::embedded();
    let vector = |k: &Keyframe| Arc::new(vocabulary.vector(&k.descriptors));
    keyframes.iter().map(vector).collect()
}

/// A kitchen that is not in the training data of the vocabulary.
#[test]
fn kitchen_revisits_are_recognised() {
    let Some(folder) = stillpoint_testdata::recording("kitchen") else {
        return;
    };
    let keyframes = recorded(&folder, Some(4)).unwrap();
    let vectors = vectors(&keyframes);
    let recent = |i: usize, j: usize| keyframes[i].stamp - keyframes[j].stamp < 5.0;
    let same = |i: usize, j: usize| keyframes[i].overlap(&keyframes[j]) >= 0.3;
    let mut index = PlaceIndex::default();
    let (mut revisits, mut found) = (0, 0);
    for (i, vector) in vectors.iter().enumerate() {
        if (0..i).any(|j| !recent(i, j) && same(i, j)) {
            let answers = index.query(vector, |j| !recent(i, j), 10);
            revisits += 1;
            found += usize::from(answers.iter().any(|m| same(i, m.key)));
        }
        index.insert(i, Arc::clone(vector));
    }
    println!("{found} of {revisits} revisits have a right one among ten");
    assert!(revisits > 50, "{revisits}");
    assert!(10 * found > 9 * revisits, "{found} of {revisits}");
}
