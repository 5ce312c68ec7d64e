//! ORB extraction: keypoints with descriptors from an image.

use stillpoint_imaging::{GrayImage, Pyramid, Simd, workers};

use crate::{
    Descriptor, Edge, OrbConfig,
    brief::Brief,
    fast::{Corner, FastDetector, FastOptions},
    flow::patch::{Template, WindowPlace},
    orientation::{direction, moments},
    spread::Spread,
    subpixel::refine,
};

/// Distance of keypoints to the border of their level, px: the rotated pattern reaches 18 px, and smoothing repeats the
/// border beyond that. As in ORB-SLAM2 (Mur-Artal, Tardos 2017).
const MARGIN: usize = 19;

/// Radius of the window in which a keypoint's edge is measured, px of its level: that of the windows of flow
/// ([`crate::FlowConfig`]), with which it was measured (decision 56).
const EDGE_RADIUS: usize = 7;

/// A corner with its scale and orientation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Keypoint {
    /// Column in the input image (level 0), px; pixel centres are at integers.
    pub x: f32,
    /// Row in the input image (level 0), px.
    pub y: f32,
    /// Pyramid level.
    pub level: u8,
    /// Direction of the intensity centroid, rad, from x towards y, in [-pi, pi].
    pub angle: f32,
    /// FAST score, grey levels, 1..=255.
    pub response: f32,
    /// The edge it lies on, in the image as recorded.
    pub edge: Edge,
}

/// Features of an image: descriptor `i` belongs to keypoint `i`. Sorted by level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Features {
    /// The keypoints.
    pub keypoints: Vec<Keypoint>,
    /// Their descriptors.
    pub descriptors: Vec<Descriptor>,
}

impl Features {
    /// Removes everything, keeping the memory.
    pub fn clear(&mut self) {
        self.keypoints.clear();
        self.descriptors.clear();
    }

    /// Number of keypoints.
    #[must_use]
    pub fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keypoints.is_empty()
    }
}

/// The ORB extractor (Rublee et al., ICCV 2011) with an even spread over image and scales. Reuses large buffers; levels
/// and keypoints are shared among [`Workers`](stillpoint_imaging::Workers).
#[derive(Clone, Debug)]
pub struct OrbExtractor {
    config: OrbConfig,
    simd: Simd,
    pyramid: Pyramid,
    /// Of the previous image. Both alternate, so that keeping it costs no copy.
    previous_pyramid: Pyramid,
    detectors: Vec<FastDetector>,
    spread: Spread,
    chosen: Vec<Vec<Corner>>,
    all: Vec<(usize, Corner)>,
    described: Vec<(Keypoint, Descriptor)>,
    quotas: Vec<usize>,
    brief: Brief,
}

impl OrbExtractor {
    /// An extractor. Values of `config` out of range (see [`OrbConfig::problems`]) are clamped.
    #[must_use]
    pub fn new(config: &OrbConfig, simd: Simd) -> Self {
        let mut config = config.clone();
        config.levels = config.levels.clamp(1, 16);
        config.scale_factor = config.scale_factor.clamp(1.01, 2.0);
        config.fast_threshold_low = config.fast_threshold_low.min(config.fast_threshold);
        Self {
            simd,
            pyramid: Pyramid::new(config.levels, config.scale_factor, simd),
            previous_pyramid: Pyramid::new(config.levels, config.scale_factor, simd),
            detectors: vec![FastDetector::new(simd); config.levels],
            spread: Spread::default(),
            chosen: vec![Vec::new(); config.levels],
            all: Vec::new(),
            described: Vec::new(),
            quotas: vec![0; config.levels],
            brief: Brief::new(simd),
            config,
        }
    }

    /// Extracts the features of `image` into `out`, replacing its contents.
    ///
    /// Images too small for a patch at some level give no features there.
    pub fn extract(&mut self, image: &GrayImage, out: &mut Features) {
        out.clear();
        std::mem::swap(&mut self.pyramid, &mut self.previous_pyramid);
        self.pyramid.build(image);
        self.detect();
        self.share_quota();
        self.choose();
        self.describe(out);
    }

    /// Number of keypoints per image.
    #[must_use]
    pub fn wanted(&self) -> usize {
        self.config.features
    }

    /// Sets the number of keypoints per image.
    pub fn set_wanted(&mut self, features: usize) {
        self.config.features = features;
    }

    /// The pyramid of the last image.
    #[must_use]
    pub fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    /// The pyramid of the image before the last one, for [`crate::Flow`]; empty if there was none.
    #[must_use]
    pub fn previous_pyramid(&self) -> &Pyramid {
        &self.previous_pyramid
    }

    /// Smooths the levels and finds their corners.
    fn detect(&mut self) {
        let options = FastOptions {
            high: self.config.fast_threshold,
            low: self.config.fast_threshold_low,
            margin: MARGIN,
        };
        self.pyramid
            .smooth_beside(&mut self.detectors, |level, detector| {
                detector.detect(level, &options);
            });
    }

    /// Distributes the features among the levels in proportion to their area. A level with fewer corners leaves the
    /// rest to the others.
    fn share_quota(&mut self) {
        let shrink = 1.0 / f64::from(self.config.scale_factor * self.config.scale_factor);
        let capacity = |level: usize| self.detectors[level].corners().len();
        self.quotas.fill(0);
        let mut remaining = self.config.features;
        // Each round fills at least one level or distributes everything, so there are no more rounds than levels.
        for _ in 0..self.config.levels {
            let weights = (0..self.config.levels).scan(1.0, |weight, level| {
                let this = *weight;
                *weight *= shrink;
                Some((level, this))
            });
            let open = |level: usize, quotas: &[usize]| quotas[level] < capacity(level);
            let total: f64 = weights
                .clone()
                .filter(|(level, _)| open(*level, &self.quotas))
                .map(|(_, weight)| weight)
                .sum();
            if remaining == 0 || total == 0.0 {
                break;
            }
            let mut given = 0;
            for (level, weight) in weights {
                if open(level, &self.quotas) {
                    let share = (remaining as f64 * weight / total).round() as usize;
                    let share = share
                        .min(capacity(level) - self.quotas[level])
                        .min(remaining - given);
                    self.quotas[level] += share;
                    given += share;
                }
            }
            remaining -= given;
        }
    }

    /// Chooses corners from the coarsest level to the finest; deviations from a quota carry over to the next level.
    fn choose(&mut self) {
        let mut carry = 0_isize;
        for level in (0..self.config.levels).rev() {
            let image = self.pyramid.level(level);
            let chosen = &mut self.chosen[level];
            chosen.clear();
            let wanted = (self.quotas[level] as isize + carry).max(0);
            self.spread.choose(
                self.detectors[level].corners(),
                (image.width(), image.height()),
                wanted as usize,
                chosen,
            );
            carry += self.quotas[level] as isize - chosen.len() as isize;
        }
    }

    fn describe(&mut self, out: &mut Features) {
        let levels = self.chosen.iter().enumerate();
        let all = levels.flat_map(|(level, chosen)| chosen.iter().map(move |c| (level, *c)));
        self.all.clear();
        self.all.extend(all);
        let mut described = std::mem::take(&mut self.described);
        described.resize(self.all.len(), Default::default());
        workers::fill(&mut described, |i| {
            let (level, corner) = &self.all[i];
            self.describe_one(*level, corner)
        });
        out.keypoints.extend(described.iter().map(|d| d.0));
        out.descriptors.extend(described.iter().map(|d| d.1));
        self.described = described;
    }

    fn describe_one(&self, level: usize, corner: &Corner) -> (Keypoint, Descriptor) {
        let (image, smooth) = (self.pyramid.level(level), self.pyramid.smooth(level));
        let (x, y) = (usize::from(corner.x), usize::from(corner.y));
        // Orientation uses the sharp image; the descriptor compares single pixels, which are stable only after
        // smoothing (Rublee et al., ICCV 2011).
        let moments = moments(image, x, y, self.simd);
        let (dx, dy) = if self.config.subpixel {
            refine(self.detectors[level].scores(), x, y)
        } else {
            (0.0, 0.0)
        };
        let (base_x, base_y) = self.pyramid.to_base(level, x as f32 + dx, y as f32 + dy);
        let keypoint = Keypoint {
            x: base_x,
            y: base_y,
            level: level as u8,
            angle: libm::atan2f(moments.1 as f32, moments.0 as f32),
            response: f32::from(corner.score),
            edge: self.edge_at(image, x, y),
        };
        let descriptor = self.brief.describe(smooth, x, y, direction(moments));
        (keypoint, descriptor)
    }

    fn edge_at(&self, image: &GrayImage, x: usize, y: usize) -> Edge {
        let mut window = Template::new(EDGE_RADIUS);
        let Some(place) = WindowPlace::new(image, x as f32, y as f32, window.side) else {
            return Edge::default();
        };
        let sums = window.sample(image, place, self.simd);
        Edge::of(&sums, window.side * window.side)
    }
}
