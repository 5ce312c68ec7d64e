//! A walk through a room.

use super::{look_at, wave};
use stillpoint_geometry::{Se3, Vec3, so3};

/// A walk with a camera at chest height: along a closed uniform cubic B-spline, which is smooth to its second derivative, with equally
/// spaced control points, which make its speed nearly constant.
pub(super) struct Walk {
    control: Vec<[f64; 2]>,
    spacing: f64,
    /// End of the walk, m along the control polygon.
    pub(super) length: f64,
    speed: f64,
    /// Looks to both sides: amplitude (rad) and frequency (Hz), added to a slow variation.
    looks: [f64; 2],
}

impl Walk {
    /// Walking speed, m/s.
    const SPEED: f64 = 0.9;
    /// Fast walking speed, m/s.
    const FAST: f64 = 1.6;
    /// Looks in a fast walk: 35 degrees to both sides, up to 110 degrees per second.
    const FAST_LOOKS: [f64; 2] = [0.61, 0.5];
    /// Repeated part of the loop in a fast walk, m: more for the same time.
    const FAST_OVERLAP: f64 = 6.0;
    /// Height of the camera, m.
    const EYE: f64 = 1.35;
    /// Distance along the path of the point looked at, m.
    const AHEAD: f64 = 1.6;
    /// Repeated part of the loop after it is closed, m.
    const OVERLAP: f64 = 4.0;

    pub(super) fn new(corners: &[[f64; 2]]) -> Self {
        let side = |k: usize| {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            (a, [b[0] - a[0], b[1] - a[1]])
        };
        let length = |[x, y]: [f64; 2]| (x * x + y * y).sqrt();
        let total: f64 = (0..corners.len()).map(|k| length(side(k).1)).sum();
        let count = (total / 0.9).round();
        let spacing = total / count;
        let mut control = Vec::new();
        let (mut k, mut before) = (0, 0.0);
        for i in 0..count as usize {
            let s = i as f64 * spacing;
            while k + 1 < corners.len() && s > before + length(side(k).1) {
                before += length(side(k).1);
                k += 1;
            }
            let (a, d) = side(k);
            let share = (s - before) / length(d);
            control.push([a[0] + share * d[0], a[1] + share * d[1]]);
        }
        Self {
            control,
            spacing,
            length: count * spacing + Self::OVERLAP,
            speed: Self::SPEED,
            looks: [0.0; 2],
        }
    }

    pub(super) fn hurry(&mut self) {
        self.speed = Self::FAST;
        self.looks = Self::FAST_LOOKS;
        self.length += Self::FAST_OVERLAP - Self::OVERLAP;
    }

    pub(super) fn duration(&self) -> f64 {
        self.length / self.speed
    }

    /// The point of the spline at length `s` (of its control polygon).
    fn at(&self, s: f64) -> Vec3 {
        let n = self.control.len();
        let u = s / self.spacing;
        let (k, f) = (u.floor(), u - u.floor());
        let g = 1.0 - f;
        let weights = [
            g * g * g / 6.0,
            (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0,
            (3.0 * g * g * g - 6.0 * g * g + 4.0) / 6.0,
            f * f * f / 6.0,
        ];
        let mut p = Vec3::zeros();
        for (i, w) in weights.iter().enumerate() {
            let c = self.control[(k as i64 + i as i64 - 1).rem_euclid(n as i64) as usize];
            p += Vec3::new(c[0], c[1], 0.0) * *w;
        }
        p
    }

    pub(super) fn pose(&self, t: f64) -> Se3 {
        let s = self.speed * t;
        let (at, ahead) = (self.at(s), self.at(s + Self::AHEAD));
        let to = ahead - at;
        let across = Vec3::new(-to.y, to.x, 0.0);
        // Steps lift the camera twice a second; the gaze varies a little to both sides and down.
        let eye = at
            + Vec3::new(0.0, 0.0, Self::EYE + 0.012 * wave(t, 1.9, 0.0))
            + across * (0.008 * wave(t, 0.95, 0.4));
        let glance = across * (0.25 * wave(t, 0.13, 0.0))
            - Vec3::new(0.0, 0.0, 0.28 + 0.06 * wave(t, 0.21, 1.0));
        let ahead = Vec3::new(to.x, to.y, 0.0);
        let [amplitude, hertz] = self.looks;
        // Skipped at zero amplitude, so that slow walks stay bit-identical.
        let forward = if amplitude > 0.0 {
            so3::exp(&Vec3::new(0.0, 0.0, amplitude * wave(t, hertz, 0.0))) * ahead
        } else {
            ahead
        };
        look_at(eye, eye + forward + glance)
    }
}
