//! Detects surfaces that continue beyond the boxes that carved them.
//!
//! Background carved by an object's boxes matches their borders as well as the object does. But background continues beyond them, and the
//! object ends.

use super::look::{Placed, tolerance};
use stillpoint_geometry::Vec2;

/// Distance within which points count as being at a border, and distance beyond it that is checked, px: the reduced image has a point every
/// 6 px, and boxes jitter.
const NEAR: f64 = 12.0;
/// Maximum depth difference of two surface points relative to their distance across the line of sight: surfaces are seen at angles up to 70
/// degrees.
const SLOPE: f64 = 2.7;

/// For a visible surface point, the number of checked places beyond adjacent box borders where the surface continues, and the number of
/// places with known depth.
pub(crate) fn beyond(placed: &Placed<'_>, bounds: &[f32; 4], px: Vec2, z: f64) -> [u32; 2] {
    let [x0, y0, x1, y1] = bounds.map(f64::from);
    let sides = [
        (px.x - x0, Vec2::new(x0 - NEAR, px.y)),
        (x1 - px.x, Vec2::new(x1 + NEAR, px.y)),
        (px.y - y0, Vec2::new(px.x, y0 - NEAR)),
        (y1 - px.y, Vec2::new(px.x, y1 + NEAR)),
    ];
    let mut counts = [0, 0];
    for (_, place) in sides.into_iter().filter(|s| s.0.abs() < NEAR) {
        let seen = placed
            .grid
            .nearest(place)
            .map_or(0.0, |i| placed.look.depth(i));
        if seen > 0.0 {
            let across = (place - px).norm() * z / placed.grid.camera.fx;
            counts[0] += u32::from((seen - z).abs() < tolerance(z).max(SLOPE * across));
            counts[1] += 1;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::super::look::{Grid, Look};
    use super::*;
    use crate::kept::Anchor;
    use stillpoint_geometry::{Camera, Se3};

    #[test]
    fn surface_continuation_beyond_a_box_is_detected() {
        let grid = Grid::new(&Camera::pinhole(640, 480, [525.0, 525.0, 320.0, 240.0]));
        // A surface at 2 m left of the image centre, a wall at 4 m right of it.
        let depth = |i: usize| if grid.pixel(i).x < 320.0 { 2000 } else { 4000 };
        let look = Look {
            stamp: 0.0,
            anchor: Anchor {
                own: None,
                reference: None,
                online: Se3::identity(),
                submap: None,
            },
            depths: (0..grid.columns * grid.rows).map(depth).collect(),
            sightings: Vec::new(),
        };
        let placed = Placed::at(&look, &grid, Se3::identity());
        let at = |x: f64, z: f64, x1: f32| {
            let bounds = [100.0, 100.0, x1, 400.0];
            beyond(&placed, &bounds, Vec2::new(x, 240.0), z)
        };
        assert_eq!(at(312.0, 2.0, 320.0), [0, 1]);
        assert_eq!(at(192.0, 2.0, 200.0), [1, 1]);
        assert_eq!(at(492.0, 4.0, 500.0), [1, 1]);
        // Inside the box nothing is checked, and outside of the image nothing is known.
        assert_eq!(at(192.0, 2.0, 320.0), [0, 0]);
        assert_eq!(at(636.0, 4.0, 639.0), [0, 0]);
    }
}
