//! Camera pose from three points and their viewing directions.

use crate::linear::{adjugate, cubic_roots, determinant_cubic, quadratic_roots};
use stillpoint_geometry::{Mat3, Se3, Vec3};

/// All poses `camera_from_world` (up to four) in which a camera sees three world points (m) in three directions (camera
/// coordinates, any length). Empty if the points are collinear, directions coincide or no pose exists.
///
/// With depths l_i along unit directions b_i, the law of cosines gives three quadrics `l^T M_ij l = |p_i - p_j|^2`. Two
/// combinations D1, D2 of them have no constant; a root of `det(D1 + g D2)` makes their pencil a pair of planes
/// (Persson, Nordberg, "Lambda Twist", ECCV 2018, section 3.1), which are separated as a degenerate conic (Ding et al.,
/// "Revisiting the P3P problem", CVPR 2023), intersected with the other quadric, and the depths refined by
/// Gauss-Newton.
#[must_use]
pub fn p3p(points: [Vec3; 3], bearings: [Vec3; 3]) -> Vec<Se3> {
    let mut poses = Vec::with_capacity(4);
    p3p_into(points, bearings, &mut poses);
    poses
}

/// Appends the poses of [`p3p`] to the empty list `poses`.
pub(crate) fn p3p_into(points: [Vec3; 3], bearings: [Vec3; 3], poses: &mut Vec<Se3>) {
    let Some(problem) = Problem::new(&points, &bearings) else {
        return;
    };
    for plane in problem.planes().into_iter().flatten() {
        for depths in problem.cut(&plane).into_iter().flatten() {
            let Some(l) = problem.refine(depths) else {
                continue;
            };
            let seen = [0, 1, 2].map(|i| problem.bearings[i] * l[i]);
            if let Some(pose) = align_triangles(&points, &seen)
                && !poses.iter().any(|p| same(p, &pose))
                && poses.len() < 4
            {
                poses.push(pose);
            }
        }
    }
}

/// Equal up to rounding: a double root appears twice.
fn same(a: &Se3, b: &Se3) -> bool {
    let size = 1.0 + a.translation.norm();
    (a.translation - b.translation).norm() < 1e-9 * size
        && a.rotation.coords.dot(&b.rotation.coords).abs() > 1.0 - 1e-15
}

struct Problem {
    bearings: [Vec3; 3],
    /// Cosines between directions 12, 13, 23.
    cos: [f64; 3],
    /// Squared distances 12, 13, 23, scaled so that the largest is one.
    squared: [f64; 3],
    /// The distance that was scaled to one, m.
    unit: f64,
    d1: Mat3,
    d2: Mat3,
}

impl Problem {
    fn new(points: &[Vec3; 3], bearings: &[Vec3; 3]) -> Option<Self> {
        let b = bearings.map(|v| v / v.norm());
        let cos = [b[0].dot(&b[1]), b[0].dot(&b[2]), b[1].dot(&b[2])];
        let sides = [
            points[0] - points[1],
            points[0] - points[2],
            points[1] - points[2],
        ];
        let squared = sides.map(|s| s.norm_squared());
        let largest = squared[0].max(squared[1]).max(squared[2]);
        let area = sides[0].cross(&sides[1]).norm();
        let flat = b[0].dot(&b[1].cross(&b[2])).is_nan();
        if flat || !(area > 1e-9 * largest && area.is_finite()) {
            return None;
        }
        let [a12, a13, a23] = squared.map(|s| s / largest);
        let [c12, c13, c23] = cos;
        let m12 = Mat3::new(1.0, -c12, 0.0, -c12, 1.0, 0.0, 0.0, 0.0, 0.0);
        let m13 = Mat3::new(1.0, 0.0, -c13, 0.0, 0.0, 0.0, -c13, 0.0, 1.0);
        let m23 = Mat3::new(0.0, 0.0, 0.0, 0.0, 1.0, -c23, 0.0, -c23, 1.0);
        Some(Self {
            bearings: b,
            cos,
            squared: [a12, a13, a23],
            unit: largest.sqrt(),
            d1: m12 * a23 - m23 * a12,
            d2: m13 * a23 - m23 * a13,
        })
    }

    /// The two planes `n^T l = 0` of the most clearly degenerate member of the pencil, and the quadric to intersect
    /// them with.
    fn planes(&self) -> [Option<(Vec3, Mat3)>; 2] {
        let mut best: Option<(f64, Mat3, Mat3)> = None;
        for g in cubic_roots(determinant_cubic(&self.d2, &self.d1)).as_slice() {
            let d0 = self.d1 + self.d2 * *g;
            let size = d0.norm_squared();
            let adj = adjugate(&d0);
            // Real planes have a negative trace of the adjugate; of several pairs the one farthest from a double plane.
            let depth = -adj.trace() / size;
            if best.as_ref().is_none_or(|b| depth > b.0) {
                let other = if g.abs() * self.d2.norm() <= self.d1.norm() {
                    self.d2
                } else {
                    self.d1
                };
                best = Some((depth, d0, other));
            }
        }
        let Some((depth, d0, other)) = best else {
            return [None, None];
        };
        if depth.is_nan() || depth <= 0.0 {
            return [None, None];
        }
        let adj = adjugate(&d0);
        let i = (0..3).fold(0, |i, k| if adj[(k, k)] < adj[(i, i)] { k } else { i });
        let beta = (-adj[(i, i)]).sqrt();
        let p = adj.column(i) / beta;
        // D0 + [p]x has rank one: its largest row is one plane, its largest column the other.
        let c = d0 + stillpoint_geometry::so3::hat(&p);
        let at = c.iamax_full();
        let (row, column) = (c.row(at.0).transpose(), c.column(at.1).into_owned());
        [Some((row, other)), Some((column, other))]
    }

    /// Intersection of a plane through the origin with a quadric: up to two rays of positive depths, scaled to the
    /// distances.
    fn cut(&self, (normal, quadric): &(Vec3, Mat3)) -> [Option<Vec3>; 2] {
        let n = normal / normal.norm();
        if n.iter().any(|v| !v.is_finite()) {
            return [None, None];
        }
        let axis = n.iamin();
        let mut e = Vec3::zeros();
        e[axis] = 1.0;
        let u = n.cross(&e).normalize();
        let v = n.cross(&u);
        let q = [
            u.dot(&(quadric * u)),
            2.0 * u.dot(&(quadric * v)),
            v.dot(&(quadric * v)),
        ];
        // l = u + t v, or v + t u if that keeps t small.
        let swap = q[2].abs() < q[0].abs();
        let (c, first, second) = if swap {
            ([q[2], q[1], q[0]], v, u)
        } else {
            (q, u, v)
        };
        let mut found = [None, None];
        for (f, t) in found.iter_mut().zip(quadratic_roots(c).as_slice()) {
            *f = self.scaled(first + second * *t);
        }
        found
    }

    /// The multiple of `l` with the right distances; `None` if depths differ in sign.
    fn scaled(&self, l: Vec3) -> Option<Vec3> {
        let form = |i: usize, k: usize, c: f64| l[i] * l[i] + l[k] * l[k] - 2.0 * c * l[i] * l[k];
        let [c12, c13, c23] = self.cos;
        let sum = form(0, 1, c12) + form(0, 2, c13) + form(1, 2, c23);
        let target = self.squared[0] + self.squared[1] + self.squared[2];
        let scale = (target / sum).sqrt().copysign(l.sum());
        let l = l * scale;
        l.iter().all(|v| *v > 0.0 && v.is_finite()).then_some(l)
    }

    /// Gauss-Newton on the three laws of cosines; returns depths in m, or `None` if there is no solution.
    fn refine(&self, mut l: Vec3) -> Option<Vec3> {
        const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
        let residual = |l: &Vec3| {
            Vec3::from_fn(|row, _| {
                let (i, k) = PAIRS[row];
                l[i] * l[i] + l[k] * l[k] - 2.0 * self.cos[row] * l[i] * l[k] - self.squared[row]
            })
        };
        let mut r = residual(&l);
        for _ in 0..6 {
            let mut j = Mat3::zeros();
            for (row, (i, k)) in PAIRS.into_iter().enumerate() {
                j[(row, i)] = 2.0 * (l[i] - self.cos[row] * l[k]);
                j[(row, k)] = 2.0 * (l[k] - self.cos[row] * l[i]);
            }
            let next = l - adjugate(&j) * r / j.determinant();
            let s = residual(&next);
            let (new, old) = (s.amax(), r.amax());
            if new.is_nan() || new >= old {
                break;
            }
            (l, r) = (next, s);
            if new < 1e-15 {
                break;
            }
        }
        let met = r.amax() < 1e-6 * (1.0 + l.amax() * l.amax());
        (met && l.iter().all(|v| *v > 0.0)).then(|| l * self.unit)
    }
}

/// The motion `target_from_source` between two triangles of equal sides, from their plane, first side and centroid.
/// `None` if one is degenerate.
pub(crate) fn align_triangles(source: &[Vec3; 3], target: &[Vec3; 3]) -> Option<Se3> {
    let frame = |p: &[Vec3; 3]| {
        let (a, b) = (p[1] - p[0], p[2] - p[0]);
        let n = a.cross(&b);
        let (x, z) = (a / a.norm(), n / n.norm());
        Mat3::from_columns(&[x, z.cross(&x), z])
    };
    let rotation = frame(target) * frame(source).transpose();
    let mean = |p: &[Vec3; 3]| (p[0] + p[1] + p[2]) / 3.0;
    let translation = mean(target) - rotation * mean(source);
    let pose = Se3::from_matrix(&rotation, translation);
    pose.is_finite().then_some(pose)
}
