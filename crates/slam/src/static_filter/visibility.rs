//! The rigid test of whole surfaces: was each cell's surface there before, or did earlier frames see through its place?
//!
//! A cell of the present depth image is carried into earlier frames by the camera's motion. Where the earlier depth agrees, the
//! surface may have stood there all the time; where the earlier depth is farther, the place was empty, so the surface has
//! moved; where it is nearer, the place was hidden and nothing is known. Agreement soon after says little, since slow
//! things stay under the noise; seeing through is proof at any age. (docs/algorithm.md, free-space test.)

use super::cells::{Cells, depth_tolerance};
use stillpoint_geometry::Se3;
use stillpoint_imaging::CoarseDepth;

/// Evidence of one earlier frame against or for a cell, in log odds of "moving".
const SEEN_THROUGH: f32 = 4.0;
/// Agreement with a frame `age` seconds earlier counts this much per second, up to `MATCH_LIMIT`.
const MATCH_PER_SECOND: f32 = 4.5;
const MATCH_LIMIT: f32 = 2.0;
/// What moves was moving a little before it was found to, s.
const MARGIN: f64 = 0.3;
/// Of the neighbours of the place in the earlier frame, this many must have depth to call it empty.
const MIN_VALID: u32 = 5;

/// An earlier frame's depth, with its pose at the depth image's stamp.
pub(super) struct Earlier<'a> {
    pub(super) grid: &'a CoarseDepth,
    /// Per cell, whether it was found to move.
    pub(super) moving: &'a [bool],
    pub(super) earlier_from_now: Se3,
    /// When it was taken, s.
    pub(super) stamp: f64,
    /// Seconds ago.
    pub(super) age: f64,
}

/// A rigid motion in single precision, for points given by ray and depth.
pub(super) struct Motion {
    r: [[f32; 3]; 3],
    t: [f32; 3],
}

impl Motion {
    pub(super) fn new(pose: &Se3) -> Self {
        let r = pose.rotation_matrix();
        Self {
            r: [0, 1, 2].map(|i| [0, 1, 2].map(|j| r[(i, j)] as f32)),
            t: [0, 1, 2].map(|i| pose.translation[i] as f32),
        }
    }

    /// The moved point at depth `z` (m) along a ray (x/z, y/z).
    pub(super) fn apply(&self, [x, y]: [f32; 2], z: f32) -> [f32; 3] {
        let (x, y) = (x * z, y * z);
        [0, 1, 2].map(|i| self.r[i][0] * x + self.r[i][1] * y + self.r[i][2] * z + self.t[i])
    }
}

/// Adds the evidence of one earlier frame to each cell's log odds.
pub(super) fn add_evidence(
    cells: &Cells,
    now: &CoarseDepth,
    earlier: &Earlier<'_>,
    moved_at: &[Option<f64>],
    evidence: &mut [f32],
) {
    let weight = (MATCH_PER_SECOND * earlier.age as f32).min(MATCH_LIMIT);
    let motion = Motion::new(&earlier.earlier_from_now);
    let before = earlier.grid.data();
    let rays = cells.rays();
    for (cell, &z) in now.data().iter().enumerate() {
        if z <= 0.0 {
            continue;
        }
        let p = motion.apply(rays[cell], z);
        let Some(place) = cells.project(p).filter(|c| cells.has_neighbours(*c)) else {
            continue;
        };
        match compare((before, earlier.moving), cells.width, place, p[2]) {
            Seen::Through => evidence[cell] += SEEN_THROUGH,
            // Of a thing that was seen to move, having stopped since says nothing: it may go on at any time.
            Seen::Same if moved_at[cell].is_some_and(|t| earlier.stamp > t - MARGIN) => {}
            Seen::Same => evidence[cell] -= weight,
            Seen::Hidden => {}
        }
    }
}

/// What an earlier frame says of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// It was empty.
    Through,
    /// A surface was there.
    Same,
    /// Something in front of it, or no depth.
    Hidden,
}

/// Compares a depth with the 3x3 cells around its place. A surface that was moving then and is at the same depth is not the
/// same thing standing still: large things overlap with where they were.
pub(super) fn compare(
    (before, moving): (&[f32], &[bool]),
    width: usize,
    place: usize,
    z: f32,
) -> Seen {
    let tolerance = depth_tolerance(z);
    let (mut valid, mut farther, mut same) = (0, 0, false);
    for row in [place - width, place, place + width] {
        for i in row - 1..=row + 1 {
            let there = before[i];
            valid += u32::from(there > 0.0);
            farther += u32::from(there > z + tolerance);
            same |= there > 0.0 && (there - z).abs() <= tolerance && !moving[i];
        }
    }
    if same {
        Seen::Same
    } else if valid >= MIN_VALID && farther == valid {
        Seen::Through
    } else {
        Seen::Hidden
    }
}
