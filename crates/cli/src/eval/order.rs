//! Detects quaternions in the wrong component order.

use crate::console;
use stillpoint::evaluation::{OrderOf, TimedPose, find_other_order};

/// Warns where the quaternions of ground truth or estimate fit far better in the other order.
pub(crate) fn remark(reference: &[TimedPose], estimate: &[TimedPose]) {
    let Some(found) = find_other_order(reference, estimate) else {
        return;
    };
    let whose = match found.of {
        OrderOf::Reference => "ground truth",
        OrderOf::Estimate => "estimate",
    };
    let (order, names) = if found.w_first {
        ("w first", "qw qx qy qz")
    } else {
        ("w last", "qx qy qz qw")
    };
    console::warn(&format!(
        "the quaternions of the {whose} seem to have {order}: read so, turns over a second are wrong by {:.1} degrees instead of {:.1} (the ATE is not concerned); to say so, begin its file with the line \"# timestamp tx ty tz {names}\"",
        found.rotation_deg, found.rotation_deg_as_read
    ));
}
