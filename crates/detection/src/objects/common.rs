//! Numbers that several rules share.

/// Looks of a detector after which a thing is believed that one look may have wrong, a number: false alarms come twice in a row now and then (section 14 of docs/algorithm.md).
pub(super) const LOOKS: u32 = 3;
/// Most of a box, a side or a surface, as a share: the majority (section 14 of docs/algorithm.md).
pub(super) const HALF: f64 = 0.5;
/// A good part of a box, as a share: one surface has to fill it before its middle, its overlap or its continuation beside the box says anything (section 14 of docs/algorithm.md).
pub(super) const MUCH: f64 = 0.4;
/// A part of a box that counts, as a share: less is a stray surface, or hides little. Measured: 0.2 and 0.3 in sight and in view are alike.
pub(super) const PART: f64 = 0.25;
/// Time of a step, s: a person walks at about two steps a second, and sways meanwhile. Measured: 0.4 for who is out of sight is alike.
pub(super) const STEP: f64 = 0.3;
/// Boxes of one thing overlap by this share though its name, its depth or its shape says otherwise (intersection over union; of a box that the border cuts, the part in the
/// larger): measured, 0.55 to 0.7 are alike on simulated and on real people.
pub(super) const SAME_BOX: f64 = 0.6;
