//! Pyramidal Lucas-Kanade flow.
//!
//! Tracks given points from one image to the next with subpixel accuracy. The method is that of Bouguet, "Pyramidal
//! implementation of the Lucas Kanade feature tracker" (2000), on the feature pyramid, with an unknown change of
//! brightness per window (Shi and Tomasi, CVPR 1994, without the affine part).

mod align;
mod config;
pub(crate) mod patch;
mod scales;

pub use config::FlowConfig;

use crate::Edge;
use align::{Aligned, Aligner, Outcome, Start};
use scales::Scales;
use stillpoint_imaging::{Pyramid, Simd, workers};

/// A step shorter than this ends a coarse scale, px of it: the next finer one continues from there. Chosen: that is 0.2
/// px of a next scale of twice the size, which one step corrects.
const COARSE_EPSILON: f32 = 0.1;

/// A point tracked to the current image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowMatch {
    /// Position in the current image (level 0, as recorded), px; pixel centres are at integers.
    pub position: [f32; 2],
    /// Mean absolute difference of both windows at level 0 after brightness correction, grey levels.
    pub residual: f32,
    /// Forward-backward error: distance between the point and the result of tracking back to the previous image, px.
    pub forward_backward: f32,
    /// The edge around the point in the previous image, along which the position is uncertain.
    pub edge: Edge,
}

/// Tracks points from one image to the next, reusing buffers.
#[derive(Clone, Debug)]
pub struct Flow {
    config: FlowConfig,
    aligner: Aligner,
    /// Scales of the previous and of the current image.
    old: Scales,
    new: Scales,
}

impl Flow {
    /// A tracker. Values of `config` out of range (see [`FlowConfig::problems`]) are clamped.
    #[must_use]
    pub fn new(config: FlowConfig, simd: Simd) -> Self {
        let mut config = config;
        config.radius = config.radius.clamp(2, 7);
        config.levels = config.levels.clamp(1, 16);
        config.level_step = config.level_step.clamp(1, 8);
        config.iterations = config.iterations.clamp(1, 100);
        Self {
            aligner: Aligner::new(&config, simd),
            old: Scales::default(),
            new: Scales::default(),
            config,
        }
    }

    /// Tracks `points` (px in level 0 of `previous`) to `current`; entry `i` of `out` belongs to point `i`. Replaces
    /// the contents of `out`.
    ///
    /// `guesses` are predicted positions in `current`, one per point: the search then starts at the scale given by
    /// [`FlowConfig::guess_error`], and falls back to all scales if that fails. A missing guess is the point itself, of
    /// unknown error.
    ///
    /// `None` if the window leaves an image, has too little texture, looks different at the end, or fails the
    /// forward-backward check. Pyramids of images of different size give nothing.
    pub fn track(
        &mut self,
        previous: &Pyramid,
        current: &Pyramid,
        points: &[[f32; 2]],
        guesses: Option<&[[f32; 2]]>,
        out: &mut Vec<Option<FlowMatch>>,
    ) {
        out.clear();
        if !are_alike(previous, current) {
            out.resize(points.len(), None);
            return;
        }
        let (count, step) = (self.config.levels, self.config.level_step);
        self.old.build(previous, count, step);
        self.new.build(current, count, step);
        let near = self.levels_for(self.config.guess_error);
        let track = |seeker: &mut Seeker<'_>, i: usize| {
            let (start, first) = match guesses.and_then(|guesses| guesses.get(i)) {
                Some(&guess) => (guess, near),
                None => (points[i], count),
            };
            let found = seeker.track_point(points[i], start, first);
            if found == Outcome::Lost && first < count {
                return seeker.track_point(points[i], start, count);
            }
            found
        };
        self.track_all((previous, current), points.len(), out, track);
    }

    /// Likewise with accurate guesses: searches on the finest scale only, within half a window. A point without a guess
    /// is searched at its own position.
    pub fn look(
        &mut self,
        previous: &Pyramid,
        current: &Pyramid,
        points: &[[f32; 2]],
        guesses: &[[f32; 2]],
        out: &mut Vec<Option<FlowMatch>>,
    ) {
        out.clear();
        if !are_alike(previous, current) {
            out.resize(points.len(), None);
            return;
        }
        let look = |seeker: &mut Seeker<'_>, i: usize| {
            let guess = guesses.get(i).copied().unwrap_or(points[i]);
            seeker.track_point(points[i], guess, 1)
        };
        self.track_all((previous, current), points.len(), out, look);
    }

    /// Tracks `count` points, shared among [`Workers`](stillpoint_imaging::Workers).
    fn track_all(
        &self,
        pair: (&Pyramid, &Pyramid),
        count: usize,
        out: &mut Vec<Option<FlowMatch>>,
        track: impl Fn(&mut Seeker<'_>, usize) -> Outcome<FlowMatch> + Sync,
    ) {
        out.resize(count, None);
        workers::in_rows(out, 1, |first, out| {
            let mut seeker = Seeker {
                flow: self,
                previous: pair.0,
                current: pair.1,
                aligner: self.aligner.clone(),
            };
            for (i, found) in out.iter_mut().enumerate() {
                *found = track(&mut seeker, first + i).found();
            }
        });
    }

    /// Number of scales needed for a start with an error of up to `error` px: a step reaches about half a radius.
    fn levels_for(&self, error: f32) -> usize {
        let reach = 0.5 * self.config.radius as f32;
        let enough = |&i: &usize| error <= reach * self.new.scale(i);
        (0..self.new.len())
            .find(enough)
            .map_or(self.new.len(), |i| i + 1)
    }

    /// Moves both positions equally so that their windows are inside images of this size: near the border the motion of
    /// the adjacent window is a better start than none. Returns them and the shift.
    fn inwards(&self, from: [f32; 2], to: [f32; 2], size: (usize, usize)) -> [[f32; 2]; 3] {
        // The window, its gradients, the interpolation, and room to move.
        let margin = (self.config.radius + 4) as f32;
        let move_in = |a: f32, b: f32, length: usize| {
            let (low, high) = (margin, length as f32 - 1.0 - margin);
            (low - a.min(b)).max(0.0) - (a.max(b) - high).max(0.0)
        };
        let shift = [
            move_in(from[0], to[0], size.0),
            move_in(from[1], to[1], size.1),
        ];
        let moved = |p: [f32; 2]| [p[0] + shift[0], p[1] + shift[1]];
        [moved(from), moved(to), shift]
    }
}

/// Tracks points sequentially, with its own buffer.
struct Seeker<'a> {
    flow: &'a Flow,
    previous: &'a Pyramid,
    current: &'a Pyramid,
    aligner: Aligner,
}

impl Seeker<'_> {
    /// Forward from coarse to fine, and back at the finest level.
    fn track_point(
        &mut self,
        point: [f32; 2],
        start: [f32; 2],
        levels: usize,
    ) -> Outcome<FlowMatch> {
        let config = &self.flow.config;
        let forward = match self.descend(point, start, levels) {
            Outcome::Found(forward) => forward,
            Outcome::Lost => return Outcome::Lost,
            Outcome::Untrackable => return Outcome::Untrackable,
        };
        // NaN does not pass.
        let passes = |value: f32, limit: f32| value <= limit;
        if !passes(forward.residual, config.max_residual) {
            return Outcome::Lost;
        }
        let (old, new) = (self.previous.level(0), self.current.level(0));
        // On the finest scale from the point itself: a correct match stays there, a wrong one moves away.
        let back = self.aligner.align(
            (new, old),
            forward.position,
            Start {
                position: point,
                brightness: -forward.brightness,
                epsilon: config.epsilon,
            },
        );
        let Outcome::Found(back) = back else {
            return Outcome::Lost;
        };
        let (dx, dy) = (back.position[0] - point[0], back.position[1] - point[1]);
        let forward_backward = (dx * dx + dy * dy).sqrt();
        if !passes(forward_backward, config.forward_backward) {
            return Outcome::Lost;
        }
        Outcome::Found(FlowMatch {
            position: forward.position,
            residual: forward.residual,
            forward_backward,
            edge: self.aligner.edge(&forward.gradients),
        })
    }

    /// Refines `start` on the `count` finest scales, from coarse to fine.
    fn descend(&mut self, point: [f32; 2], start: [f32; 2], count: usize) -> Outcome<Aligned> {
        let (Flow { old, new, .. }, epsilon) = (self.flow, self.flow.config.epsilon);
        let mut position = start;
        let mut brightness = 0.0;
        for i in (1..count).rev() {
            let images = (old.image(self.previous, i), new.image(self.current, i));
            let size = (images.1.width(), images.1.height());
            let (from, to) = (old.at_scale(i, point), new.at_scale(i, position));
            let [from, to, shift] = self.flow.inwards(from, to, size);
            let start = Start {
                position: to,
                brightness,
                epsilon: epsilon.max(COARSE_EPSILON),
            };
            let found = self.aligner.align(images, from, start);
            // A coarse window that fails is skipped; the finer ones continue from the last position.
            if let Outcome::Found(aligned) = found {
                let [x, y] = aligned.position;
                position = new.to_base(i, [x - shift[0], y - shift[1]]);
                brightness = aligned.brightness;
            }
        }
        let images = (self.previous.level(0), self.current.level(0));
        let start = Start {
            position,
            brightness,
            epsilon,
        };
        self.aligner.align(images, point, start)
    }
}

/// Whether two pyramids have the same sizes at every level.
fn are_alike(a: &Pyramid, b: &Pyramid) -> bool {
    let size = |pyramid: &Pyramid| {
        let base = pyramid.level(0);
        let last = pyramid.scale(pyramid.levels() - 1);
        (base.width(), base.height(), last)
    };
    size(a) == size(b) && a.levels() == b.levels()
}
