//! Covariance of the motion between two keyframes from shared landmarks.
//!
//! A landmark's contribution to a keyframe's pose does not depend on other keyframes: it is computed once per keyframe
//! and summed for each neighbour.

use super::nodes::Nodes;
use crate::association::measurement_in;
use crate::covariance::moved;
use crate::landmark_set::LandmarkSet;
use stillpoint_estimation::{Intrinsics, Measurement, linearise, pose_covariance};
use stillpoint_geometry::{Mat6, Se3, Vec3, Vec6};
use stillpoint_map::{Keyframe, LandmarkId, MapView};

/// Minimum number of shared landmarks to measure a motion (decision 22); with fewer, the frames between were bridged by
/// flow.
const MIN_MEASURED: usize = 15;

/// Error of a tie's translation beside landmark noise, per axis, m. Chosen: with these floors true edges cost at most
/// 1.6 and false ones at least 1340 (measured, decision 22).
const TIE_M: f64 = 0.002;
/// Likewise for rotation, per axis, rad: a twentieth of a degree. Chosen with [`TIE_M`] (decision 22).
const TIE_RAD: f64 = 0.0009;
/// Likewise relative to the motion, in length and angle, a share: the form of odometry noise (Thrun, Burgard, Fox,
/// "Probabilistic Robotics", 2005, section 5.4).
const TIE_SHARE: f64 = 0.01;
/// Translation error of frames bridged by flow, per axis, m. Measured: they are off by 5 to 10 cm after a second
/// (decision 18).
const BRIDGED_M: f64 = 0.05;
/// Likewise for rotation, rad: two degrees. Chosen with [`BRIDGED_M`]: 5 cm at 1.5 m (decision 22).
const BRIDGED_RAD: f64 = 0.035;
/// Likewise relative to the motion, a share. Chosen: ten times that of ties (decision 22).
const BRIDGED_SHARE: f64 = 0.1;

/// Lower triangle of a symmetric 6x6 matrix, row by row.
type Triangle = [f64; 21];

/// Information of some landmarks on a keyframe's pose.
#[derive(Clone)]
pub(super) struct Known {
    pub(super) count: usize,
    information: Triangle,
    chi2: f64,
    values: f64,
}

/// Contribution of one landmark.
struct Term {
    /// Squared residual, clamped to nine times its gate.
    chi2: f64,
    values: f64,
    /// Information of each measured value; `None` for an outlier.
    information: Option<[Triangle; 3]>,
}

impl Term {
    /// From a point in camera coordinates and its measurement.
    fn new(camera: &Intrinsics, p: &Vec3, m: &Measurement) -> Self {
        let chi2 = m.chi2(camera, p);
        let information = (chi2 <= m.gate()).then(|| {
            let weights = [m.pixel_weight, m.pixel_weight, m.inverse_depth_weight];
            let rows = linearise(camera, m, p).by_pose;
            std::array::from_fn(|k| weighted(&rows[k], weights[k]))
        });
        Self {
            chi2: chi2.min(9.0 * m.gate()),
            values: if m.has_depth() { 3.0 } else { 2.0 },
            information,
        }
    }
}

fn weighted(row: &[f64; 6], w: f64) -> Triangle {
    let mut out = [0.0; 21];
    let mut at = 0;
    for (r, a) in row.iter().enumerate() {
        for b in &row[..=r] {
            out[at] = a * b * w;
            at += 1;
        }
    }
    out
}

impl Known {
    const NOTHING: Self = Self {
        count: 0,
        information: [0.0; 21],
        chi2: 0.0,
        values: 0.0,
    };

    /// For a left perturbation of `camera_from_world`; inflated if the residuals are larger than stated.
    pub(super) fn covariance(&self) -> Option<Mat6> {
        let fit = (self.chi2 / self.values.max(1.0)).max(1.0);
        let at = |r: usize, c: usize| self.information[r * (r + 1) / 2 + c];
        let information = Mat6::from_fn(|r, c| at(r.max(c), r.min(c)));
        pose_covariance(&information).map(|c| c * fit)
    }

    pub(super) fn gather(
        camera: &Intrinsics,
        seen: impl Iterator<Item = (Vec3, Measurement)>,
    ) -> Self {
        let mut known = Self::NOTHING;
        for (p, m) in seen {
            known.add(&Term::new(camera, &p, &m));
        }
        known
    }

    fn add(&mut self, term: &Term) {
        self.chi2 += term.chi2;
        self.values += term.values;
        let Some(information) = &term.information else {
            return;
        };
        self.count += 1;
        add(&mut self.information, information);
    }
}

// Not inlined, so that the compiler knows that the arguments do not alias and vectorises the loop.
#[inline(never)]
fn add(sum: &mut Triangle, terms: &[Triangle; 3]) {
    for term in terms {
        for (s, t) in sum.iter_mut().zip(term) {
            *s += t;
        }
    }
}

/// Covariances of the motions `a_from_b` between nodes (a, b), for left perturbations, from shared landmarks.
pub(super) fn covariances(view: &MapView, nodes: &Nodes<'_>, pairs: &[(u32, u32)]) -> Vec<Mat6> {
    let mut of_node: Vec<Vec<(u32, usize)>> = vec![Vec::new(); nodes.keyframes.len()];
    for (i, (a, b)) in pairs.iter().enumerate() {
        of_node[*a as usize].push((i as u32, 0));
        of_node[*b as usize].push((i as u32, 1));
    }
    let mut known = vec![[Known::NOTHING; 2]; pairs.len()];
    let mut seen = LandmarkSet::default();
    for (k, pairs_of_it) in nodes.keyframes.iter().zip(&of_node) {
        let terms = terms(view, k);
        for (pair, end) in pairs_of_it {
            let (a, b) = pairs[*pair as usize];
            let other = nodes.keyframes[if *end == 0 { b } else { a } as usize];
            seen.clear();
            for id in other.matches.iter().flatten() {
                seen.insert(*id);
            }
            let sum = &mut known[*pair as usize][*end];
            let shared = terms.iter().filter(|(id, _)| seen.contains(*id));
            shared.for_each(|(_, term)| sum.add(term));
        }
    }
    let covariance = |((a, b), [of_a, of_b]): (&(u32, u32), &[Known; 2])| {
        let a_from_b = nodes.motion(*a, *b);
        let measured = (of_a.count.min(of_b.count) >= MIN_MEASURED)
            .then(|| Some((of_a.covariance()?, of_b.covariance()?)))
            .flatten();
        match measured {
            Some((of_a, of_b)) => between_neighbours(&of_a, &of_b, &a_from_b),
            None => bridged(&a_from_b),
        }
    };
    pairs.iter().zip(&known).map(covariance).collect()
}

/// Contribution of each landmark seen by a keyframe, in the order of features.
fn terms(view: &MapView, k: &Keyframe) -> Vec<(LandmarkId, Term)> {
    let camera_from_world = k.world_from_camera.inverse();
    let camera = Intrinsics::from(&k.data.camera);
    let term = |(feature, landmark): (usize, &Option<LandmarkId>)| {
        let id = (*landmark)?;
        let p = camera_from_world.transform(&view.landmark_position(id)?);
        let m = measurement_in(&k.data, feature, &k.data.camera);
        Some((id, Term::new(&camera, &p, &m)))
    };
    k.matches.iter().enumerate().filter_map(term).collect()
}

/// Covariance of errors that do not average out.
fn common(motion: &Se3, metres: f64, radians: f64, share: f64) -> Mat6 {
    let (length, angle) = (motion.translation.norm(), motion.rotation.angle());
    let (of_length, of_angle) = (share * length, share * angle);
    let t = metres * metres + of_length * of_length;
    let r = radians * radians + of_angle * of_angle;
    Mat6::from_diagonal(&Vec6::new(t, t, t, r, r, r))
}

/// Covariance of the motion between two keyframes, from the covariances of both poses given their shared landmarks.
fn between_neighbours(of_a: &Mat6, of_b: &Mat6, a_from_b: &Se3) -> Mat6 {
    of_a + moved(of_b, a_from_b) + common(a_from_b, TIE_M, TIE_RAD, TIE_SHARE)
}

/// Likewise with too few shared landmarks, when the frames between were bridged by flow.
fn bridged(a_from_b: &Se3) -> Mat6 {
    common(a_from_b, BRIDGED_M, BRIDGED_RAD, BRIDGED_SHARE)
}

/// Likewise of a measured loop, beside its own covariance.
pub(super) fn of_loop(old_from_new: &Se3) -> Mat6 {
    common(old_from_new, TIE_M, TIE_RAD, TIE_SHARE)
}
