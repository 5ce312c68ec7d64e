//! Checks the synchronisation of depth and colour.
//!
//! Estimates by how much the stamp of a depth image is later than its exposure, relative to the colour image. A silhouette of the depth
//! image is shifted from its contour in the colour image by the velocity of that contour times the time between both exposures. Over some
//! seconds the velocity changes, so the best delay is distinguishable from a constant offset, which is estimated with it.

use crate::finding::{Figure, Finding, Report, Symptom};
use crate::gradient::{Axis, PROFILE, REACH};

/// Delays tried: this many steps to both sides of zero.
const STEPS: usize = 24;
/// s per step.
const STEP: f64 = 0.004;
/// Constant offsets tried to both sides, px: those of registered depth. More would absorb the delay if the velocity hardly changes.
const OFFSETS: usize = 3;
/// Number of parts of the stream, each left out in turn for the standard deviation (jackknife; Efron, 1982).
const PARTS: usize = 10;
/// Usual delays of stamps taken on arrival of images, s: a depth image is exposed for up to a frame's time and computed before it arrives,
/// so its stamp may be late by nearly a frame of 30 Hz; it is hardly ever early.
const USUAL: [f64; 2] = [-0.010, 0.025];
/// A delay beyond them by this many standard deviations is unusual.
const SIGMAS: f64 = 1.5;
/// Minimum improvement of the agreement at the best delay over any usual one, as a fraction of its range over all delays.
const MARGIN: f64 = 0.02;
/// The best delay is the mean of those whose agreement is within this top fraction of its range: the peak is flat where contours run side
/// by side.
const TOP: f64 = 0.12;
/// Maximum standard deviation of a known delay, s.
const MAX_SIGMA: f64 = 0.006;
/// A delay can still be reported as unusual up to this standard deviation, s.
const MAX_SIGMA_UNUSUAL: f64 = 0.010;
/// Minimum relative change of the agreement by the delay.
const MIN_CONTRAST: f64 = 0.1;
/// The estimate is too short by this fraction where contours of the background mix in: of 33 and 67 ms on simulated paths 27 to 33 and 56
/// to 76 were seen.
const SYSTEMATIC: f64 = 0.2;
/// Maximum delay of depth stamps of most drivers, s; a stream's shift is reported relative to that.
const USUALLY_LATE: f64 = 0.025;
/// Minimum number of silhouette pixels to judge.
const MIN_EDGES: usize = 2000;

/// A silhouette pixel with its image motion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moving {
    pub(crate) axis: Axis,
    /// Whether the surface ends towards the beginning of the axis.
    pub(crate) backwards: bool,
    pub(crate) x: u16,
    pub(crate) y: u16,
    pub(crate) z: f32,
    /// Velocity of the image along the axis, px/s.
    pub(crate) velocity: f32,
    /// Stamp of colour less that of depth, s.
    pub(crate) stamp_difference: f32,
    pub(crate) frame: u32,
}

impl Moving {
    /// Offset of its contour in the colour image, px along the axis, if stamps of depth are late by `delay` s.
    pub(crate) fn shift(&self, delay: f64) -> f32 {
        self.velocity * (self.stamp_difference + delay as f32)
    }

    /// Whether its profile covers all delays tried.
    fn is_slow(&self) -> bool {
        let latest = STEPS as f32 * STEP as f32 + self.stamp_difference.abs();
        self.velocity.abs() * latest + (OFFSETS as f32) < REACH as f32 - 1.0
    }
}

/// Value of a profile at an offset from its middle, by linear interpolation, clamped to its ends.
pub(crate) fn sample(profile: &[f32], shift: f32) -> f32 {
    let p = (shift + REACH as f32).clamp(0.0, (PROFILE - 2) as f32);
    let i = p as usize;
    let f = p - i as f32;
    (1.0 - f) * profile[i] + f * profile[i + 1]
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Delay {
    /// s by which stamps of depth are late.
    pub(crate) value: f64,
    pub(crate) sigma: f64,
    /// Relative change of the agreement by the delay.
    contrast: f64,
    /// Relative improvement of the agreement at the best delay over the best usual one.
    beyond: f64,
}

impl Delay {
    fn is_known(&self) -> bool {
        self.sigma <= MAX_SIGMA && self.contrast >= MIN_CONTRAST
    }

    /// Whether it may be reported, at least if unusual.
    pub(crate) fn is_sharp(&self) -> bool {
        self.sigma <= MAX_SIGMA_UNUSUAL && self.contrast >= MIN_CONTRAST
    }

    /// Standard deviation of the reported value, s: common errors of frames do not show in their scatter.
    fn uncertainty(&self) -> f64 {
        self.sigma.hypot(SYSTEMATIC * self.value)
    }

    fn is_unusual(&self) -> bool {
        let aside = (USUAL[0] - self.value).max(self.value - USUAL[1]);
        self.is_sharp() && aside > SIGMAS * self.sigma && self.beyond > MARGIN
    }
}

const DELAYS: usize = 2 * STEPS + 1;
const SHIFTS: usize = 2 * OFFSETS + 1;

/// Sums of profiles by delay and offset.
#[derive(Clone)]
struct Votes {
    sum: Vec<f64>,
    count: [f64; 2],
}

impl Votes {
    fn new() -> Self {
        Self {
            sum: vec![0.0; 2 * DELAYS * SHIFTS],
            count: [0.0; 2],
        }
    }

    fn add(&mut self, edge: &Moving, profile: &[f32]) {
        let axis = edge.axis.index();
        self.count[axis] += 1.0;
        for d in 0..DELAYS {
            let shift = edge.shift(delay_of(d as f64));
            let row = &mut self.sum[(axis * DELAYS + d) * SHIFTS..][..SHIFTS];
            for (k, sum) in row.iter_mut().enumerate() {
                *sum += f64::from(sample(profile, shift + k as f32 - OFFSETS as f32));
            }
        }
    }

    fn combine(&mut self, other: &Self, sign: f64) {
        for (sum, value) in self.sum.iter_mut().zip(&other.sum) {
            *sum += sign * value;
        }
        for (count, value) in self.count.iter_mut().zip(&other.count) {
            *count += sign * value;
        }
    }

    /// Agreement of silhouettes and contours at each delay, with the best offset along each axis.
    fn agreement(&self) -> [f64; DELAYS] {
        let mut total = [0.0; DELAYS];
        let all = (self.count[0] + self.count[1]).max(1.0);
        for axis in 0..2 {
            for (d, total) in total.iter_mut().enumerate() {
                let row = &self.sum[(axis * DELAYS + d) * SHIFTS..][..SHIFTS];
                *total += row.iter().copied().fold(0.0, f64::max) / all;
            }
        }
        total
    }
}

fn delay_of(step: f64) -> f64 {
    (step - STEPS as f64) * STEP
}

/// The delay with the best agreement, s: the mean of the highest peak.
fn best_delay(agreement: &[f64; DELAYS]) -> f64 {
    let low = agreement.iter().copied().fold(f64::MAX, f64::min);
    let top = (0..DELAYS)
        .max_by(|&a, &b| agreement[a].total_cmp(&agreement[b]))
        .unwrap_or(STEPS);
    let limit = agreement[top] - TOP * (agreement[top] - low);
    let above = |d: &usize| agreement[*d] > limit;
    let left = (0..=top).rev().take_while(above);
    let right = (top + 1..DELAYS).take_while(above);
    let (mut sum, mut weights) = (0.0, 0.0);
    for d in left.chain(right) {
        let weight = agreement[d] - limit;
        sum += weight * delay_of(d as f64);
        weights += weight;
    }
    if weights > 0.0 {
        sum / weights
    } else {
        delay_of(top as f64)
    }
}

/// Estimates the delay from silhouettes and their profiles ([`PROFILE`] values each).
pub(crate) fn estimate(edges: &[Moving], profiles: &[f32]) -> Option<Delay> {
    let slow = |(e, _): &(&Moving, &[f32])| e.is_slow();
    let usable = || {
        edges
            .iter()
            .zip(profiles.chunks_exact(PROFILE))
            .filter(slow)
    };
    let count = usable().count();
    if count < MIN_EDGES {
        return None;
    }
    // Consecutive parts of equally many frames: errors of neighbouring frames are correlated.
    let (first, last) = (edges.first()?.frame, edges.last()?.frame);
    let span = last - first + 1;
    let mut parts = vec![Votes::new(); PARTS];
    for (edge, profile) in usable() {
        let part = (edge.frame - first) as usize * PARTS / span as usize;
        parts[part].add(edge, profile);
    }
    let mut whole = Votes::new();
    for part in &parts {
        whole.combine(part, 1.0);
    }
    let agreement = whole.agreement();
    let (low, high) = agreement
        .iter()
        .fold((f64::MAX, 0.0_f64), |(l, h), a| (l.min(*a), h.max(*a)));
    let is_usual = |d: &usize| {
        let delay = delay_of(*d as f64);
        (USUAL[0]..=USUAL[1]).contains(&delay)
    };
    let usual = (0..DELAYS)
        .filter(is_usual)
        .map(|d| agreement[d])
        .fold(0.0, f64::max);
    Some(Delay {
        value: best_delay(&agreement),
        sigma: jackknife(&whole, &parts),
        contrast: (high - low) / high.max(1e-9),
        beyond: (high - usual) / (high - low).max(1e-9),
    })
}

fn jackknife(whole: &Votes, parts: &[Votes]) -> f64 {
    let without = |part: &Votes| {
        let mut rest = whole.clone();
        rest.combine(part, -1.0);
        best_delay(&rest.agreement())
    };
    let filled = parts.iter().filter(|p| p.count[0] + p.count[1] > 0.0);
    let values: Vec<f64> = filled.map(without).collect();
    let n = values.len() as f64;
    if n < 3.0 {
        return f64::INFINITY;
    }
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    // The grid leaves half a step.
    (squares * (n - 1.0) / n).sqrt().max(0.5 * STEP)
}

pub(crate) fn judge(delay: Option<&Delay>, report: &mut Report) {
    let Some(delay) = delay.filter(|d| d.is_known() || d.is_unusual()) else {
        report.pass_over(
            "whether colour and depth were taken at the same time: the view of the camera changes too little, or too fast throughout",
        );
        return;
    };
    let figure = Figure::new("stamps of depth late by", 1000.0 * delay.value, "ms")
        .with_sigma(1000.0 * delay.uncertainty());
    report.measure(figure.clone());
    if !delay.is_unusual() {
        return;
    }
    let ms = 1000.0 * delay.value.abs();
    let usual = 1000.0 * USUALLY_LATE;
    let (late, least, most) = if delay.value > 0.0 {
        ("later", (ms - usual).max(0.0), ms)
    } else {
        ("earlier", ms, ms + usual)
    };
    report.find(Finding {
        symptom: Symptom::Synchronisation,
        message: format!(
            "colour and depth are out of sync: stamps of depth images are {ms:.0} ms +- {:.0} ms {late} than what they show, {least:.0} to {most:.0} ms {late} than drivers make them as a rule",
            1000.0 * delay.uncertainty()
        ),
        remedy: format!(
            "run with --set sensor.depth_delay={:.3}, or correct the stamps where they are made (use the device's clock, not the arrival)",
            delay.value
        ),
        evidence: vec![
            figure,
            Figure::new("share of the agreement gained over any usual delay", delay.beyond, ""),
        ],
    });
}
