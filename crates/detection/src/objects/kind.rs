//! Mobility of classes, and confusable classes.

use crate::{ClassId, MotionWeights};
use std::sync::LazyLock;

/// Mobility of a class relative to people: 1 if it moves by itself.
pub(super) fn liveliness(class: ClassId) -> f64 {
    static WEIGHTS: LazyLock<MotionWeights> = LazyLock::new(MotionWeights::default);
    let weight = WEIGHTS.get(class);
    if weight >= 4.0 {
        1.0
    } else {
        0.1 + 0.1 * weight
    }
}

/// Whether a detector may give one object both classes. Detectors do not confuse people with things.
pub(super) fn may_be_one(a: ClassId, b: ClassId) -> bool {
    a == b || (liveliness(a) < 1.0 && liveliness(b) < 1.0)
}
