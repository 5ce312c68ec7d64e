//! Which surface a corner lies on, and what follows for it.

use super::cells::coarse;
use super::segments::LIMIT;
use super::semantic::{MOVER, Mover};
use super::surfaces::MOVES;
use super::{FeatureVerdict, Preset, Reasons, StaticFilter};
use stillpoint_detection::Object;
use stillpoint_imaging::{DepthImage, RgbdFrame};

impl StaticFilter {
    /// A feature moves with the surface that it lies on, or where its depth is not known, that was there shortly before.
    pub(super) fn judge_feature(
        &self,
        pixel: [f32; 2],
        (image, grid): (&DepthImage, &[f32]),
        movers: &[Mover],
    ) -> FeatureVerdict {
        let [u, v] = pixel.map(f64::from);
        let (z, cell) = self.surface_at(pixel, image, grid);
        let in_box = movers
            .iter()
            .any(|m| m.strength > 0.0 && m.bounds.contains(u, v));
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

    /// What is said of any raw pixels of the frame that was judged last, in which these objects were.
    pub(crate) fn judge_pixels(
        &self,
        frame: &RgbdFrame,
        objects: &[Object],
        pixels: &[[f32; 2]],
    ) -> Vec<FeatureVerdict> {
        if self.rules.config.preset != Preset::Default {
            return pixels.iter().map(|p| FeatureVerdict::kept(*p)).collect();
        }
        let grid = coarse(&frame.depth);
        let movers = self.movers(objects, frame.stamp);
        let depth = (&frame.depth, grid.data());
        let judge = |pixel: &[f32; 2]| self.judge_feature(*pixel, depth, &movers);
        pixels.iter().map(judge).collect()
    }

    /// How much say what the last frame shows at a raw pixel has in how the camera moved: as much as it is likely to stand still, 0 to 1.
    pub(crate) fn say(&self, [u, v]: [f32; 2]) -> f64 {
        let odds = self.surfaces.odds[self.rules.cells.at(u, v)];
        1.0 / (1.0 + libm::exp(f64::from(odds)))
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
        let held = self.surfaces.depth[home];
        if z == 0.0 && grid[home] == 0.0 && held > 0.0 {
            return (held, Some(home));
        }
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
