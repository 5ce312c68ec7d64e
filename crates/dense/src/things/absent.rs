//! What has been carried away: cameras see through its place.

use super::carve::evenly;
use super::look::{Placed, Shown};
use super::merge::Part;
use std::collections::BTreeSet;
use stillpoint_geometry::Vec3;

/// Points whose places are looked at.
const POINTS: usize = 80;
/// Points that say anything, at least.
const LEAST_POINTS: usize = 6;
/// Share of the points behind which a look sees something from which the place is empty. Borders always do; a chair is full of gaps.
const EMPTY: f64 = 0.7;
/// Share of the points that have a surface from which the thing is there.
const THERE: f64 = 0.5;
/// Looks in a row that have to see through: people and poses err for a moment.
const LEAST_LOOKS: usize = 6;
/// Things are found a little farther away than they were so far.
const FARTHER: f64 = 1.05;

/// What the looks of a run say of a thing that they could see.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Presence {
    /// Looks that showed it and in which it was not found, though it was as near as when it was.
    pub(crate) missed: u32,
    /// Whether the last looks at its place saw through it.
    pub(crate) gone: bool,
}

/// The looks that show a thing where it is.
pub(crate) fn shown(part: &Part, looks: &[Placed<'_>]) -> BTreeSet<usize> {
    let points = probes(part);
    let shows = |l: &usize| {
        let placed = &looks[*l];
        placed.submap == part.submap && verdict(&points, placed) == Some(true)
    };
    (0..looks.len()).filter(shows).collect()
}

/// The points whose places are looked at.
fn probes(part: &Part) -> Vec<Vec3> {
    let all: Vec<Vec3> = part.points.iter().map(|p| p.1).collect();
    evenly(&all, POINTS).into_iter().map(|i| all[i]).collect()
}

/// Goes through the looks in the order of time.
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

/// Whether a look shows a thing, or through it; none where it says neither.
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
