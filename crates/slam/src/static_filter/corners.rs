//! Assigns corners to surfaces and derives their verdicts.

use super::cells::{Cells, coarse};
use super::rigid::Votes;
use super::segments::LIMIT;
use super::semantic::{MOVER, Mover};
use super::surfaces::MOVES;
use super::{FeatureVerdict, Preset, Reasons, StaticFilter};
use std::ops::Range;
use stillpoint_detection::Object;
use stillpoint_imaging::{DepthImage, RgbdFrame};

/// Distance within which a corner without depth may belong to a moving object, cells: dark clothes below a face, hair
/// above it. Chosen: 24 px, which is 9 cm at 2 m.
const NEAR_CELLS: usize = 3;
/// Minimum number of corners without depth near a pixel for their flow to decide whether it moves: one corner alone
/// costs accuracy (decision 4). Chosen: four, of which all have to agree (`HOLE_SHARE`).
const HOLE_VOTES: u32 = 4;
/// A pixel without depth moves if the flow of more than this share of the corners without depth near it shows motion:
/// most have to agree, as flow errs most beside silhouettes (decision 4).
const HOLE_SHARE: f64 = 0.75;

impl StaticFilter {
    /// Verdict of a feature from the surface that it lies on. Without depth `moves` decides, from the log odds of the
    /// surface seen there recently (0 if none).
    pub(super) fn judge_feature(
        &self,
        pixel: [f32; 2],
        (image, grid): (&DepthImage, &[f32]),
        movers: &[Mover],
        moves: impl FnOnce(f32) -> bool,
    ) -> FeatureVerdict {
        let [u, v] = pixel.map(f64::from);
        let (z, cell) = self.surface_at(pixel, image, grid);
        let in_box = movers
            .iter()
            .any(|m| m.strength > 0.0 && m.bounds.contains(u, v));
        let (odds, evidence) = cell.map_or((0.0, 0.0), |c| {
            (self.surfaces.odds[c], self.surfaces.evidence[c])
        });
        let is_measured = z > 0.0 && cell.is_none_or(|c| grid[c] > 0.0);
        let dynamic = if is_measured {
            odds > MOVES
        } else {
            moves(odds)
        };
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

    /// Verdicts for arbitrary raw pixels of the last judged frame, with its objects.
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
        let judge =
            |pixel: &[f32; 2]| self.judge_feature(*pixel, depth, &movers, |odds| odds > MOVES);
        pixels.iter().map(judge).collect()
    }

    /// Whether corners without depth are judged by their flow. With a detector this is unnecessary: it finds people in
    /// any clothes, and most such corners are on the background.
    pub(super) fn asks_holes(&self) -> bool {
        self.rules.config.preset == Preset::Default && !self.detected
    }

    /// Whether a feature without depth, at this raw pixel of the last frame, is near a moving surface, so that its flow
    /// is needed.
    pub(crate) fn is_suspect(&self, pixel: [f32; 2]) -> bool {
        self.asks_holes() && self.moves_near(pixel)
    }

    /// Weight of a raw pixel of the last frame in the estimate of camera motion: its probability of being static.
    pub(crate) fn say(&self, [u, v]: [f32; 2]) -> f64 {
        let odds = self.surfaces.odds[self.rules.cells.at(u, v)];
        1.0 / (1.0 + libm::exp(f64::from(odds)))
    }

    pub(super) fn moves_near(&self, pixel: [f32; 2]) -> bool {
        let odds = &self.surfaces.odds;
        self.near(pixel)
            .any(|row| odds[row].iter().any(|odds| *odds > MOVES))
    }

    /// Whether most corners without depth near a raw pixel move, by their flow. Most such corners are on the background
    /// beside a silhouette, where flow is least reliable, so one alone is no evidence.
    pub(super) fn hole_moves(&self, pixel: [f32; 2], votes: &Votes) -> bool {
        let (mut moving, mut all) = (0, 0);
        if votes.holes.is_empty() {
            return false;
        }
        for [m, n] in self.near(pixel).flat_map(|row| &votes.holes[row]) {
            moving += u32::from(*m);
            all += u32::from(*n);
        }
        all >= HOLE_VOTES && f64::from(moving) > HOLE_SHARE * f64::from(all)
    }

    fn near(&self, [u, v]: [f32; 2]) -> impl Iterator<Item = Range<usize>> {
        let Cells { width, height, .. } = self.rules.cells;
        let home = self.rules.cells.at(u, v);
        let around = |at: usize, count: usize| {
            at.saturating_sub(NEAR_CELLS)..(at + NEAR_CELLS + 1).min(count)
        };
        let columns = around(home % width, width);
        around(home / width, height)
            .map(move |y| y * width + columns.start..y * width + columns.end)
    }

    /// The depth (m; 0: none) at or next to a raw pixel, and the surrounding cell with that depth.
    fn surface_at(
        &self,
        pixel: [f32; 2],
        image: &DepthImage,
        grid: &[f32],
    ) -> (f32, Option<usize>) {
        let z = nearest_depth(image, pixel).unwrap_or(0.0);
        let home = self.rules.cells.at(pixel[0], pixel[1]);
        // Slope of a surface within a cell.
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

/// The depth (m) of a raw pixel, else that of a neighbour: a corner on a silhouette may have depth on one side only.
fn nearest_depth(image: &DepthImage, [u, v]: [f32; 2]) -> Option<f32> {
    /// The pixel and its eight neighbours, px, adjacent ones before diagonal ones.
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
