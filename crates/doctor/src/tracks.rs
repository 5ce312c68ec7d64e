//! Tracks corners from frame to frame.
//!
//! Answers: the corners' positions, their image velocity, and their depth at selected frames (views).

use stillpoint_features::{Features, Flow, FlowConfig, FlowMatch, OrbConfig, OrbExtractor};
use stillpoint_imaging::{DepthImage, RgbdFrame, Simd};

/// Number of corners tracked at once.
const CORNERS: usize = 500;
/// Side of the cells with at most one corner each, px.
const CELL: usize = 14;
/// Time between views, s: short enough that two thirds of the corners are seen in three in a row.
const VIEW_EVERY: f64 = 1.0 / 6.0;
/// Depths beside a corner are compared over this distance, px, and differ by at most this fraction.
const BESIDE: isize = 3;
const FLAT: f32 = 0.06;

#[derive(Clone, Debug)]
pub(crate) struct Track {
    /// Position in the last frame, px.
    pub(crate) now: [f32; 2],
    before: Option<[f32; 2]>,
    earlier: Option<[f32; 2]>,
    /// Depth at `before`, on any surface, m; 0 for none.
    depth_before: f32,
    depth_now: f32,
    /// Position and depth (m) in views, by their number, where the depth is smooth.
    seen: Vec<(u32, Sight)>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    pub(crate) pixel: [f32; 2],
    pub(crate) z: f32,
}

/// A corner's image motion at the last frame but one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    pub(crate) pixel: [f32; 2],
    pub(crate) z: f32,
    /// px/s.
    pub(crate) velocity: [f32; 2],
}

pub(crate) struct Tracks {
    extractor: OrbExtractor,
    flow: Flow,
    features: Features,
    matches: Vec<Option<FlowMatch>>,
    live: Vec<Track>,
    ended: Vec<Track>,
    /// Stamps of the last frames, the newest last.
    stamps: Vec<f64>,
    views: Vec<f64>,
}

impl Tracks {
    pub(crate) fn new() -> Self {
        let simd = Simd::detect();
        // The levels and the threshold with which the bounds of the findings were measured.
        let config = OrbConfig {
            features: CORNERS,
            levels: 8,
            scale_factor: 1.2,
            fast_threshold_low: 7,
            ..OrbConfig::default()
        };
        let flow = FlowConfig {
            level_step: 4,
            ..FlowConfig::default()
        };
        Self {
            extractor: OrbExtractor::new(&config, simd),
            flow: Flow::new(flow, simd),
            features: Features::default(),
            matches: Vec::new(),
            live: Vec::new(),
            ended: Vec::new(),
            stamps: Vec::new(),
            views: Vec::new(),
        }
    }

    pub(crate) fn views(&self) -> &[f64] {
        &self.views
    }

    /// Tracks the corners into a frame, and adds new ones.
    pub(crate) fn step(&mut self, frame: &RgbdFrame) {
        self.extractor.extract(&frame.gray, &mut self.features);
        if !self.stamps.is_empty() {
            self.follow(frame);
        }
        self.stamps.push(frame.stamp);
        let due = self
            .views
            .last()
            .is_none_or(|last| frame.stamp - last >= VIEW_EVERY - 1e-3);
        self.fill(frame);
        if due {
            let view = self.views.len() as u32;
            self.views.push(frame.stamp);
            for track in &mut self.live {
                if let Some(z) = smooth_depth(&frame.depth, track.now) {
                    let pixel = track.now;
                    track.seen.push((view, Sight { pixel, z }));
                }
            }
        }
    }

    fn follow(&mut self, frame: &RgbdFrame) {
        let positions: Vec<[f32; 2]> = self.live.iter().map(|t| t.now).collect();
        let guesses: Vec<[f32; 2]> = self.live.iter().map(Track::expected).collect();
        self.flow.track(
            self.extractor.previous_pyramid(),
            self.extractor.pyramid(),
            &positions,
            Some(&guesses),
            &mut self.matches,
        );
        let mut matches = self.matches.drain(..);
        let (kept, lost): (Vec<Track>, Vec<Track>) = std::mem::take(&mut self.live)
            .into_iter()
            .map(|mut track| {
                track.earlier = track.before;
                track.depth_before = track.depth_now;
                match matches.next().flatten() {
                    Some(found) => {
                        track.before = Some(track.now);
                        track.now = found.position;
                        track.depth_now = nearest_depth(&frame.depth, track.now);
                    }
                    None => track.before = None,
                }
                track
            })
            .partition(|track| track.before.is_some());
        self.live = kept;
        self.ended
            .extend(lost.into_iter().filter(|t| t.seen.len() > 1));
    }

    fn fill(&mut self, frame: &RgbdFrame) {
        let columns = frame.gray.width() / CELL + 1;
        let rows = frame.gray.height() / CELL + 1;
        let cell = |[x, y]: [f32; 2]| {
            let (i, j) = (x.max(0.0) as usize / CELL, y.max(0.0) as usize / CELL);
            j.min(rows - 1) * columns + i.min(columns - 1)
        };
        let mut taken = vec![false; columns * rows];
        for track in &self.live {
            taken[cell(track.now)] = true;
        }
        for corner in &self.features.keypoints {
            if self.live.len() >= CORNERS {
                break;
            }
            let now = [corner.x, corner.y];
            if !std::mem::replace(&mut taken[cell(now)], true) {
                self.live.push(Track {
                    now,
                    before: None,
                    earlier: None,
                    depth_before: 0.0,
                    depth_now: nearest_depth(&frame.depth, now),
                    seen: Vec::new(),
                });
            }
        }
    }

    /// Motions of the corners at the last frame but one.
    pub(crate) fn motions(&self) -> Vec<Motion> {
        let [.., first, _, last] = self.stamps[..] else {
            return Vec::new();
        };
        let over = (last - first) as f32;
        if over <= 0.0 {
            return Vec::new();
        }
        let of = |t: &Track| {
            let (pixel, earlier) = (t.before?, t.earlier?);
            let velocity = [0, 1].map(|k| (t.now[k] - earlier[k]) / over);
            Some(Motion {
                pixel,
                z: t.depth_before,
                velocity,
            })
        };
        self.live
            .iter()
            .filter(|t| t.depth_before > 0.0)
            .filter_map(of)
            .collect()
    }

    pub(crate) fn common(&self, a: u32, b: u32) -> Vec<[Sight; 2]> {
        let sight = |t: &Track, view: u32| {
            let at = t.seen.binary_search_by_key(&view, |s| s.0).ok()?;
            Some(t.seen[at].1)
        };
        self.ended
            .iter()
            .chain(&self.live)
            .filter_map(|t| Some([sight(t, a)?, sight(t, b)?]))
            .collect()
    }
}

impl Track {
    fn expected(&self) -> [f32; 2] {
        self.before
            .map_or(self.now, |b| [0, 1].map(|k| 2.0 * self.now[k] - b[k]))
    }
}

fn pixel(depth: &DepthImage, [x, y]: [f32; 2]) -> Option<[isize; 2]> {
    let at = [(x + 0.5).floor() as isize, (y + 0.5).floor() as isize];
    let inside = at[0] >= BESIDE
        && at[1] >= BESIDE
        && at[0] + BESIDE < depth.width() as isize
        && at[1] + BESIDE < depth.height() as isize;
    inside.then_some(at)
}

fn nearest_depth(depth: &DepthImage, at: [f32; 2]) -> f32 {
    pixel(depth, at).map_or(0.0, |[x, y]| depth.at(x as usize, y as usize))
}

/// Mean depth of nine pixels at and beside a corner; `None` if one is missing or the surface ends.
fn smooth_depth(depth: &DepthImage, at: [f32; 2]) -> Option<f32> {
    let [x, y] = pixel(depth, at)?;
    let (mut low, mut high, mut sum) = (f32::MAX, 0.0_f32, 0.0);
    for dy in [-BESIDE, 0, BESIDE] {
        for dx in [-BESIDE, 0, BESIDE] {
            let z = depth.at((x + dx) as usize, (y + dy) as usize);
            (low, high, sum) = (low.min(z), high.max(z), sum + z);
        }
    }
    let mean = sum / 9.0;
    (low > 0.0 && high - low <= FLAT * mean).then_some(mean)
}
