//! Ground truth of a frame, and simulated detections.
//!
//! Exact masks and boxes of the movers, boxes of furniture, and scripted detections with misses, jitter and false alarms; carried boxes are
//! never detected. Independent of the sensor's noise.

use crate::pixels::Pixels;
use crate::random::{Normal, Purpose, Stream, key};
use stillpoint_imaging::GrayImage;

/// The movers in a frame at the stamp of its colour image.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTruth {
    /// The mover at each pixel's centre: k for mover k, 0 for static.
    pub mask: GrayImage,
    /// The visible movers, by number.
    pub boxes: Vec<MoverBox>,
    /// The visible static objects of known classes, by number; they are numbered separately.
    pub things: Vec<MoverBox>,
}

impl FrameTruth {
    /// Share of the image covered by movers, 0 to 1.
    #[must_use]
    pub fn cover(&self) -> f64 {
        let seen: usize = self.boxes.iter().map(|b| b.visible_px).sum();
        seen as f64 / self.mask.data().len().max(1) as f64
    }
}

/// The visible part of a mover or object. Pixel (0, 0) extends from -0.5 to 0.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoverBox {
    /// Number of the mover, from 1; constant in all frames of a scene.
    pub mover: u32,
    /// Class: `person`, `box` or another carried object, or for a static object its COCO class.
    pub class: &'static str,
    /// Left border, px of the recorded image.
    pub x0: f64,
    /// Upper border, px.
    pub y0: f64,
    /// Right border, px.
    pub x1: f64,
    /// Lower border, px.
    pub y1: f64,
    /// Number of visible pixels.
    pub visible_px: usize,
    /// Whether it is a person seen from behind throughout the scene.
    pub from_behind: bool,
    /// Position and velocity; `None` for static objects.
    pub motion: Option<MoverMotion>,
}

/// The true box of an object of a known class: upright, with its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThingBox {
    /// Its COCO class.
    pub class: &'static str,
    /// The centre of the box, m.
    pub centre: [f64; 3],
    /// Its sides along its own axes, of which the third is up, m.
    pub size: [f64; 3],
    /// Rotation about the vertical from the world's axes to its own, rad.
    pub yaw: f64,
    /// Time at which a person lifts it and carries it away, s; `None` if it stays.
    pub taken_at: Option<f64>,
}

/// Position and velocity of a mover in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MoverMotion {
    /// Centre of a person's hips, or of a load, m.
    pub position: [f64; 3],
    /// Velocity of this point, m/s.
    pub velocity: [f64; 3],
}

/// Class and motion of a mover.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MoverState {
    pub(crate) class: &'static str,
    pub(crate) from_behind: bool,
    pub(crate) motion: Option<MoverMotion>,
}

/// Errors of a simulated detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectionNoise {
    /// Probability that a visible person is missed in a frame, 0 to 1.
    pub drop: f64,
    /// Standard deviation of each border of a box, px.
    pub jitter_px: f64,
    /// Minimum number of visible pixels of detected persons.
    pub min_visible_px: usize,
    /// Probability that a burst of misses begins for a person in a frame, 0 to 1: the person is missed in all its frames, as when turning
    /// the back on the camera.
    pub burst: f64,
    /// Length of a burst, frames.
    pub burst_frames: usize,
    /// Probability of a burst for a person seen from behind throughout the scene ([`MoverBox::from_behind`]); such a burst may have begun
    /// before the first frame.
    pub from_behind: f64,
    /// Probability of a false detection of a person in a frame, 0 to 1.
    pub false_alarm: f64,
    /// Whether furniture is detected as well: chairs, desks, screens, keyboards, books and cups, with the same rates of misses, bursts and
    /// false alarms as people.
    pub things: bool,
    /// Seed of misses and jitter.
    pub seed: u64,
}

impl Default for DetectionNoise {
    /// The errors of a small network on moving people: 30 % missed, borders off by 4 px, and of a person seen from behind 91 %, mostly in
    /// bursts; no other errors.
    fn default() -> Self {
        Self {
            drop: 0.3,
            jitter_px: 4.0,
            min_visible_px: 1500,
            burst: 0.0,
            burst_frames: 25,
            from_behind: 0.08,
            false_alarm: 0.0,
            things: false,
            seed: 0,
        }
    }
}

/// A detection: a row of a script of detections.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptedDetection {
    /// Stamp of the colour image, s.
    pub stamp: f64,
    /// `person`, or the class of an object; loads carried by people are in no detector's list.
    pub class: &'static str,
    /// Score, 0 to 1.
    pub score: f32,
    /// Left border, px of the recorded image.
    pub x0: f64,
    /// Upper border, px.
    pub y0: f64,
    /// Right border, px.
    pub x1: f64,
    /// Lower border, px.
    pub y1: f64,
}

/// Left, top, right and bottom pixel, and the number of pixels.
#[derive(Clone, Copy)]
struct Extent([usize; 4], usize);

impl Extent {
    const NOTHING: Self = Self([usize::MAX, usize::MAX, 0, 0], 0);

    fn take(&mut self, x: usize, y: usize) {
        let b = self.0;
        self.0 = [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)];
        self.1 += 1;
    }
}

/// The boxes of the visible movers; entry k - 1 is that of number k.
fn boxes(found: &[Extent], what: &[MoverState]) -> Vec<MoverBox> {
    let numbered = found.iter().zip(what).enumerate();
    let seen = numbered.filter(|(_, (extent, _))| extent.1 > 0);
    seen.map(|(k, (Extent(b, count), state))| MoverBox {
        mover: k as u32 + 1,
        class: state.class,
        x0: b[0] as f64 - 0.5,
        y0: b[1] as f64 - 0.5,
        x1: b[2] as f64 + 0.5,
        y1: b[3] as f64 + 0.5,
        visible_px: *count,
        from_behind: state.from_behind,
        motion: state.motion,
    })
    .collect()
}

/// The numbers of mover and object at each pixel, as three bytes.
pub(crate) fn seen(view: &Pixels) -> Vec<u8> {
    let numbers = |k| view.face(k).map_or((0, 0), |f| (f.mover, f.thing));
    let bytes = |(mover, thing): (u8, u16)| {
        let [low, high] = thing.to_le_bytes();
        [mover, low, high]
    };
    let pixels = 0..view.width * view.height;
    pixels.flat_map(|k| bytes(numbers(k))).collect()
}

/// Mask and boxes from the numbers per pixel ([`seen`]) of an image of this size. Mover k is `movers[k - 1]`, object k is `things[k - 1]`.
pub(crate) fn truth(
    seen: &[u8],
    [width, height]: [usize; 2],
    movers: &[MoverState],
    things: &[ThingBox],
) -> FrameTruth {
    let mut mask = GrayImage::new(width, height);
    let mut moving = vec![Extent::NOTHING; movers.len()];
    let mut still = vec![Extent::NOTHING; things.len()];
    let (pixels, _) = seen.as_chunks();
    let pixels = mask.data_mut().iter_mut().zip(pixels).enumerate();
    for (k, (out, [mover, low, high])) in pixels {
        *out = *mover;
        let thing = u16::from_le_bytes([*low, *high]);
        let (x, y) = (k % width, k / width);
        let of = |extents: &mut [Extent], number: usize| {
            if let Some(e) = number.checked_sub(1).and_then(|n| extents.get_mut(n)) {
                e.take(x, y);
            }
        };
        of(&mut moving, usize::from(*mover));
        of(&mut still, usize::from(thing));
    }
    let thing = |thing: &ThingBox| MoverState {
        class: thing.class,
        from_behind: false,
        motion: None,
    };
    let things: Vec<MoverState> = things.iter().map(thing).collect();
    FrameTruth {
        mask,
        boxes: boxes(&moving, movers),
        things: boxes(&still, &things),
    }
}

/// Base of the random stream numbers of objects and false alarms, beyond those of movers.
const THINGS: u64 = 1 << 32;
const FALSE_ALARMS: u64 = 1 << 33;
/// Base of the stream numbers for bursts of misses.
const BURSTS: u64 = 1 << 34;
/// Base of the stream numbers for bursts of people seen from behind: separate, so that other scenes stay unchanged.
const BACKS: u64 = 1 << 36;
/// Base of the stream numbers for false alarms of objects.
const FALSE_THINGS: u64 = 1 << 35;
/// Classes of false alarms, with their usual width and height as shares of the image's height.
const SEEN_WRONGLY: [(&str, [f64; 2]); 5] = [
    ("chair", [0.35, 0.5]),
    ("tv", [0.35, 0.25]),
    ("book", [0.2, 0.15]),
    ("cup", [0.08, 0.1]),
    ("dining table", [0.8, 0.35]),
];

/// The simulated detections of frame `index`.
pub(crate) fn detections(
    truth: &FrameTruth,
    noise: &DetectionNoise,
    normal: &Normal,
    index: usize,
    stamp: f64,
) -> Vec<ScriptedDetection> {
    let detector = ScriptedDetector {
        noise,
        normal,
        size: [truth.mask.width() as f64, truth.mask.height() as f64],
        index,
        stamp,
    };
    let people = truth.boxes.iter().filter(|b| b.class == "person");
    let people = people.filter_map(|b| {
        let number = u64::from(b.mover);
        detector
            .find(b, number)
            .filter(|_| !detector.in_burst(number) && !detector.misses_back(b, number))
    });
    let mut rows: Vec<ScriptedDetection> = people.collect();
    if noise.things {
        let find = |b: &MoverBox, number: u64| {
            let found = detector.find(b, number);
            found.filter(|_| !detector.in_burst(number))
        };
        let number = |b: &MoverBox| THINGS + u64::from(b.mover);
        rows.extend(truth.things.iter().filter_map(|b| find(b, number(b))));
        // Detectors do not know carried boxes.
        let carried = truth.boxes.iter();
        let carried = carried.filter(|b| !["person", "box"].contains(&b.class));
        rows.extend(carried.filter_map(|b| find(b, u64::from(b.mover))));
        rows.extend(detector.false_thing());
    }
    rows.extend(detector.false_alarm());
    rows
}

struct ScriptedDetector<'a> {
    noise: &'a DetectionNoise,
    normal: &'a Normal,
    /// Width and height of the image, px.
    size: [f64; 2],
    index: usize,
    stamp: f64,
}

impl ScriptedDetector<'_> {
    /// Addressed by number and frame, so that errors are independent of other visible people.
    fn stream(&self, number: u64, index: usize) -> Stream {
        let seed = key(self.noise.seed, Purpose::Detections, number);
        Stream::new(seed, Purpose::Detections, index as u64)
    }

    /// Whether a burst of misses that began in this or an earlier frame is active.
    fn in_burst(&self, number: u64) -> bool {
        let first = (self.index + 1).saturating_sub(self.noise.burst_frames);
        let begins = |index| self.stream(BURSTS + number, index).chance(self.noise.burst);
        self.noise.burst > 0.0 && (first..=self.index).any(begins)
    }

    /// Whether a person is missed because only the back is visible.
    fn misses_back(&self, seen: &MoverBox, number: u64) -> bool {
        let chance = self.noise.from_behind;
        let begins = |index| self.stream(BACKS + number, index).chance(chance);
        let bursts = self.index..self.index + self.noise.burst_frames;
        seen.from_behind && chance > 0.0 && bursts.into_iter().any(begins)
    }

    /// The detection of a visible object; `None` if it is missed.
    fn find(&self, seen: &MoverBox, number: u64) -> Option<ScriptedDetection> {
        let (noise, [w, h]) = (self.noise, self.size);
        let mut rng = self.stream(number, self.index);
        if rng.chance(noise.drop) || seen.visible_px < noise.min_visible_px.max(1) {
            return None;
        }
        let mut border = |at: f64, end: f64| {
            let off = noise.jitter_px * f64::from(self.normal.at(rng.bits()));
            (at + off).clamp(-0.5, end - 0.5)
        };
        let (x0, x1) = (border(seen.x0, w), border(seen.x1, w));
        let (y0, y1) = (border(seen.y0, h), border(seen.y1, h));
        // Larger persons get higher scores.
        let size = (seen.visible_px as f64 / (0.06 * w * h)).min(1.0);
        Some(ScriptedDetection {
            stamp: self.stamp,
            class: seen.class,
            score: (0.45 + 0.35 * size + 0.15 * rng.unit()) as f32,
            x0: x0.min(x1),
            y0: y0.min(y1),
            x1: x0.max(x1),
            y1: y0.max(y1),
        })
    }

    /// A false alarm of an object, anywhere in the image, with a low score.
    fn false_thing(&self) -> Option<ScriptedDetection> {
        let mut rng = self.stream(FALSE_THINGS, self.index);
        if !rng.chance(self.noise.false_alarm) {
            return None;
        }
        let [w, h] = self.size;
        let (class, share) = SEEN_WRONGLY[rng.below(SEEN_WRONGLY.len())];
        let [width, height] = share.map(|s| h * s * rng.range(0.6, 1.4));
        let (width, height) = (width.min(w), height.min(h));
        let x0 = rng.range(-0.5, w - 0.5 - width);
        let y0 = rng.range(-0.5, h - 0.5 - height);
        Some(ScriptedDetection {
            stamp: self.stamp,
            class,
            score: rng.range(0.3, 0.5) as f32,
            x0,
            y0,
            x1: x0 + width,
            y1: y0 + height,
        })
    }

    /// A false alarm of a person, anywhere in the image and of any usual size, with a low score.
    fn false_alarm(&self) -> Option<ScriptedDetection> {
        let mut rng = self.stream(FALSE_ALARMS, self.index);
        if !rng.chance(self.noise.false_alarm) {
            return None;
        }
        let [w, h] = self.size;
        let height = h * rng.range(0.2, 0.8);
        let width = (height * rng.range(0.3, 0.6)).min(w);
        let x0 = rng.range(-0.5, w - 0.5 - width);
        let y0 = rng.range(-0.5, h - 0.5 - height);
        Some(ScriptedDetection {
            stamp: self.stamp,
            class: "person",
            score: rng.range(0.3, 0.5) as f32,
            x0,
            y0,
            x1: x0 + width,
            y1: y0 + height,
        })
    }
}
