//! The static filter: which features of a frame stand still.
//!
//! Answers per feature, with reasons, before the pose is measured from those that do. Owns what is remembered of earlier
//! frames for that purpose; does not move the camera or change the map.

mod cells;
mod segments;
mod verdict;
mod visibility;

pub use verdict::{FeatureVerdict, Reasons};

use crate::config::Checker;
use cells::Cells;
use segments::{LIMIT, Links};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{CoarseDepth, DepthImage};
use stillpoint_map::{KeyframeId, MapView};
use visibility::{Earlier, Snapshot};

/// Which strategy rejects features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// Every feature counts as static.
    Off,
    /// Objects, epipolar constraint and depth, fused as published.
    Paper,
    /// Log odds per depth-connected region from objects, free space, flow and the past.
    #[default]
    Default,
}

/// Rejection of what moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StaticFilterConfig {
    /// Strategy: "off", "paper" (objects, epipolar constraint and depth as published) or "default".
    pub preset: Preset,
    /// Uses objects (O). Range: true or false.
    pub objects: bool,
    /// Uses flow between frames (G): the epipolar constraint, and in preset "default" the rigid test. Range: true or false.
    pub geometry: bool,
    /// Uses depth within boxes (D). Range: true or false.
    pub depth: bool,
    /// Fewer static features than this starve tracking: the least risky dynamic ones are released. Range: 0 to 1000.
    pub min_features: usize,
}

impl Default for StaticFilterConfig {
    fn default() -> Self {
        Self {
            preset: Preset::Default,
            objects: true,
            geometry: true,
            depth: true,
            min_features: 80,
        }
    }
}

impl StaticFilterConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_features", self.min_features as f64, 0.0, 1000.0);
    }
}

/// Ages of the frames that a frame is compared with, s: from a few frames, for fast things, to seconds, for slow ones.
const AGES: [f64; 5] = [0.2, 0.4, 0.8, 1.6, 3.0];
/// Frames are kept for comparison this long, s.
const HISTORY: f64 = 3.2;
/// Share of a surface's log odds that it keeps from frame to frame.
const KEEP: f32 = 0.85;
/// Log odds above which a cell moves.
const THRESHOLD: f32 = 1.0;

/// What the filter is told of a frame.
pub(crate) struct FrameInput<'a> {
    pub(crate) stamp: f64,
    pub(crate) depth: &'a DepthImage,
    pub(crate) view: &'a MapView,
    /// Camera at the depth image's stamp, as well as it is known before the pose is measured.
    pub(crate) world_from_depth: Se3,
    /// Features: raw pixels and depths (0: none).
    pub(crate) features: &'a [([f32; 2], f32)],
}

/// The state of a frame that [`StaticFilter::remember`] keeps.
struct Present {
    stamp: f64,
    grid: Arc<CoarseDepth>,
}

/// Tells what stands still.
pub(crate) struct StaticFilter {
    config: StaticFilterConfig,
    cells: Cells,
    history: VecDeque<Snapshot>,
    /// Log odds of "moving" per cell of the last frame judged.
    odds: Vec<f32>,
    present: Option<Present>,
}

impl StaticFilter {
    pub(crate) fn new(config: StaticFilterConfig, camera: &Camera) -> Self {
        let cells = Cells::new(camera);
        Self {
            config,
            odds: vec![0.0; cells.count()],
            cells,
            history: VecDeque::new(),
            present: None,
        }
    }

    /// Judges the features of a frame.
    pub(crate) fn judge(&mut self, input: &FrameInput<'_>) -> Vec<FeatureVerdict> {
        let _span = tracing::info_span!("filter").entered();
        if self.config.preset == Preset::Off {
            return input
                .features
                .iter()
                .map(|f| FeatureVerdict::kept(f.0))
                .collect();
        }
        let grid = Arc::new(cells::coarse(input.depth));
        let mut own = self.carry(&grid, input);
        for earlier in self.choose(input) {
            visibility::add_evidence(&self.cells, &grid, &earlier, &mut own);
        }
        let links = Links::new(&self.cells, grid.data());
        let mut odds = std::mem::take(&mut self.odds);
        links.spread(&self.cells, &own, &mut odds);
        self.odds = odds;
        let mut verdicts: Vec<FeatureVerdict> = input
            .features
            .iter()
            .map(|(pixel, z)| self.judge_feature(*pixel, *z, grid.data()))
            .collect();
        verdict::release_when_starving(&mut verdicts, self.config.min_features);
        self.present = Some(Present {
            stamp: input.stamp,
            grid,
        });
        verdicts
    }

    /// Keeps the frame just judged for later comparison, once its pose is known.
    pub(crate) fn remember(&mut self, reference: KeyframeId, reference_from_depth: Se3) {
        let Some(present) = self.present.take() else {
            return;
        };
        while self
            .history
            .front()
            .is_some_and(|s| present.stamp - s.stamp > HISTORY)
        {
            self.history.pop_front();
        }
        self.history.push_back(Snapshot {
            stamp: present.stamp,
            grid: present.grid,
            reference,
            reference_from_depth,
        });
    }

    /// The log odds of the last frame, carried to this one's cells along the surfaces they belong to.
    fn carry(&self, grid: &CoarseDepth, input: &FrameInput<'_>) -> Vec<f32> {
        let mut own = vec![0.0; self.cells.count()];
        let Some((last, pose)) = self
            .history
            .back()
            .and_then(|s| Some((s, s.earlier_from(input)?)))
        else {
            return own;
        };
        let (r, t) = (
            pose.rotation_matrix().map(|v| v as f32),
            pose.translation.map(|v| v as f32),
        );
        let before = last.grid.data();
        for (cell, &z) in grid.data().iter().enumerate() {
            if z <= 0.0 {
                continue;
            }
            let [x, y] = self.cells.rays()[cell].map(|v| v * z);
            let p = [0, 1, 2].map(|i| r[(i, 0)] * x + r[(i, 1)] * y + r[(i, 2)] * z + t[i]);
            let Some(place) = self.cells.project(p) else {
                continue;
            };
            let (mut sum, mut count) = (0.0, 0.0);
            for near in self.cells.around(place, 1) {
                if before[near] > 0.0 && (before[near] - p[2]).abs() < 0.05 + 0.01 * p[2] {
                    sum += self.odds[near];
                    count += 1.0;
                }
            }
            if count > 0.0 {
                own[cell] = KEEP * sum / count;
            }
        }
        own
    }

    /// The earlier frames to compare with.
    fn choose(&self, input: &FrameInput<'_>) -> Vec<Earlier<'_>> {
        let mut chosen: Vec<Earlier<'_>> = Vec::with_capacity(AGES.len());
        let mut last = usize::MAX;
        for age in AGES {
            let wanted = input.stamp - age;
            let i = self.history.partition_point(|s| s.stamp <= wanted);
            let Some(i) = i.checked_sub(1).filter(|i| *i != last) else {
                continue;
            };
            last = i;
            let s = &self.history[i];
            if let Some(earlier_from_now) = s.earlier_from(input) {
                chosen.push(Earlier {
                    grid: &s.grid,
                    earlier_from_now,
                    age: input.stamp - s.stamp,
                });
            }
        }
        chosen
    }

    /// A feature moves with the cell that it lies on: of those around it, the one at its depth.
    fn judge_feature(&self, pixel: [f32; 2], z: f32, depth: &[f32]) -> FeatureVerdict {
        let home = self.cells.at(pixel[0], pixel[1]);
        let odds = if z > 0.0 {
            let mut best = (f32::INFINITY, 0.0);
            for cell in self.cells.around(home, 1) {
                let gap = (depth[cell] - z).abs() + if cell == home { 0.0 } else { 0.01 };
                if depth[cell] > 0.0 && gap < best.0 {
                    best = (gap, self.odds[cell]);
                }
            }
            best.1
        } else {
            let (mut sum, mut count) = (0.0, 0.0);
            for cell in self.cells.around(home, 1) {
                if depth[cell] > 0.0 {
                    sum += self.odds[cell];
                    count += 1.0;
                }
            }
            if count > 0.0 { sum / count } else { 0.0 }
        };
        let dynamic = odds > THRESHOLD;
        FeatureVerdict {
            pixel,
            dynamic,
            reasons: if dynamic {
                Reasons::RIGID
            } else {
                Reasons::default()
            },
            risk: odds.clamp(-LIMIT, LIMIT),
        }
    }
}

impl Snapshot {
    /// The motion from the depth camera of the present frame to that of this one, in the present view of the map.
    fn earlier_from(&self, input: &FrameInput<'_>) -> Option<Se3> {
        let world_from_reference = input.view.world_from_keyframe(self.reference)?;
        let world_from_this = world_from_reference * self.reference_from_depth;
        Some(world_from_this.inverse() * input.world_from_depth)
    }
}
