//! Detects removed objects: cameras see through their places.

use super::carve::evenly;
use super::look::{Placed, Shown};
use super::merge::Part;
use std::collections::BTreeSet;
use stillpoint_geometry::Vec3;

/// Number of surface points that are checked.
const POINTS: usize = 80;
/// Minimum number of points that are visible or seen through.
const LEAST_POINTS: usize = 6;
/// Share of seen-through points from which a view shows the place as empty. Borders are always seen through; a chair is full of gaps.
const EMPTY: f64 = 0.7;
/// Share of points with a surface from which the object is present.
const THERE: f64 = 0.5;
/// Number of consecutive views that must see through, to bridge people and pose errors.
const LEAST_LOOKS: usize = 6;
/// Factor on the largest depth at which the object was detected, up to which a missed detection counts.
const FARTHER: f64 = 1.05;

/// Evidence of a run's views about a known object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Presence {
    /// Number of views that show it without a detection, although it was as near as when detected.
    pub(crate) missed: u32,
    /// Whether the last views at its place saw through it.
    pub(crate) gone: bool,
}

/// The views in which the object is visible.
pub(crate) fn shown(part: &Part, looks: &[Placed<'_>]) -> BTreeSet<usize> {
    let points = probes(part);
    let shows = |l: &usize| {
        let placed = &looks[*l];
        placed.submap == part.submap && verdict(&points, placed) == Some(true)
    };
    (0..looks.len()).filter(shows).collect()
}

fn probes(part: &Part) -> Vec<Vec3> {
    let all: Vec<Vec3> = part.points.iter().map(|p| p.1).collect();
    evenly(&all, POINTS).into_iter().map(|i| all[i]).collect()
}

pub(crate) fn presence(part: &Part, looks: &[Placed<'_>]) -> Presence {
    let points = probes(part);
    let mut presence = Presence::default();
    let mut through = 0;
    for (number, placed) in looks.iter().enumerate() {
        if part.looks.contains(&number) {
            through = 0;
        } else if placed.submap == part.submap {
            match verdict(&points, placed) {
                Some(true) => {
                    through = 0;
                    let depth = placed.project(&part.bounds.centre).map(|p| p.1);
                    let near = depth.is_some_and(|z| z < FARTHER * part.farthest);
                    presence.missed += u32::from(near);
                }
                Some(false) => through += 1,
                None => {}
            }
        }
    }
    presence.gone = through >= LEAST_LOOKS;
    presence
}

/// True if a view shows the object, false if it sees through it; `None` if undecided.
fn verdict(points: &[Vec3], placed: &Placed<'_>) -> Option<bool> {
    let (mut there, mut nearer, mut farther) = (0, 0, 0);
    for p in points {
        match placed.shows(p) {
            Shown::Point => there += 1,
            Shown::Nearer => nearer += 1,
            Shown::Farther => farther += 1,
            Shown::Nothing => {}
        }
    }
    let seen = there + farther;
    let enough = LEAST_POINTS.max(points.len() / 4);
    let share = |n: usize, of: usize| n as f64 / of.max(1) as f64;
    if seen >= enough && share(farther, seen) >= EMPTY {
        return Some(false);
    }
    let shown = seen + nearer;
    (2 * shown >= points.len() && share(there, shown) >= THERE).then_some(true)
}
