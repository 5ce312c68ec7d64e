//! Which surface a corner lies on, and what follows for it.

use super::segments::LIMIT;
use super::semantic::{MOVER, Mover};
use super::surfaces::MOVES;
use super::{FeatureVerdict, Reasons, StaticFilter};
use stillpoint_imaging::DepthImage;

impl StaticFilter {
    /// A feature moves with the surface that it lies on.
    pub(super) fn judge_feature(
        &self,
        pixel: [f32; 2],
        image: &DepthImage,
        grid: &[f32],
        movers: &[Mover],
    ) -> FeatureVerdict {
        let [u, v] = pixel.map(f64::from);
        let (z, cell) = self.surface_at(pixel, image, grid);
        let in_box = movers
            .iter()
            .any(|m| m.strength > 0.0 && m.bounds.contains(u, v));
        // In a hole of the depth image nothing is known: most such corners are beside a silhouette, on the background.
        let (odds, evidence) = cell.map_or((0.0, 0.0), |c| {
            (self.surfaces.odds[c], self.surfaces.evidence[c])
        });
        let dynamic = odds > MOVES;
        let mut reasons = Reasons::default();
        if let Some(m) = movers
            .iter()
            .find(|m| (m.weight >= MOVER || m.strength > 0.0) && m.holds(u, v, z))
        {
            if dynamic && m.strength > 0.0 {
                reasons |= Reasons::OBJECT;
            } else if !dynamic && m.weight >= MOVER {
                reasons |= Reasons::PARKED;
            }
        } else if in_box && !dynamic {
            reasons |= Reasons::DEPTH;
        }
        if dynamic && evidence > 0.0 {
            reasons |= Reasons::RIGID;
        } else if dynamic && reasons.is_empty() {
            reasons |= Reasons::AGE;
        }
        FeatureVerdict {
            pixel,
            dynamic,
            reasons,
            risk: odds.clamp(-LIMIT, LIMIT),
        }
    }

    /// The depth (m; 0: none) at a raw pixel or next to it, and of the cells around it the one at that depth.
    fn surface_at(
        &self,
        pixel: [f32; 2],
        image: &DepthImage,
        grid: &[f32],
    ) -> (f32, Option<usize>) {
        let z = nearest_depth(image, pixel).unwrap_or(0.0);
        let home = self.rules.cells.at(pixel[0], pixel[1]);
        // Of a cell's width the surface itself may slope by this much.
        let mut best = (0.05 + 0.03 * z, None);
        self.rules.cells.for_each_around(home, |cell| {
            let gap = (grid[cell] - z).abs() + if cell == home { 0.0 } else { 0.01 };
            if z > 0.0 && grid[cell] > 0.0 && gap < best.0 {
                best = (gap, Some(cell));
            }
        });
        (z, best.1)
    }
}

/// The depth (m) of a raw pixel, else that of a neighbour: a corner on a silhouette has its depth on either side.
fn nearest_depth(image: &DepthImage, [u, v]: [f32; 2]) -> Option<f32> {
    const NEAR: [(i32, i32); 9] = [
        (0, 0),
        (-1, 0),
        (1, 0),
        (0, -1),
        (0, 1),
        (-1, -1),
        (1, -1),
        (-1, 1),
        (1, 1),
    ];
    let (u, v) = (libm::roundf(u) as i32, libm::roundf(v) as i32);
    let at = |(dx, dy): &(i32, i32)| {
        let (x, y) = (u + dx, v + dy);
        let inside = x >= 0 && y >= 0 && x < image.width() as i32 && y < image.height() as i32;
        Some(image.at(inside.then_some(x as usize)?, y as usize)).filter(|z| *z > 0.0)
    };
    NEAR.iter().find_map(at)
}
