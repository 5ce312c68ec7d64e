//! Ownership of points across all views: an object missed in one view is detected in others.
//!
//! A surface that explains its boxes well claims its points, so that a table is not carved out of the screen that hides it, nor a chair out
//! of the desk before it.

use super::assign::Group;
use super::part::stands;
use std::collections::BTreeMap;
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;
use stillpoint_map::SubmapId;

/// Side of the cells in which points are claimed, m.
const CELL: f64 = 0.05;
/// Minimum fit of a surface to its boxes for claiming points.
const LEAST_FIT: f64 = 0.6;
/// Minimum number of views with a detection for claiming points.
const LEAST_LOOKS: usize = 4;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Claimant {
    pub(crate) class: ClassId,
    pub(crate) submap: SubmapId,
    /// Fit of its surface to its boxes, 0 to 1.
    pub(crate) fit: f64,
    pub(crate) size: f64,
}

impl Claimant {
    pub(crate) fn of(group: &Group) -> Self {
        let far = Vec3::repeat(f64::INFINITY);
        let points = group.carved.points.iter();
        let (low, high) = points.fold((far, -far), |(low, high), p| {
            (low.inf(&p.1), high.sup(&p.1))
        });
        Self {
            class: group.class,
            submap: group.submap,
            fit: group.carved.fit,
            size: (high - low).norm(),
        }
    }

    /// Priority: objects on others come before those on the floor; of two on the floor the better explained, of two others the smaller one.
    fn goes_before(&self, other: &Self) -> bool {
        if self.class == other.class || self.submap != other.submap {
            return false;
        }
        match [self, other].map(|c| stands(c.class)) {
            [false, true] => true,
            [true, false] => false,
            [true, true] => self.fit > other.fit,
            [false, false] => self.size < other.size,
        }
    }
}

#[derive(Default)]
pub(crate) struct Claims {
    cells: BTreeMap<[i32; 3], Vec<usize>>,
    claimants: Vec<Claimant>,
}

impl Claims {
    pub(crate) fn new(groups: &[Group]) -> Self {
        let mut claims = Self::default();
        let sure = |g: &&Group| g.carved.fit >= LEAST_FIT && g.seen.len() >= LEAST_LOOKS;
        for group in groups.iter().filter(sure) {
            let number = claims.claimants.len();
            claims.claimants.push(Claimant::of(group));
            for (_, p) in &group.carved.points {
                let cell = claims.cells.entry(key(p)).or_default();
                if cell.last() != Some(&number) {
                    cell.push(number);
                }
            }
        }
        claims
    }

    /// Whether a point belongs to an object with priority over a claimant.
    pub(crate) fn taken(&self, p: &Vec3, by: &Claimant) -> bool {
        let cell = self.cells.get(&key(p));
        cell.is_some_and(|c| c.iter().any(|k| self.claimants[*k].goes_before(by)))
    }
}

fn key(p: &Vec3) -> [i32; 3] {
    p.map(|v| (v / CELL).floor() as i32).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claimant(class: &str, fit: f64, size: f64) -> Claimant {
        Claimant {
            class: ClassId::from_name(class).unwrap(),
            submap: SubmapId(0),
            fit,
            size,
        }
    }

    #[test]
    fn small_things_claim_points_first_and_floor_things_last() {
        let (table, chair) = (
            claimant("dining table", 0.9, 2.0),
            claimant("chair", 0.7, 1.2),
        );
        let (screen, cup) = (claimant("tv", 0.7, 0.6), claimant("cup", 0.8, 0.1));
        for (first, second) in [
            (screen, table),
            (cup, table),
            (cup, screen),
            (table, chair),
            (screen, chair),
        ] {
            assert!(first.goes_before(&second), "{first:?} {second:?}");
            assert!(!second.goes_before(&first), "{first:?} {second:?}");
        }
        assert!(!screen.goes_before(&claimant("tv", 0.1, 3.0)));
        let elsewhere = Claimant {
            submap: SubmapId(1),
            ..table
        };
        assert!(!screen.goes_before(&elsewhere));
    }
}
