//! Whether a surface goes on beyond the boxes that it was carved by.
//!
//! What is behind a thing meets the borders of its boxes as well as the thing does, since it was cut there. But it goes on behind them, and a thing ends.

use super::look::{Placed, tolerance};
use stillpoint_geometry::Vec2;

/// Points this near to a border are at it, and what is looked at is this far beyond it, px: the small image has a point every 6 px, and boxes jitter.
const NEAR: f64 = 12.0;
/// Surfaces are seen under angles of up to 70 degrees: by so many times the distance of two points across the line of sight their depths differ.
const SLOPE: f64 = 2.7;

/// Of places beyond the borders of a box, next to a point of a surface that is in sight, in how many the surface goes on, and of how many that is known.
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
    fn what_was_cut_by_a_box_goes_on_and_what_ends_with_it_does_not() {
        let grid = Grid::new(&Camera::pinhole(640, 480, [525.0, 525.0, 320.0, 240.0]));
        // A surface at 2 m left of the middle of the image, a wall at 4 m right of it.
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
        // Within the box nothing is asked, and beyond the image nothing is known.
        assert_eq!(at(192.0, 2.0, 320.0), [0, 0]);
        assert_eq!(at(636.0, 4.0, 639.0), [0, 0]);
    }
}
