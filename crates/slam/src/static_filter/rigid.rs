//! The rigid test of single features: did the flow take them where a static scene would have?

use super::FlowPair;
use super::cells::Cells;
use stillpoint_geometry::{Camera, Se3, Vec2};

/// A feature farther from where a static scene would have it than this moves, px: flow errs by a third of a pixel, the
/// pose before the filter and a rolling shutter by as much again.
const MOVING_PX: f64 = 2.0;
/// A feature nearer than this agrees with a static scene, px.
const STATIC_PX: f64 = 1.2;
/// A moving feature is this much farther than what is typical of the frame: the pose before the filter may be off by pixels.
const EXCESS: f64 = 4.0;
/// With fewer static votes than this share, the camera's motion is in doubt rather than the scene.
const MIN_STATIC_SHARE: f64 = 0.15;

/// What one feature says of the surface it lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Vote {
    pub(super) cell: usize,
    pub(super) moving: bool,
}

/// How far a feature is from where a static scene would have it in the frame before, px; `None` without flow or depth.
pub(super) fn distance_px(
    camera: &Camera,
    pair: &FlowPair,
    z: f32,
    last_from_now: &Se3,
) -> Option<f64> {
    if z <= 0.0 {
        return None;
    }
    let p = last_from_now.transform(&camera.backproject(pair.now, f64::from(z)));
    if p.z <= 0.05 {
        return None;
    }
    let expected: Vec2 = camera.project(&p);
    Some((pair.before - expected).norm())
}

/// The votes of all features that are clear, none when the camera's own motion is in doubt. `distances` belong to
/// `pixels` (raw px).
pub(super) fn votes(cells: &Cells, pixels: &[[f32; 2]], distances: &[Option<f64>]) -> Vec<Vote> {
    let scale = EXCESS * typical(distances);
    let (moving, still) = (MOVING_PX.max(scale), STATIC_PX.max(0.5 * scale));
    let vote = |(p, d): (&[f32; 2], &Option<f64>)| {
        let d = (*d)?;
        (!(still..=moving).contains(&d)).then(|| Vote {
            cell: cells.at(p[0], p[1]),
            moving: d > moving,
        })
    };
    let votes: Vec<Vote> = pixels.iter().zip(distances).filter_map(vote).collect();
    let still = votes.iter().filter(|v| !v.moving).count();
    if (still as f64) < MIN_STATIC_SHARE * votes.len() as f64 {
        return Vec::new();
    }
    votes
}

/// The distance that three in ten features stay within, px: that of static ones, even when people are half of the image.
fn typical(distances: &[Option<f64>]) -> f64 {
    let mut known: Vec<f64> = distances.iter().flatten().copied().collect();
    if known.is_empty() {
        return 0.0;
    }
    let at = known.len() * 3 / 10;
    *known.select_nth_unstable_by(at, f64::total_cmp).1
}
