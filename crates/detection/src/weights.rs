//! Motion weights: how likely objects of each class are to move or be moved.

use crate::ClassId;
use serde::de::Error;
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;

/// Weight of a class that always moves, and the maximum.
const MOST: f64 = 5.0;

/// Classes named by the publication of the static filter's preset `paper`: people, chairs and desks.
const NAMED: [&str; 3] = ["person", "chair", "dining table"];

/// A motion weight per class, from 0 (its boxes are ignored) to 5 (moves by itself). The filter multiplies a feature's
/// epipolar distance by it.
///
/// In a configuration it is a table of names and weights, e.g. `person = 5` or `dining_table = 1`. Classes not in the
/// table keep their defaults, and only changed ones are written; unknown names and weights outside 0 to 5 are rejected.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionWeights([f64; ClassId::COUNT]);

/// An invalid table of weights.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WeightError {
    /// A name is not one of the 80 classes.
    #[error("expected the name of a COCO class such as `{}`, found `{name}`; correct the name or leave it out", key(*nearest))]
    UnknownClass {
        /// The name.
        name: String,
        /// The class with the most similar name, or person.
        nearest: ClassId,
    },
    /// A weight is out of range.
    #[error("expected a weight from 0 (ignored) to 5 (moves by itself) for `{}`, found {found}; choose a weight on this scale", key(*class))]
    Range {
        /// The class.
        class: ClassId,
        /// The weight found.
        found: f64,
    },
}

impl MotionWeights {
    /// The weight of a class, 0 to 5; 0 for invalid numbers.
    #[must_use]
    pub fn get(&self, class: ClassId) -> f64 {
        self.0.get(usize::from(class.0)).copied().unwrap_or(0.0)
    }

    /// Sets the weight of a class by name.
    ///
    /// # Errors
    /// [`WeightError`] for an unknown name or a weight outside 0 to 5.
    pub fn set(&mut self, name: &str, weight: f64) -> Result<(), WeightError> {
        let class = ClassId::from_name(name).ok_or_else(|| WeightError::UnknownClass {
            name: name.to_owned(),
            nearest: ClassId::nearest(name).unwrap_or(ClassId::PERSON),
        })?;
        if !(0.0..=MOST).contains(&weight) {
            return Err(WeightError::Range {
                class,
                found: weight,
            });
        }
        self.0[usize::from(class.0)] = weight;
        Ok(())
    }

    /// These weights restricted to the publication: classes it does not name get 0, unless their weight differs from
    /// the default.
    #[must_use]
    pub fn published(&self) -> Self {
        let defaults = Self::default();
        let ignored =
            |class: ClassId, w: f64| !NAMED.contains(&class.name()) && w == defaults.get(class);
        let mut weights = self.clone();
        for (class, _) in self.iter().filter(|(class, w)| ignored(*class, *w)) {
            weights.0[usize::from(class.0)] = 0.0;
        }
        weights
    }

    /// All classes with their weights, in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = (ClassId, f64)> + '_ {
        ClassId::all().zip(self.0.iter().copied())
    }
}

impl Default for MotionWeights {
    /// The published weights (person 5, chair 3, desk 1), extended to all classes by how often objects of the class
    /// move while a room is filmed: by themselves 5, carried or rolled about 3 to 4, handled 2, shoved now and then 1,
    /// never 0. Vehicles are outdoor things that move by themselves: 4, since most of them are parked.
    fn default() -> Self {
        Self(std::array::from_fn(|number| default_weight(number as u8)))
    }
}

fn default_weight(number: u8) -> f64 {
    match ClassId(number).name() {
        "person" | "bird" | "cat" | "dog" | "horse" | "sheep" | "cow" | "elephant" | "bear"
        | "zebra" | "giraffe" => 5.0,
        "car" | "motorcycle" | "airplane" | "bus" | "train" | "truck" | "boat" => 4.0,
        "sports ball" | "frisbee" | "kite" | "skateboard" => 4.0,
        "bicycle" | "backpack" | "handbag" | "suitcase" | "umbrella" | "tie" | "chair" | "skis"
        | "snowboard" | "surfboard" | "baseball bat" | "baseball glove" | "tennis racket"
        | "teddy bear" => 3.0,
        "bottle" | "wine glass" | "cup" | "fork" | "knife" | "spoon" | "bowl" | "banana"
        | "apple" | "sandwich" | "orange" | "broccoli" | "carrot" | "hot dog" | "pizza"
        | "donut" | "cake" | "laptop" | "mouse" | "remote" | "keyboard" | "cell phone" | "book"
        | "scissors" | "hair drier" | "toothbrush" => 2.0,
        "bench" | "couch" | "potted plant" | "bed" | "dining table" | "tv" | "microwave"
        | "oven" | "toaster" | "refrigerator" | "clock" | "vase" => 1.0,
        // Fixed to the ground or the wall: traffic light, fire hydrant, stop sign, parking meter, toilet, sink.
        _ => 0.0,
    }
}

/// The name as a bare TOML key.
fn key(class: ClassId) -> String {
    class.name().replace(' ', "_")
}

impl Serialize for MotionWeights {
    /// Only the classes that differ from their defaults, since 80 default lines would hide them.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let defaults = Self::default();
        let set = |(class, weight): &(ClassId, f64)| *weight != defaults.get(*class);
        let set: Vec<(ClassId, f64)> = self.iter().filter(set).collect();
        let mut map = serializer.serialize_map(Some(set.len()))?;
        for (class, weight) in set {
            map.serialize_entry(&key(class), &weight)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for MotionWeights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut weights = Self::default();
        for (name, weight) in BTreeMap::<String, f64>::deserialize(deserializer)? {
            weights.set(&name, weight).map_err(D::Error::custom)?;
        }
        Ok(weights)
    }
}
