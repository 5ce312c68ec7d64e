//! Checks the focal length.
//!
//! Estimates the factor on the focal lengths for which corners with depth move rigidly. When the camera turns, the image moves by the focal
//! length times the angle, and depth changes by the angle times the distance from the middle over the focal length: both together give the
//! angle and the focal length. Motion without rotation does not determine it, and is not judged. Only one factor for fx and fy is
//! estimated; pixels are assumed square, which is compared with the intrinsics.

use crate::finding::{Figure, Finding, Report, Symptom};
use crate::tracks::{Sight, Tracks};
use stillpoint_estimation::{
    Intrinsics, Measurement, Purpose, RigidOptions, RigidPair, find_rigid, rng,
};
use stillpoint_geometry::nalgebra::{SMatrix, SVector};
use stillpoint_geometry::{Camera, Mat6, Se3, Vec2, Vec3, Vec6};

/// Maximum time between compared views, s: beyond it too few corners survive.
const MAX_GAP: f64 = 1.5;
/// Minimum number of corners shared by two views.
const MIN_COMMON: usize = 30;
/// Noise of a corner's position in either view, px, and factor on that of depth (0.0012 m + 0.0019 m^-1 (z - 0.4 m)^2; Nguyen, Izadi and
/// Lovell, 3DIMPVT 2012), which neighbouring pixels share.
const SIGMA_PX: f64 = 0.6;
const DEPTH_FACTOR: f64 = 1.5;
/// Normalised residuals: weights decrease beyond the first (Huber), and vanish beyond the second.
const HUBER: f64 = 2.0;
const GATE: f64 = 12.0;
const ROUNDS: usize = 10;
/// Systematic uncertainty of the factor from depth, stamps and shutter, as a fraction: on real and simulated streams with known focal
/// length, the estimate from three seconds was up to 9 % off where the camera turned by ten degrees, with depth images 17 ms late.
const SYSTEMATIC: f64 = 0.1;
/// With a larger standard deviation, the focal length is not judged.
const MAX_SIGMA: f64 = 0.025;
/// fx and fy of real cameras differ by less, as a fraction: pixels are square to some per mille.
const SQUARE: f64 = 0.04;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Factor {
    log: f64,
    sigma: f64,
}

struct Pair {
    sights: Vec<[Sight; 2]>,
    b_from_a: Se3,
}

type Mat7 = SMatrix<f64, 7, 7>;
type Vec7 = SVector<f64, 7>;

/// Estimates the factor; `None` if the camera turned too little.
pub(crate) fn estimate(camera: &Camera, tracks: &Tracks) -> Option<Factor> {
    let mut pairs = common_motion(camera, tracks);
    if pairs.len() < 3 {
        return None;
    }
    let mut log = 0.0;
    let mut information = 0.0;
    let mut scatter = 0.0;
    for round in 0..ROUNDS {
        (information, scatter) = (0.0, 0.0);
        let mut gradient = 0.0;
        for pair in &mut pairs {
            let Some([i, g]) = pair.reduce(camera, log, round) else {
                continue;
            };
            information += i;
            gradient += g;
            scatter += g * g;
        }
        if information <= 0.0 {
            return None;
        }
        let step = (-gradient / information).clamp(-0.2, 0.2);
        log += step;
        if step.abs() < 1e-5 {
            break;
        }
    }
    // The spread of the pairs' gradients measures their disagreement (Huber, 1967), whatever the assumed noise.
    let sigma = scatter.sqrt().max(information.sqrt()) / information;
    Some(Factor { log, sigma }).filter(|f| f.log.is_finite() && f.log.abs() < 0.7)
}

/// The pairs of views whose shared corners move rigidly, with that motion.
fn common_motion(camera: &Camera, tracks: &Tracks) -> Vec<Pair> {
    let views = tracks.views();
    let mut pairs = Vec::new();
    for a in 0..views.len() {
        for b in a + 1..views.len() {
            if views[b] - views[a] > MAX_GAP {
                break;
            }
            let sights = tracks.common(a as u32, b as u32);
            if sights.len() < MIN_COMMON {
                continue;
            }
            let points = sights.iter().map(|s| rigid_pair(camera, s));
            let points: Vec<RigidPair> = points.collect();
            let options = RigidOptions {
                max_iterations: 300,
                min_inliers: MIN_COMMON / 2,
                ..RigidOptions::default()
            };
            let stream = rng(0, (a * views.len() + b) as u64, Purpose::RIGID);
            let found = find_rigid(&Intrinsics::from(camera), &points, &options, stream);
            if let Some(found) = found.found() {
                pairs.push(Pair {
                    sights,
                    b_from_a: found.b_from_a,
                });
            }
        }
    }
    pairs
}

/// For the search: wide gates, since the focal length may be wrong.
fn rigid_pair(camera: &Camera, sights: &[Sight; 2]) -> RigidPair {
    let [a, b] = sights.map(|s| {
        let pixel = camera.undistort(Vec2::new(f64::from(s.pixel[0]), f64::from(s.pixel[1])));
        let z = f64::from(s.z);
        let measurement = Measurement::new(pixel, 2.0, Some((z, 3.0 * depth_sigma(z))));
        (camera.backproject(pixel, z), measurement)
    });
    RigidPair {
        point_a: a.0,
        point_b: b.0,
        measurement_a: a.1,
        measurement_b: b.1,
    }
}

fn depth_sigma(z: f64) -> f64 {
    let d = z - 0.4;
    0.0012 + 0.0019 * d * d
}

/// The camera with other focal lengths. Distortion coefficients apply to rays and stay.
fn scaled(camera: &Camera, log: f64) -> Camera {
    let factor = libm::exp(log);
    Camera {
        fx: camera.fx * factor,
        fy: camera.fy * factor,
        ..*camera
    }
}

/// Rays (z = 1) in both views.
fn rays(camera: &Camera, sights: &[Sight; 2]) -> [Vec3; 2] {
    sights.map(|s| {
        let raw = Vec2::new(f64::from(s.pixel[0]), f64::from(s.pixel[1]));
        camera.ray(camera.undistort(raw))
    })
}

/// Normalised residual of a corner; `[x px, y px, depth]`.
fn residual(camera: &Camera, rays: &[Vec3; 2], depths: [f64; 2], b_from_a: &Se3) -> Vec3 {
    let y = b_from_a.transform(&(rays[0] * depths[0]));
    Vec3::new(
        (y.x / y.z - rays[1].x) * camera.fx / SIGMA_PX,
        (y.y / y.z - rays[1].y) * camera.fy / SIGMA_PX,
        (depths[1] - y.z) / (DEPTH_FACTOR * depth_sigma(depths[1])),
    )
}

impl Pair {
    /// Moves the pose to its optimum for the current factor, and returns the information and gradient of the factor's logarithm after
    /// marginalising the pose (the Schur complement).
    fn reduce(&mut self, camera: &Camera, log: f64, round: usize) -> Option<[f64; 2]> {
        const STEP: f64 = 1e-4;
        let here = scaled(camera, log);
        let beside = scaled(camera, log + STEP);
        let both: Vec<[[Vec3; 2]; 2]> = self
            .sights
            .iter()
            .map(|s| [rays(&here, s), rays(&beside, s)])
            .collect();
        let gate = if round == 0 { 2.0 * GATE } else { GATE };
        for _ in 0..if round == 0 { 4 } else { 2 } {
            let (h, g) = self.normal_equations(&[here, beside], &both, STEP, gate)?;
            let pose = h.fixed_view::<6, 6>(0, 0) + Mat6::identity() * 1e-6;
            let step = pose.cholesky()?.solve(&g.fixed_rows::<6>(0).into_owned());
            let motion = Se3::exp(&-step);
            self.b_from_a = (motion * self.b_from_a).normalized();
        }
        let (h, g) = self.normal_equations(&[here, beside], &both, STEP, gate)?;
        let pose = h.fixed_view::<6, 6>(0, 0) + Mat6::identity() * 1e-6;
        let factor = pose.cholesky()?;
        let cross: Vec6 = h.fixed_view::<6, 1>(0, 6).into_owned();
        let gradient: Vec6 = g.fixed_rows::<6>(0).into_owned();
        let information = h[(6, 6)] - cross.dot(&factor.solve(&cross));
        let left = g[6] - cross.dot(&factor.solve(&gradient));
        (information > 0.0 && left.is_finite()).then_some([information, left])
    }

    fn normal_equations(
        &self,
        cameras: &[Camera; 2],
        rays: &[[[Vec3; 2]; 2]],
        step: f64,
        gate: f64,
    ) -> Option<(Mat7, Vec7)> {
        let (mut h, mut g) = (Mat7::zeros(), Vec7::zeros());
        let mut used = 0;
        for (sights, rays) in self.sights.iter().zip(rays) {
            let depths = sights.map(|s| f64::from(s.z));
            let e = residual(&cameras[0], &rays[0], depths, &self.b_from_a);
            let size = e.norm();
            // False for NaN.
            let inside = size <= gate;
            let y = self.b_from_a.transform(&(rays[0][0] * depths[0]));
            if !inside || y.z < 0.05 {
                continue;
            }
            used += 1;
            let weight = HUBER / size.max(HUBER);
            let other = residual(&cameras[1], &rays[1], depths, &self.b_from_a);
            let (sx, sy) = (cameras[0].fx / SIGMA_PX, cameras[0].fy / SIGMA_PX);
            let depth = -1.0 / (DEPTH_FACTOR * depth_sigma(depths[1]));
            let (iz, iz2) = (1.0 / y.z, 1.0 / (y.z * y.z));
            let by_point = [
                Vec3::new(sx * iz, 0.0, -sx * y.x * iz2),
                Vec3::new(0.0, sy * iz, -sy * y.y * iz2),
                Vec3::new(0.0, 0.0, depth),
            ];
            for (k, d) in by_point.iter().enumerate() {
                // A left perturbation moves the point by v + w x y.
                let turn = y.cross(d);
                let focal = (other[k] - e[k]) / step;
                let row = Vec7::from([d.x, d.y, d.z, turn.x, turn.y, turn.z, focal]);
                h += row * row.transpose() * weight;
                g += row * (weight * e[k]);
            }
        }
        (used >= MIN_COMMON / 2).then_some((h, g))
    }
}

/// Judges focal lengths; `why_not` is the reason for which depth cannot be used.
pub(crate) fn judge(
    camera: &Camera,
    factor: Option<Factor>,
    why_not: Option<&str>,
    report: &mut Report,
) {
    let ratio = libm::log(camera.fx / camera.fy.abs());
    let known = factor.filter(|f| f.sigma <= MAX_SIGMA && why_not.is_none());
    if let Some(f) = known {
        report.measure(figure(&f));
    }
    if ratio.abs() > SQUARE {
        report.find(not_square(camera, ratio, known));
        return;
    }
    match (known, why_not) {
        (Some(f), _) if f.log.abs() > SYSTEMATIC + 2.0 * f.sigma => {
            let right = libm::exp(f.log);
            report.find(Finding {
                symptom: Symptom::FocalLength,
                message: format!(
                    "the focal length is wrong by about {:.0} %: with fx = {:.0} px and fy = {:.0} px the scene would be rigid",
                    100.0 * (1.0 / right - 1.0),
                    camera.fx * right,
                    camera.fy * right
                ),
                remedy: "check that the camera's figures belong to this camera and this image size (--camera camera.toml), or calibrate".into(),
                evidence: vec![figure(&f)],
            });
        }
        (Some(_), _) => {}
        (None, Some(why)) => report.pass_over(format!("the focal length: {why}")),
        (None, None) => report.pass_over("the focal length: the camera turns too little"),
    }
}

fn figure(f: &Factor) -> Figure {
    let value = libm::exp(f.log);
    let sigma = libm::hypot(f.sigma, 0.5 * SYSTEMATIC);
    Figure::new("factor on the focal length", value, "").with_sigma(value * sigma)
}

fn not_square(camera: &Camera, ratio: f64, factor: Option<Factor>) -> Finding {
    let Camera { fx, fy, .. } = *camera;
    let mut evidence = vec![Figure::new("fx over fy", fx / fy, "")];
    // The views ask for no change of the right one, and for the whole ratio on the other.
    let wrong = factor.map(|f| {
        evidence.push(figure(&f));
        if f.log * ratio < 0.0 { "fx" } else { "fy" }
    });
    let (name, value, right) = match (wrong, ratio > 0.0) {
        (Some("fx"), _) => ("fx", fx, fy),
        (Some(_), _) => ("fy", fy, fx),
        (None, _) => ("fx or fy", fx, fy),
    };
    Finding {
        symptom: Symptom::FocalLength,
        message: format!(
            "{name} is wrong by about {:.0} %: fx = {fx:.1} px and fy = {fy:.1} px, but pixels are square",
            100.0 * (value / right - 1.0).abs()
        ),
        remedy: format!(
            "correct {name} in the camera file (--camera camera.toml); where images were resized unevenly, resize them evenly"
        ),
        evidence,
    }
}
