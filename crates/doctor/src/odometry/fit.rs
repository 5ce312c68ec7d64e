//! Estimates the camera's mount on the base, and the difference of the clocks, from the motions of both.

use super::{LEAST, LONGEST_GAP_S, TELLING};
use stillpoint_geometry::nalgebra::{Quaternion, Rotation3, UnitQuaternion};
use stillpoint_geometry::{Mat3, Se3, Vec3, so3};
use stillpoint_imaging::OdometrySample;

/// Interval of compared motions, s.
const WINDOW_S: f64 = 0.3;
/// Maximum time shift tried, s.
const FARTHEST_S: f64 = 0.2;
const STEP_S: f64 = 0.01;

pub(super) struct Track(pub(super) Vec<(f64, Se3)>);

impl Track {
    pub(super) fn of_samples(samples: &[OdometrySample], offset: f64) -> Self {
        let mut poses: Vec<(f64, Se3)> = Vec::new();
        for s in samples.iter().filter(|s| s.is_pose()) {
            let [x, y, z, w] = s.orientation;
            let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
            let time = s.stamp + offset;
            if poses.last().is_none_or(|last| time > last.0) {
                poses.push((time, Se3::new(rotation, Vec3::from(s.position))));
            }
        }
        Self(poses)
    }

    fn at(&self, time: f64) -> Option<Se3> {
        let next = self.0.partition_point(|p| p.0 < time);
        let (from, a) = self.0.get(next.checked_sub(1)?)?;
        let (to, b) = self.0.get(next)?;
        let share = (time - from) / (to - from);
        let twist = (a.inverse() * *b).log();
        (to - from <= LONGEST_GAP_S).then(|| *a * Se3::exp(&(twist * share)))
    }
}

/// Motions of both over the same time, from later coordinates to earlier ones.
pub(super) struct Motion {
    pub(super) camera: Se3,
    pub(super) base: Se3,
}

/// Motions over windows that both cover, the base's stamps shifted by `shift`.
pub(super) fn motions(base: &Track, camera: &Track, shift: f64) -> Vec<Motion> {
    let poses = &camera.0;
    let one = |(i, (from, before)): (usize, &(f64, Se3))| {
        let (to, after) = poses[i..].iter().find(|p| p.0 - from >= WINDOW_S)?;
        (to - from < 2.0 * WINDOW_S).then_some(())?;
        let moved = base.at(from - shift)?.inverse() * base.at(to - shift)?;
        Some(Motion {
            camera: before.inverse() * *after,
            base: moved,
        })
    };
    poses.iter().enumerate().filter_map(one).collect()
}

/// Pairs of vectors that the mount turns into each other, the camera's first: all translations, then all rotations.
pub(super) fn vectors(motions: &[Motion], lever: &Vec3) -> Vec<(Vec3, Vec3)> {
    let way = |m: &Motion| {
        let swung = m.base.rotation * lever - lever;
        (m.camera.translation, m.base.translation + swung)
    };
    let turn = |m: &Motion| (so3::log(&m.camera.rotation), so3::log(&m.base.rotation));
    motions
        .iter()
        .map(way)
        .chain(motions.iter().map(turn))
        .collect()
}

/// Rotation of the mount, from the motions of both.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub(super) base_from_camera: UnitQuaternion<f64>,
    /// Its standard deviation about an axis, rad.
    pub(super) sigma: f64,
    /// The base's translations and rotations over the camera's; 0 if there are hardly any.
    pub(super) factors: [f64; 2],
    /// Fraction of the motions that the mount leaves unexplained.
    pub(super) left: f64,
    /// Correction to add to the base's stamps, s.
    pub(super) shift: f64,
}

/// The fit at the shift with the smallest residual; `None` if the motions do not determine it.
pub(super) fn best(base: &Track, camera: &Track, lever: &Vec3) -> Option<Fit> {
    let steps = (FARTHEST_S / STEP_S).round() as i32;
    let fit = |k: i32| {
        let shift = f64::from(k) * STEP_S;
        let fit = fit(&vectors(&motions(base, camera, shift), lever))?;
        Some(Fit { shift, ..fit })
    };
    let all: Vec<Fit> = (-steps..=steps).filter_map(fit).collect();
    let at = (0..all.len()).min_by(|a, b| all[*a].left.total_cmp(&all[*b].left))?;
    let mut best = all[at];
    if let (Some(before), Some(after)) = (at.checked_sub(1).map(|i| all[i]), all.get(at + 1)) {
        // The parabola through three squares.
        let [a, b, c] = [before.left, best.left, after.left].map(|l| l * l);
        let bend = a - 2.0 * b + c;
        if bend > 0.0 {
            best.shift += 0.5 * STEP_S * (a - c) / bend;
        }
    }
    Some(best)
}

fn fit(pairs: &[(Vec3, Vec3)]) -> Option<Fit> {
    if pairs.len() < 2 * LEAST {
        return None;
    }
    let (ways, turns) = pairs.split_at(pairs.len() / 2);
    let n = ways.len() as f64;
    let spread: Mat3 = pairs.iter().map(|p| p.0 * p.0.transpose()).sum();
    let mut sizes: Vec<f64> = spread
        .symmetric_eigenvalues()
        .iter()
        .map(|v| (v / n).max(0.0).sqrt())
        .collect();
    sizes.sort_by(f64::total_cmp);
    if sizes[1] < TELLING {
        return None;
    }
    let factors = [ways, turns].map(|part| {
        let sum = |f: &dyn Fn(&(Vec3, Vec3)) -> f64| part.iter().map(f).sum::<f64>();
        let camera = sum(&|p| p.0.norm_squared());
        let is_told = (camera / n).sqrt() >= TELLING;
        if is_told {
            (sum(&|p| p.1.norm_squared()) / camera).sqrt()
        } else {
            0.0
        }
    });
    // Scaled to the camera's, so that a wrong unit does not look like a wrong mount.
    let by = |factor: f64| if factor > 0.0 { 1.0 / factor } else { 1.0 };
    let way = ways.iter().map(|p| (p.0, p.1 * by(factors[0])));
    let turn = turns.iter().map(|p| (p.0, p.1 * by(factors[1])));
    let scaled: Vec<(Vec3, Vec3)> = way.chain(turn).collect();
    let (rotation, left) = kabsch(&scaled)?;
    let total: f64 = pairs.iter().map(|p| p.0.norm_squared()).sum();
    Some(Fit {
        base_from_camera: rotation,
        sigma: left * (total / n).sqrt() / (sizes[1] * n.sqrt()),
        factors,
        left,
        shift: 0.0,
    })
}

/// The rotation that brings the first of all pairs nearest to the second, and the residual fraction.
fn kabsch(pairs: &[(Vec3, Vec3)]) -> Option<(UnitQuaternion<f64>, f64)> {
    let cross: Mat3 = pairs.iter().map(|p| p.1 * p.0.transpose()).sum();
    let svd = cross.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let hand = (u * v_t).determinant().signum();
    let rotation = u * Mat3::from_diagonal(&Vec3::new(1.0, 1.0, hand)) * v_t;
    let left: f64 = pairs
        .iter()
        .map(|p| (p.1 - rotation * p.0).norm_squared())
        .sum();
    let total: f64 = pairs.iter().map(|p| p.0.norm_squared()).sum();
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    (total > 0.0).then(|| (rotation, (left / total).sqrt()))
}
