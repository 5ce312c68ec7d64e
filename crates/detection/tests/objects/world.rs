//! A simulated world for the tracker: walking ellipsoids in a room, a moving camera, and a detector with faults.

use stillpoint_detection::{BoundingBox, ClassId, Detection, Detections};
use stillpoint_geometry::{BrownConrady, Camera, Se3, Vec2, Vec3, so3};
use stillpoint_imaging::{CoarseDepth, DepthImage, FrameId};

pub(crate) const RATE: f64 = 30.0;

/// Uniform in 0..1 from a seed and an address (splitmix64).
pub(crate) fn uniform(seed: u64, address: [u64; 3]) -> f64 {
    let mut x = seed;
    for a in address {
        x = x.wrapping_add(a.wrapping_mul(0x9e37_79b9_7f4a_7c15)) ^ 0x1234_5678_9abc_def1;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^= x >> 31;
    }
    (x >> 11) as f64 / (1_u64 << 53) as f64
}

/// Approximately normal: the sum of twelve uniform numbers.
pub(crate) fn normal(seed: u64, [a, b]: [u64; 2]) -> f64 {
    (0..12).map(|i| uniform(seed, [a, b, i + 100])).sum::<f64>() - 6.0
}

pub(crate) fn pinhole() -> Camera {
    Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5])
}

/// The strongly distorted camera of the TUM fr1 sequences.
pub(crate) fn distorted() -> Camera {
    Camera {
        distortion: BrownConrady {
            k1: 0.2624,
            k2: -0.9531,
            p1: -0.0054,
            p2: 0.0026,
            k3: 1.1633,
        },
        ..Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3])
    }
}

/// A person: an ellipsoid centred at `path(t)`.
pub(crate) struct Walker {
    pub(crate) path: Box<dyn Fn(f64) -> Vec3>,
    /// Size relative to 1.7 m height.
    pub(crate) scale: f64,
}

impl Walker {
    pub(crate) fn new(path: impl Fn(f64) -> Vec3 + 'static) -> Self {
        Self {
            path: Box::new(path),
            scale: 1.0,
        }
    }

    fn axes(&self) -> Vec3 {
        Vec3::new(0.25, 0.85, 0.15) * self.scale
    }

    fn surface(&self, t: f64) -> Vec<Vec3> {
        let (middle, axes) = ((self.path)(t), self.axes());
        let mut points = Vec::new();
        for i in 0..=12 {
            let (sp, cp) = libm::sincos(f64::from(i) / 12.0 * std::f64::consts::PI);
            for j in 0..16 {
                let (sa, ca) = libm::sincos(f64::from(j) / 8.0 * std::f64::consts::PI);
                points.push(middle + axes.component_mul(&Vec3::new(sp * ca, -cp, sp * sa)));
            }
        }
        points
    }

    /// Distance along a ray to the near side, in lengths of the direction.
    fn hit(&self, t: f64, from: &Vec3, direction: &Vec3) -> Option<f64> {
        let axes = self.axes();
        let o = (from - (self.path)(t)).component_div(&axes);
        let d = direction.component_div(&axes);
        let (a, b, c) = (d.dot(&d), o.dot(&d), o.dot(&o) - 1.0);
        let root = b * b - a * c;
        (root >= 0.0)
            .then(|| (-b - root.sqrt()) / a)
            .filter(|s| *s > 0.05)
    }
}

/// A room of 10 x 4 x 10 m around the origin, with people.
pub(crate) struct World {
    pub(crate) camera: Camera,
    pub(crate) walkers: Vec<Walker>,
    pub(crate) path: Box<dyn Fn(f64) -> Se3>,
    pub(crate) with_depth: bool,
}

/// Rotation by yaw, pitch, roll about the camera's y, x, z axes.
pub(crate) fn turned(yaw: f64, pitch: f64, roll: f64, at: Vec3) -> Se3 {
    let r = so3::exp(&(Vec3::y() * yaw)) * so3::exp(&(Vec3::x() * pitch));
    Se3::new(r * so3::exp(&(Vec3::z() * roll)), at)
}

impl World {
    pub(crate) fn new(walkers: Vec<Walker>, path: impl Fn(f64) -> Se3 + 'static) -> Self {
        Self {
            camera: pinhole(),
            walkers,
            path: Box::new(path),
            with_depth: true,
        }
    }

    pub(crate) fn pose(&self, t: f64) -> Se3 {
        (self.path)(t)
    }

    /// A walker's box in the raw image and visible share; `None` when less than a third of it is in the image.
    pub(crate) fn truth(&self, n: usize, t: f64) -> Option<(BoundingBox, f64)> {
        let pose = self.pose(t);
        let inverse = pose.inverse();
        let surface = self.walkers[n].surface(t);
        let (mut b, mut open, mut inside) = (None::<BoundingBox>, 0, 0);
        for world in &surface {
            let p = inverse.transform(world);
            if p.z < 0.2 {
                return None;
            }
            let px = self.camera.project(&p);
            // Outside the image the distortion is not one to one.
            let raw = if (px - Vec2::new(319.5, 239.5)).norm() < 420.0 {
                self.camera.distort(px)
            } else {
                px
            };
            inside += usize::from(self.camera.contains(raw));
            let ray = world - pose.translation;
            let hidden =
                self.walkers.iter().enumerate().any(|(m, w)| {
                    m != n && w.hit(t, &pose.translation, &ray).is_some_and(|s| s < 1.0)
                });
            open += usize::from(!hidden);
            let grown = b.get_or_insert(BoundingBox {
                x0: raw.x,
                y0: raw.y,
                x1: raw.x,
                y1: raw.y,
            });
            grown.x0 = grown.x0.min(raw.x);
            grown.y0 = grown.y0.min(raw.y);
            grown.x1 = grown.x1.max(raw.x);
            grown.y1 = grown.y1.max(raw.y);
        }
        let total = surface.len();
        (inside * 3 >= total).then(|| {
            let bounds = b.unwrap_or_default().clipped(640, 480);
            (bounds, open as f64 / total as f64)
        })
    }

    /// The box of a walker's visible part and its area, px; `None` below 1500 px.
    pub(crate) fn shown(&self, n: usize, t: f64) -> Option<(BoundingBox, f64)> {
        const STEP: usize = 4;
        let pose = self.pose(t);
        let (mut b, mut area) = (None::<BoundingBox>, 0.0);
        for y in (0..480).step_by(STEP) {
            for x in (0..640).step_by(STEP) {
                let raw = Vec2::new(x as f64 + 1.5, y as f64 + 1.5);
                let ray = pose.rotation * self.camera.ray(self.camera.undistort(raw));
                let hit = |w: &Walker| w.hit(t, &pose.translation, &ray);
                let own = hit(&self.walkers[n]);
                let first = self.walkers.iter().filter_map(hit).fold(1e9, f64::min);
                if own != Some(first) {
                    continue;
                }
                area += (STEP * STEP) as f64;
                let half = STEP as f64 / 2.0;
                let cell = [raw.x - half, raw.y - half, raw.x + half, raw.y + half];
                let [x0, y0, x1, y1] = cell;
                let grown = b.get_or_insert(BoundingBox { x0, y0, x1, y1 });
                grown.x0 = grown.x0.min(x0);
                grown.y0 = grown.y0.min(y0);
                grown.x1 = grown.x1.max(x1);
                grown.y1 = grown.y1.max(y1);
            }
        }
        b.map(|b| (b.clipped(640, 480), area))
            .filter(|b| b.1 >= 1500.0)
    }

    pub(crate) fn depth(&self, t: f64) -> CoarseDepth {
        if !self.with_depth {
            return CoarseDepth::default();
        }
        let pose = self.pose(t);
        let mut data = vec![0.0_f32; 640 * 480];
        for y in 0..60 {
            for x in 0..80 {
                let raw = Vec2::new(f64::from(x) * 8.0 + 3.5, f64::from(y) * 8.0 + 3.5);
                let ray = self.camera.ray(self.camera.undistort(raw));
                let z = self.depth_along(t, &pose, &ray) as f32;
                for v in 0..8 {
                    let start = (y * 8 + v) as usize * 640 + x as usize * 8;
                    data[start..start + 8].fill(z);
                }
            }
        }
        CoarseDepth::new(&DepthImage::from_vec(640, 480, data).unwrap(), 8)
    }

    fn depth_along(&self, t: f64, pose: &Se3, ray: &Vec3) -> f64 {
        let direction = pose.rotation * ray;
        let walls = [(0, 5.0), (1, 2.0), (2, 5.0)].map(|(i, half)| {
            let side = if direction[i] > 0.0 { half } else { -half };
            let s = (side - pose.translation[i]) / direction[i];
            if s.is_finite() && s > 0.0 { s } else { 1e9 }
        });
        let wall = walls.into_iter().fold(1e9, f64::min);
        self.walkers
            .iter()
            .filter_map(|w| w.hit(t, &pose.translation, &direction))
            .fold(wall, f64::min)
    }
}

pub(crate) struct Faults {
    pub(crate) seed: u64,
    /// Standard deviation of each side as a share of the box's size.
    pub(crate) jitter: f64,
    /// Probability of a missed walker per frame.
    pub(crate) drop: f64,
    /// Frames in which all walkers are missed.
    pub(crate) gap: fn(u64) -> bool,
    /// Probability of a false alarm per frame.
    pub(crate) false_alarms: f64,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            seed: 1,
            jitter: 0.03,
            drop: 0.0,
            gap: |_| false,
            false_alarms: 0.0,
        }
    }
}

impl Faults {
    /// The detections of a frame. People hidden by 40 % or more are not detected.
    pub(crate) fn detect(&self, world: &World, frame: u64) -> Detections {
        let t = frame as f64 / RATE;
        let mut items = Vec::new();
        for n in 0..world.walkers.len() {
            let missed = uniform(self.seed, [frame, n as u64, 7]) < self.drop || (self.gap)(frame);
            if let Some((bounds, open)) = world.truth(n, t)
                && open >= 0.6
                && !missed
            {
                items.push(self.jittered(bounds, frame, n as u64));
            }
        }
        if uniform(self.seed, [frame, 99, 8]) < self.false_alarms {
            let u = |i: u64| uniform(self.seed, [frame, 99, 9 + i]);
            let (x0, y0) = (u(0) * 500.0, u(1) * 300.0);
            items.push(person(BoundingBox {
                x0,
                y0,
                x1: x0 + 40.0 + 100.0 * u(2),
                y1: y0 + 80.0 + 100.0 * u(3),
            }));
        }
        Detections {
            frame: FrameId(frame as u32),
            stamp: t,
            items,
        }
    }

    fn jittered(&self, b: BoundingBox, frame: u64, n: u64) -> Detection {
        let e = |i: u64, size: f64| normal(self.seed, [frame, 10 * n + i]) * self.jitter * size;
        let (w, h) = (b.width(), b.height());
        let moved = BoundingBox {
            x0: b.x0 + e(0, w),
            y0: b.y0 + e(1, h),
            x1: b.x1 + e(2, w),
            y1: b.y1 + e(3, h),
        };
        person(moved.clipped(640, 480))
    }
}

pub(crate) fn person(bounds: BoundingBox) -> Detection {
    Detection {
        class: ClassId::PERSON,
        score: 0.8,
        bounds,
    }
}
