//! Motion weights: published defaults and the user's table.

use proptest::prelude::*;
use serde::{Deserialize, Serialize};
use stillpoint_detection::{ClassId, MotionWeights, WeightError};

#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Objects {
    weights: MotionWeights,
}

fn weight(weights: &MotionWeights, name: &str) -> f64 {
    weights.get(ClassId::from_name(name).unwrap())
}

#[test]
fn default_weights_include_the_published_ones() {
    let weights = MotionWeights::default();
    for (name, expected) in [
        ("person", 5.0),
        ("chair", 3.0),
        ("dining table", 1.0),
        ("dog", 5.0),
        ("laptop", 2.0),
        ("tv", 1.0),
        ("sink", 0.0),
    ] {
        assert_eq!(weight(&weights, name), expected, "{name}");
    }
    assert_eq!(weights.iter().count(), ClassId::COUNT);
    assert!(weights.iter().all(|(_, w)| (0.0..=5.0).contains(&w)));
    assert_eq!(weights.get(ClassId(80)), 0.0);
}

#[test]
fn published_weights_cover_three_classes() {
    let weights = MotionWeights::default().published();
    let counted = weights.iter().filter(|(_, w)| *w > 0.0);
    let counted: Vec<(&str, f64)> = counted.map(|(class, w)| (class.name(), w)).collect();
    assert_eq!(
        counted,
        [("person", 5.0), ("chair", 3.0), ("dining table", 1.0)]
    );
    let mut set = MotionWeights::default();
    set.set("dog", 4.5).unwrap();
    set.set("chair", 0.0).unwrap();
    let weights = set.published();
    assert_eq!(
        (weight(&weights, "dog"), weight(&weights, "chair")),
        (4.5, 0.0)
    );
    assert_eq!(weight(&weights, "cat"), 0.0);
}

#[test]
fn weight_table_overrides_only_named_classes() {
    let text = "[weights]\nchair = 0\ndining_table = 2.5\n\"sports ball\" = 5\n";
    let objects: Objects = toml::from_str(text).unwrap();
    for (class, w) in objects.weights.iter() {
        let expected = match class.name() {
            "chair" => 0.0,
            "dining table" => 2.5,
            "sports ball" => 5.0,
            _ => MotionWeights::default().get(class),
        };
        assert_eq!(w, expected, "{class}");
    }
    assert_eq!(toml::from_str::<Objects>("").unwrap(), Objects::default());
}

#[test]
fn invalid_weight_tables_are_refused_with_advice() {
    let cases = [
        ("persn = 5", "such as `person`, found `persn`"),
        ("table = 1", "found `table`"),
        (
            "person = 6",
            "from 0 (ignored) to 5 (moves by itself) for `person`, found 6",
        ),
        ("person = -0.1", "found -0.1"),
        ("person = nan", "found NaN"),
        ("person = \"much\"", "invalid type"),
    ];
    for (line, part) in cases {
        let error = toml::from_str::<Objects>(&format!("[weights]\n{line}"))
            .unwrap_err()
            .to_string();
        assert!(error.contains(part), "{part} is not in: {error}");
    }
    let error = MotionWeights::default().set("chairs", 1.0).unwrap_err();
    assert!(
        matches!(
            error,
            WeightError::UnknownClass {
                nearest: ClassId(56),
                ..
            }
        ),
        "{error}"
    );
}

/// Keys are bare, so that `--set motion_weights.dining_table=2` needs no quotes, and defaults are not written.
#[test]
fn only_changed_weights_are_written_as_bare_keys() {
    let mut objects = Objects::default();
    let written = |objects: &Objects| toml::to_string(objects).unwrap();
    let keys = |text: &str| text.lines().filter(|l| l.contains(" = ")).count();
    assert_eq!(keys(&written(&objects)), 0);
    objects.weights.set("dining table", 2.5).unwrap();
    objects.weights.set("person", 5.0).unwrap();
    let text = written(&objects);
    assert_eq!(keys(&text), 1);
    assert!(
        text.contains("\ndining_table = 2.5\n") && !text.contains('"'),
        "{text}"
    );
}

proptest! {
    #[test]
    fn weights_round_trip_through_toml(changes in prop::collection::vec((0..80u8, 0.0..=5.0f64), 0..10)) {
        let mut objects = Objects::default();
        for (class, weight) in changes {
            objects.weights.set(ClassId(class).name(), weight).unwrap();
        }
        let text = toml::to_string(&objects).unwrap();
        prop_assert_eq!(toml::from_str::<Objects>(&text).unwrap(), objects);
    }
}
