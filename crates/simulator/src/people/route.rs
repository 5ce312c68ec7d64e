//! Position, heading, sitting and gestures of a person, as smooth functions of time.

#[derive(Clone, Copy)]
pub(crate) enum Leg {
    /// Walks straight to (x, y) in m at a speed in m/s.
    To(f64, f64, f64),
    /// Like `To`, facing a constant direction: steps aside.
    Aside(f64, f64, f64, f64),
    /// Stands for some seconds, facing a direction (rad, 0 along x, to the left).
    Stand(f64, f64),
    Talk(f64, f64),
    /// Sits for some seconds with talking hands, facing a direction.
    Sit(f64, f64),
}

#[derive(Clone, Copy, Default)]
pub(crate) struct Doing {
    /// Position on the floor, m.
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Heading of the body, rad.
    pub(crate) yaw: f64,
    /// 0 standing to 1 sitting.
    pub(crate) sitting: f64,
    /// 0 still hands to 1 talking hands.
    pub(crate) talking: f64,
}

impl Doing {
    fn array(self) -> [f64; 5] {
        [self.x, self.y, self.yaw, self.sitting, self.talking]
    }

    fn from_array([x, y, yaw, sitting, talking]: [f64; 5]) -> Self {
        Self {
            x,
            y,
            yaw,
            sitting,
            talking,
        }
    }
}

/// A uniform cubic B-spline through samples of the stages: smooth to its second derivative, and never faster than they.
pub(crate) struct Route {
    control: Vec<Doing>,
}

/// Time between control points, s.
const SPACING: f64 = 0.4;

impl Route {
    /// The route that begins at `start` = [x, y, yaw] and time 0.
    pub(crate) fn new([x, y, yaw]: [f64; 3], stages: &[Leg]) -> Self {
        let mut now = Doing {
            x,
            y,
            yaw,
            ..Doing::default()
        };
        let mut control = Vec::new();
        // Time since the last control point, s.
        let mut since = SPACING;
        for stage in stages {
            let from = now;
            let (seconds, to) = Self::goal(from, *stage);
            now = Doing {
                x: from.x,
                y: from.y,
                ..to
            };
            let mut t = SPACING - since;
            while t < seconds {
                let share = t / seconds;
                now.x = from.x + (to.x - from.x) * share;
                now.y = from.y + (to.y - from.y) * share;
                control.push(now);
                t += SPACING;
            }
            since = seconds - (t - SPACING);
            now = to;
        }
        if control.is_empty() {
            control.push(now);
        }
        Self { control }
    }

    /// Duration and final state of a stage.
    fn goal(from: Doing, stage: Leg) -> (f64, Doing) {
        let still = |yaw: f64, sitting: f64, talking: f64| Doing {
            yaw: nearest_turn(yaw, from.yaw),
            sitting,
            talking,
            ..from
        };
        match stage {
            Leg::To(x, y, speed) => {
                let (dx, dy) = (x - from.x, y - from.y);
                let to = Doing {
                    x,
                    y,
                    ..still(libm::atan2(dy, dx), 0.0, 0.0)
                };
                (libm::hypot(dx, dy) / speed, to)
            }
            Leg::Aside(x, y, speed, yaw) => {
                let seconds = libm::hypot(x - from.x, y - from.y) / speed;
                let to = Doing {
                    x,
                    y,
                    ..still(yaw, 0.0, 0.0)
                };
                (seconds, to)
            }
            Leg::Stand(seconds, yaw) => (seconds, still(yaw, 0.0, 0.0)),
            Leg::Talk(seconds, yaw) => (seconds, still(yaw, 0.0, 1.0)),
            Leg::Sit(seconds, yaw) => (seconds, still(yaw, 1.0, 1.0)),
        }
    }

    /// The state at a time, s; constant before the start and after the end.
    pub(crate) fn at(&self, t: f64) -> Doing {
        let u = t / SPACING;
        let (k, f) = (libm::floor(u), u - libm::floor(u));
        let g = 1.0 - f;
        let weights = [
            g * g * g / 6.0,
            (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0,
            (3.0 * g * g * g - 6.0 * g * g + 4.0) / 6.0,
            f * f * f / 6.0,
        ];
        let last = self.control.len() as i64 - 1;
        let mut sum = [0.0; 5];
        for (i, w) in weights.iter().enumerate() {
            let c = self.control[(k as i64 + i as i64 - 1).clamp(0, last) as usize].array();
            (0..5).for_each(|n| sum[n] += w * c[n]);
        }
        Doing::from_array(sum)
    }

    /// Speed over the floor at a time, m/s.
    pub(crate) fn speed(&self, t: f64) -> f64 {
        let (a, b) = (self.at(t - 0.05), self.at(t + 0.05));
        libm::hypot(b.x - a.x, b.y - a.y) / 0.1
    }
}

/// `angle` plus the whole number of turns that brings it closest to `other`.
fn nearest_turn(angle: f64, other: f64) -> f64 {
    let tau = std::f64::consts::TAU;
    angle - tau * libm::round((angle - other) / tau)
}
