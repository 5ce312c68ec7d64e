//! Detached parts of one object: several pieces of a desk behind screens are visible.
//!
//! A detector gives one box for all of them. So one part is detected while the other is visible, again and again; two separate objects
//! would sometimes both be detected.

use super::merge::Part;
use super::scope::largest;
use stillpoint_geometry::Vec3;

/// Maximum gap between two parts of one object, as a share of the diagonal of both.
const GAP: f64 = 0.3;
/// Minimum number of views that show both parts with a detection of only one. If two objects are missed every third time, both are missed
/// together with odds of one in fifty.
const LEAST_LOOKS: usize = 4;

/// Whether two parts of a class belong to one object, by their positions and detections.
pub(crate) fn is_rest(a: &Part, b: &Part) -> bool {
    let Some(most) = largest(a.class()) else {
        return false;
    };
    let ([low, high], [other_low, other_high]) = (range(a), range(b));
    let gap = (low - other_high).sup(&(other_low - high));
    let whole = (high.sup(&other_high) - low.inf(&other_low)).norm();
    if whole > most || gap.sup(&Vec3::zeros()).norm() > GAP * whole {
        return false;
    }
    let alone = |a: &Part, b: &Part| {
        let only = |l: &&usize| b.shown.contains(l) && !b.looks.contains(l);
        a.looks.iter().filter(only).count()
    };
    let together = a.looks.intersection(&b.looks).next().is_some();
    !together && alone(a, b) + alone(b, a) >= LEAST_LOOKS
}

fn range(part: &Part) -> [Vec3; 2] {
    let far = Vec3::repeat(f64::INFINITY);
    let points = part.points.iter();
    points.fold([far, -far], |[low, high], p| {
        [low.inf(&p.1), high.sup(&p.1)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::things::part::Point;
    use crate::things::upright::UprightBox;
    use std::collections::{BTreeMap, BTreeSet};
    use stillpoint_detection::ClassId;
    use stillpoint_geometry::Mat3;
    use stillpoint_map::{KeyframeId, SubmapId};

    /// Half a metre of a surface at x, detected in some of the views 0 to 19, all of which show it.
    fn piece(class: &str, x: f64, looks: impl Iterator<Item = usize>) -> Part {
        let at = |k: u32| Vec3::new(x + 0.05 * f64::from(k), 0.0, 0.7);
        let point = Point::new(KeyframeId(0), &Vec3::zeros()).unwrap();
        Part {
            votes: BTreeMap::from([(ClassId::from_name(class).unwrap(), 1.0)]),
            looks: looks.collect(),
            shown: (0..20).collect(),
            known: Vec::new(),
            files: BTreeSet::new(),
            submap: SubmapId(0),
            points: (0..=10).map(|k| (point, at(k))).collect(),
            bounds: UprightBox {
                centre: at(5),
                size: Vec3::new(0.5, 0.0, 0.0),
                world_from_box: Mat3::identity(),
            },
            seen: [0.0, 1.0],
            farthest: 2.0,
        }
    }

    #[test]
    fn detached_parts_of_a_table_are_recognised() {
        let left = piece("dining table", 0.0, 0..8);
        assert!(is_rest(
            &left,
            &piece("dining table", 0.8, [9, 12].into_iter())
        ));
        // Two tables are sometimes detected together.
        assert!(!is_rest(&left, &piece("dining table", 0.8, 7..16)));
        // Parts that are far apart, or too large together, are different objects.
        assert!(!is_rest(&left, &piece("dining table", 1.2, 9..16)));
        assert!(!is_rest(&left, &piece("dining table", 6.0, 9..16)));
        // Without a known size there is no decision, and chairs are smaller.
        assert!(!is_rest(
            &piece("book", 0.0, 0..8),
            &piece("book", 0.6, 9..16)
        ));
        assert!(!is_rest(
            &piece("chair", 0.0, 0..8),
            &piece("chair", 0.6, 9..16)
        ));
        // Views that do not show the other part do not count.
        let mut right = piece("dining table", 0.8, std::iter::once(9));
        right.shown = BTreeSet::from([9]);
        let mut left = left;
        left.shown = (0..8).collect();
        assert!(!is_rest(&left, &right));
    }
}
