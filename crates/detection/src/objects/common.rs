//! Constants shared by several rules.

/// Number of detections after which an object or a change is believed: false alarms come twice in a row now and then
/// (section 14 of docs/algorithm.md).
pub(super) const LOOKS: u32 = 3;
/// Most of a box, a side or a surface, as a share: the majority (section 14 of docs/algorithm.md).
pub(super) const HALF: f64 = 0.5;
/// A large part of a box, as a share: one surface must fill it before its middle, its overlap or its continuation
/// beside the box is used (section 14 of docs/algorithm.md).
pub(super) const MUCH: f64 = 0.4;
/// A relevant part of a box, as a share: less is a stray surface, or hides little. Measured: 0.2 and 0.3 in sight and
/// in view are alike.
pub(super) const PART: f64 = 0.25;
/// Time of a step, s: a person walks at about two steps a second, and sways meanwhile. Measured: 0.4 for people out of
/// sight is alike.
pub(super) const STEP: f64 = 0.3;
/// Minimum overlap of boxes of one object despite different class, depth or shape, as a share (intersection over union;
/// of a box cut by the border, the part inside the larger): measured, 0.55 to 0.7 are alike on simulated and on real
/// people.
pub(super) const SAME_BOX: f64 = 0.6;
