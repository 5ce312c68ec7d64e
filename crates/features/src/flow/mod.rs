//! Pyramidal Lucas-Kanade flow.
//!
//! Answers: where given points of one image are in the next one, to a fraction of a pixel, and which of them cannot be told. Does not know
//! which points move by themselves. The method is that of Bouguet, "Pyramidal implementation of the Lucas Kanade feature tracker" (2000),
//! on whatever pyramid there is, with an unknown change of brightness per window (Shi and Tomasi, CVPR 1994, without the affine part).

mod align;
mod config;
pub(crate) mod patch;

pub use config::FlowConfig;

use align::{Aligned, Aligner, Outcome};
use stillpoint_imaging::{Pyramid, Simd};

/// Where a point is in the current image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowMatch {
    /// Position in the current image (level 0, as recorded), px; pixel centres are at integers.
    pub position: [f32; 2],
    /// Mean absolute difference of both windows at level 0 after taking away the difference of their brightness, grey levels.
    pub residual: f32,
    /// Distance between the point and where the flow from the current image back to the previous one ends, px.
    pub forward_backward: f32,
}

/// Tracks points from one image to the next. Its buffers are reused.
#[derive(Clone, Debug)]
pub struct Flow {
    config: FlowConfig,
    aligner: Aligner,
    /// The pyramid levels used, finest first.
    levels: Vec<usize>,
}

impl Flow {
    /// A tracker. Values of `config` out of range (see [`FlowConfig::problems`]) are brought into range.
    #[must_use]
    pub fn new(config: FlowConfig, simd: Simd) -> Self {
        let mut config = config;
        config.radius = config.radius.clamp(2, 7);
        config.levels = config.levels.clamp(1, 16);
        config.level_step = config.level_step.clamp(1, 8);
        config.iterations = config.iterations.clamp(1, 100);
        Self {
            aligner: Aligner::new(&config, simd),
            levels: Vec::new(),
            config,
        }
    }

    /// Finds `points` (px in level 0 of `previous`) in `current`; entry `i` of `out` belongs to point `i`. What `out` held is replaced.
    ///
    /// `guesses` are expected positions in `current`, one per point: the search then starts at the coarsest level that the configured error
    /// of a guess asks for, and falls back to the whole pyramid where that fails. A missing guess is the point itself, of unknown error.
    ///
    /// `None` when the window leaves an image, has too little texture, looks different at the end, or does not find its way back. Pyramids
    /// of images that differ in size give nothing.
    pub fn track(
        &mut self,
        previous: &Pyramid,
        current: &Pyramid,
        points: &[[f32; 2]],
        guesses: Option<&[[f32; 2]]>,
        out: &mut Vec<Option<FlowMatch>>,
    ) {
        out.clear();
        let size = |pyramid: &Pyramid| {
            let base = pyramid.level(0);
            (
                base.width(),
                base.height(),
                pyramid.scale(pyramid.levels() - 1),
            )
        };
        if size(previous) != size(current) || previous.levels() != current.levels() {
            out.resize(points.len(), None);
            return;
        }
        self.levels.clear();
        let levels = (0..previous.levels()).step_by(self.config.level_step);
        self.levels.extend(levels.take(self.config.levels));
        let pair = (previous, current);
        let near = self.levels_for(self.config.guess_error, previous);
        for (i, &point) in points.iter().enumerate() {
            let guess = guesses.and_then(|guesses| guesses.get(i)).copied();
            let start = guess.unwrap_or(point);
            let first = if guess.is_some() {
                near
            } else {
                self.levels.len()
            };
            let mut found = self.track_point(pair, point, start, first);
            if found == Outcome::Lost && first < self.levels.len() {
                found = self.track_point(pair, point, start, self.levels.len());
            }
            out.push(found.found());
        }
    }

    /// How many levels are needed for a start that is wrong by up to `error` px: a step reaches about half a radius.
    fn levels_for(&self, error: f32, pyramid: &Pyramid) -> usize {
        let reach = 0.5 * self.config.radius as f32;
        let enough = |&level: &usize| error <= reach * pyramid.scale(level);
        let needed = self.levels.iter().position(enough);
        needed.map_or(self.levels.len(), |index| index + 1)
    }

    /// Forward from coarse to fine, and back at the finest level.
    fn track_point(
        &mut self,
        (previous, current): (&Pyramid, &Pyramid),
        point: [f32; 2],
        start: [f32; 2],
        levels: usize,
    ) -> Outcome<FlowMatch> {
        let forward = match self.descend((previous, current), point, start, levels) {
            Outcome::Found(forward) => forward,
            Outcome::Lost => return Outcome::Lost,
            Outcome::Untrackable => return Outcome::Untrackable,
        };
        // A comparison that a NaN does not pass.
        let passes = |value: f32, limit: f32| value <= limit;
        if !passes(forward.residual, self.config.max_residual) {
            return Outcome::Lost;
        }
        let (old, new) = (previous.level(0), current.level(0));
        let back = self
            .aligner
            .align((new, old), forward.position, point, -forward.brightness);
        let Outcome::Found(back) = back else {
            return Outcome::Lost;
        };
        let (dx, dy) = (back.position[0] - point[0], back.position[1] - point[1]);
        let forward_backward = (dx * dx + dy * dy).sqrt();
        if !passes(forward_backward, self.config.forward_backward) {
            return Outcome::Lost;
        }
        Outcome::Found(FlowMatch {
            position: forward.position,
            residual: forward.residual,
            forward_backward,
        })
    }

    /// Refines `start` on the `count` finest levels in use, from coarse to fine.
    fn descend(
        &mut self,
        (previous, current): (&Pyramid, &Pyramid),
        point: [f32; 2],
        start: [f32; 2],
        count: usize,
    ) -> Outcome<Aligned> {
        let mut position = start;
        let mut brightness = 0.0;
        for &level in self.levels[1..count].iter().rev() {
            let (x, y) = previous.from_base(level, point[0], point[1]);
            let (u, v) = current.from_base(level, position[0], position[1]);
            let images = (previous.level(level), current.level(level));
            // A coarse window that leaves the image or has no texture says nothing: the finer ones go on from where they are.
            let found = self.aligner.align(images, [x, y], [u, v], brightness);
            if let Outcome::Found(aligned) = found {
                let (x, y) = current.to_base(level, aligned.position[0], aligned.position[1]);
                position = [x, y];
                brightness = aligned.brightness;
            }
        }
        let images = (previous.level(0), current.level(0));
        self.aligner.align(images, point, position, brightness)
    }
}
