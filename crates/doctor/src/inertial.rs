//! Checks the inertial sensor: its axes, units and clock.
//!
//! Rotations of the camera over a few frames are compared with the integrated gyroscope rates. The rotation between both axes is that of
//! Kabsch (Acta Cryst. A32, 1976), at the time shift with the smallest residual.

use crate::finding::{Figure, Finding, Report, Symptom};
use stillpoint_geometry::nalgebra::{Rotation3, UnitQuaternion};
use stillpoint_geometry::{ImuModel, Mat3, STANDARD_GRAVITY, Vec3, so3};
use stillpoint_imaging::ImuSample;

/// Interval of compared rotations, s: long enough for a visible rotation, short enough for it to be about one axis.
const WINDOW_S: f64 = 0.15;
/// Minimum number of compared rotations.
const LEAST: usize = 30;
/// Minimum rotation about two axes that determines the mount, rad per window, root mean square.
const TELLING: f64 = 0.006;
/// Maximum time shift tried, s.
const FARTHEST_S: f64 = 0.2;
const STEP_S: f64 = 0.005;
/// Maximum error of a mount, rad: 5 degrees. Smaller errors are estimated and corrected in every run.
const OFF: f64 = 0.087;
/// Maximum error of a clock, s: poses are of the middle of a readout, which is not known here.
const LATE_S: f64 = 0.025;
/// Maximum residual of the rotations, as a fraction, if the sensor turns with the camera, whatever the mount.
const ALIKE: f64 = 0.5;
/// Rates and forces outside this factor and its inverse are wrong.
const FACTOR: f64 = 1.3;

/// Judges an inertial sensor by its samples and the camera's poses (stamps, s, and `world_from_camera`), both in order of time.
pub fn judge_inertial(
    samples: &[ImuSample],
    poses: &[(f64, UnitQuaternion<f64>)],
    stated: &ImuModel,
    report: &mut Report,
) {
    judge_force(samples, report);
    let sums = Sums::new(samples, stated.time_offset);
    let Some(best) = sums.best(poses) else {
        report.pass_over(
            "the inertial sensor's axes: the camera turns too little, or about one axis only",
        );
        return;
    };
    let factor = best.factor;
    let figure = Figure::new("gyroscope: its turns against the camera's", factor, "");
    report.measure(figure.clone());
    let left = Figure::new(
        "inertial sensor: turns that no mount explains, as a share",
        best.left,
        "",
    );
    report.measure(left.clone());
    if best.is_mirrored || best.left > ALIKE {
        find(
            report,
            "the inertial sensor turns otherwise than the camera, however it is mounted".to_owned(),
            if best.is_mirrored {
                "one of its axes is mirrored: exchange two axes, or change the sign of one"
            } else {
                "check that it is on the same body as the camera, and that both have stamps of one clock"
            }
            .to_owned(),
            vec![left],
        );
        return;
    }
    let units = if (factor.to_radians().ln()).abs() < FACTOR.ln() {
        Some((
            "angular rates are in degrees per second",
            "divide them by 57.3: rad/s are expected",
        ))
    } else if factor.ln().abs() > FACTOR.ln() {
        Some((
            "angular rates are too large or too small by a factor",
            "look up the gyroscope's unit: rad/s are expected",
        ))
    } else {
        None
    };
    if let Some((what, remedy)) = units {
        find(report, what.to_owned(), remedy.to_owned(), vec![figure]);
        return;
    }
    judge_mount(&best, stated, report);
}

fn judge_mount(best: &Fit, stated: &ImuModel, report: &mut Report) {
    let off = best
        .camera_from_imu
        .angle_to(&stated.camera_from_imu.rotation);
    let figure = Figure::new(
        "inertial sensor: mounted otherwise than stated by",
        off.to_degrees(),
        "deg",
    )
    .with_sigma(best.sigma.to_degrees());
    report.measure(figure.clone());
    if off > OFF.max(4.0 * best.sigma) {
        let q = best.camera_from_imu.coords;
        find(
            report,
            format!(
                "the inertial sensor is mounted {:.0} degrees otherwise than stated",
                off.to_degrees()
            ),
            format!(
                "state rotation = [{:.4}, {:.4}, {:.4}, {:.4}] in the table [imu] of the camera file",
                q.x, q.y, q.z, q.w
            ),
            vec![figure],
        );
    }
    let figure = Figure::new(
        "inertial sensor: its clock is behind by",
        1e3 * best.shift,
        "ms",
    );
    report.measure(figure.clone());
    if best.shift.abs() > LATE_S {
        find(
            report,
            format!(
                "the inertial sensor's stamps are {:.0} ms off the camera's",
                1e3 * best.shift
            ),
            format!(
                "state time_offset = {:.3} in the table [imu] of the camera file",
                stated.time_offset + best.shift
            ),
            vec![figure],
        );
    }
}

/// The mean specific force is gravity, up to a hand's accelerations.
fn judge_force(samples: &[ImuSample], report: &mut Report) {
    let mut sizes: Vec<f64> = samples
        .iter()
        .map(|s| Vec3::from(s.specific_force).norm())
        .filter(|f| *f > 0.0)
        .collect();
    if sizes.is_empty() {
        report.pass_over("the accelerometer: it measured nothing");
        return;
    }
    sizes.sort_by(f64::total_cmp);
    let middle = sizes[sizes.len() / 2];
    let figure = Figure::new("accelerometer: specific force", middle, "m/s^2");
    report.measure(figure.clone());
    let factor = middle / STANDARD_GRAVITY;
    let remedy = if (factor * STANDARD_GRAVITY).ln().abs() < FACTOR.ln() {
        "multiply by 9.80665: they are in units of gravity"
    } else if factor.ln().abs() > FACTOR.ln() {
        "look up the accelerometer's unit; it measures what carries it, gravity included"
    } else {
        return;
    };
    let message = "specific forces are not those of a sensor on earth, in m/s^2".to_owned();
    find(report, message, remedy.to_owned(), vec![figure]);
}

fn find(report: &mut Report, message: String, remedy: String, evidence: Vec<Figure>) {
    report.find(Finding {
        symptom: Symptom::InertialSensor,
        message,
        remedy,
        evidence,
    });
}

/// Rotation between sensor and camera, from the rotations of both.
#[derive(Clone, Copy, Debug)]
struct Fit {
    camera_from_imu: UnitQuaternion<f64>,
    /// Its standard deviation about an axis, rad.
    sigma: f64,
    /// The sensor's rotations over the camera's.
    factor: f64,
    /// Fraction of the rotations that the mount leaves unexplained.
    left: f64,
    /// Whether a mirror image would explain them.
    is_mirrored: bool,
    /// Correction to add to its stamps, s.
    shift: f64,
}

/// Rates integrated from the first sample on.
struct Sums {
    times: Vec<f64>,
    sums: Vec<Vec3>,
}

impl Sums {
    fn new(samples: &[ImuSample], offset: f64) -> Self {
        let (mut times, mut sums): (Vec<f64>, Vec<Vec3>) = (Vec::new(), Vec::new());
        let mut last = Vec3::zeros();
        for sample in samples.iter().filter(|s| s.is_finite()) {
            let (time, rate) = (sample.stamp + offset, Vec3::from(sample.angular_rate));
            let next = match (times.last(), sums.last()) {
                (Some(before), Some(sum)) if time > *before => {
                    sum + (rate + last) * (0.5 * (time - before))
                }
                (None, None) => Vec3::zeros(),
                _ => continue,
            };
            times.push(time);
            sums.push(next);
            last = rate;
        }
        Self { times, sums }
    }

    fn at(&self, time: f64) -> Option<Vec3> {
        let next = self.times.partition_point(|t| *t < time);
        let before = next.checked_sub(1)?;
        let (a, b) = (*self.times.get(before)?, *self.times.get(next)?);
        let share = (time - a) / (b - a);
        Some(self.sums[before] + (self.sums[next] - self.sums[before]) * share)
    }

    /// Rotations of camera and sensor over windows that both cover, the sensor's stamps shifted by `shift`.
    fn turns(&self, poses: &[(f64, UnitQuaternion<f64>)], shift: f64) -> Vec<(Vec3, Vec3)> {
        let turn = |(i, (from, before)): (usize, &(f64, UnitQuaternion<f64>))| {
            let later = poses[i..].iter().find(|p| p.0 - from >= WINDOW_S)?;
            let (to, after) = later;
            (to - from < 2.0 * WINDOW_S).then_some(())?;
            let sensor = self.at(to - shift)? - self.at(from - shift)?;
            Some((so3::log(&(before.inverse() * after)), sensor))
        };
        poses.iter().enumerate().filter_map(turn).collect()
    }

    /// The fit at the shift with the smallest residual; `None` if the rotations do not determine it.
    fn best(&self, poses: &[(f64, UnitQuaternion<f64>)]) -> Option<Fit> {
        let steps = (FARTHEST_S / STEP_S).round() as i32;
        let fit = |shift: f64| {
            let fit = fit(&self.turns(poses, shift))?;
            Some(Fit { shift, ..fit })
        };
        let all: Vec<Fit> = (-steps..=steps)
            .filter_map(|k| fit(f64::from(k) * STEP_S))
            .collect();
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
}

/// The rotation between the axes of both, from their rotations less the mean: a bias of the gyroscope is the same in all.
fn fit(turns: &[(Vec3, Vec3)]) -> Option<Fit> {
    if turns.len() < LEAST {
        return None;
    }
    let n = turns.len() as f64;
    let mean = turns.iter().fold((Vec3::zeros(), Vec3::zeros()), |m, t| {
        (m.0 + t.0 / n, m.1 + t.1 / n)
    });
    let centred: Vec<(Vec3, Vec3)> = turns.iter().map(|t| (t.0 - mean.0, t.1 - mean.1)).collect();
    let sum = |f: &dyn Fn(&(Vec3, Vec3)) -> f64| centred.iter().map(f).sum::<f64>();
    let (camera, sensor) = (sum(&|t| t.0.norm_squared()), sum(&|t| t.1.norm_squared()));
    let spread: Mat3 = centred.iter().map(|t| t.0 * t.0.transpose()).sum();
    let mut sizes: Vec<f64> = spread
        .symmetric_eigenvalues()
        .iter()
        .map(|v| (v / n).max(0.0).sqrt())
        .collect();
    sizes.sort_by(f64::total_cmp);
    if sizes[1] < TELLING || sensor <= 0.0 {
        return None;
    }
    let factor = (sensor / camera).sqrt();
    let cross: Mat3 = centred.iter().map(|t| t.0 * t.1.transpose() / factor).sum();
    let svd = cross.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let hand = (u * v_t).determinant().signum();
    let rotation = u * Mat3::from_diagonal(&Vec3::new(1.0, 1.0, hand)) * v_t;
    let left_by = |m: &Mat3| {
        let left = sum(&|t| (t.0 - m * t.1 / factor).norm_squared());
        (left / camera).sqrt()
    };
    let left = left_by(&rotation);
    let camera_from_imu =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Some(Fit {
        camera_from_imu,
        sigma: left * (camera / n).sqrt() / (sizes[1] * n.sqrt()),
        factor,
        left,
        is_mirrored: hand < 0.0 && left_by(&(u * v_t)) < 0.5 * left,
        shift: 0.0,
    })
}

#[cfg(test)]
mod tests;
