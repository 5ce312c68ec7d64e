//! Kinds of things: how lively they are, and which of them detectors confuse.

use crate::{ClassId, MotionWeights};
use std::sync::LazyLock;

/// How lively things of a class are, beside people: 1 for what moves by itself.
pub(super) fn liveliness(class: ClassId) -> f64 {
    static WEIGHTS: LazyLock<MotionWeights> = LazyLock::new(MotionWeights::default);
    let weight = WEIGHTS.get(class);
    if weight >= 4.0 {
        1.0
    } else {
        0.1 + 0.1 * weight
    }
}

/// Whether a detector may call one thing by both names. People are told from things by all detectors.
pub(super) fn may_be_one(a: ClassId, b: ClassId) -> bool {
    a == b || (liveliness(a) < 1.0 && liveliness(b) < 1.0)
}
