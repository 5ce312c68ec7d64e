//! Checks wheel odometry of the camera's base: whether it moves with the camera, the camera's mount on the base, and its clock.
//!
//! Motions of the camera over a few frames are compared with those of the base: `X A = B X`, where X is the mount. X turns rotation and
//! translation vectors alike, so its rotation is that of Kabsch (Acta Cryst. A32, 1976) over both, at the time shift with the smallest
//! residual; the camera's position on the base is taken as stated.

mod fit;

use crate::finding::{Figure, Finding, Report, Symptom};
use fit::{Fit, Motion, Track, best, motions, vectors};
use stillpoint_geometry::{OdometryModel, Se3, Vec3, so3};
use stillpoint_imaging::OdometrySample;

/// Maximum time between samples, s; over longer gaps the base's motion is unknown.
const LONGEST_GAP_S: f64 = 0.35;
/// Minimum number of compared motions.
const LEAST: usize = 20;
/// Minimum motion along or about an axis that determines the mount, m or rad per window, root mean square.
const TELLING: f64 = 0.01;
/// Maximum error of a mount, rad: 6 degrees.
const OFF: f64 = 0.105;
/// If a mount is off by more than this, the rotations may have the wrong sign instead, rad.
const UPSIDE_DOWN: f64 = 2.6;
/// Maximum error of a clock, s.
const LATE_S: f64 = 0.04;
/// Maximum residual of the motions, as a fraction, if the base moves with the camera, whatever the mount.
const ALIKE: f64 = 0.5;
/// Translations and rotations outside this factor and its inverse are wrong.
const FACTOR: f64 = 1.25;
/// A base that moves by less than this fraction of the camera's motion stands still.
const IDLE: f64 = 0.02;
/// Maximum change of a base's velocity between steps, m/s^2 and rad/s^2; encoder noise added to it, m and rad; and the multiple of both
/// that is a jump.
const ACCELERATION: [f64; 2] = [10.0, 30.0];
const ENCODER: [f64; 2] = [0.01, 0.01];
const JUMP: f64 = 4.0;

/// Judges odometry by its samples and the camera's poses (stamps, s, and `world_from_camera`), both in order of time.
pub fn judge_odometry(
    samples: &[OdometrySample],
    poses: &[(f64, Se3)],
    stated: &OdometryModel,
    report: &mut Report,
) {
    let base = Track::of_samples(samples, stated.time_offset);
    let camera = Track(poses.to_vec());
    if judge_jumps(&base, report) || judge_standing(&base, &camera, report) {
        return;
    }
    let lever = stated.base_from_camera.translation;
    let Some(best) = best(&base, &camera, &lever) else {
        judge_direction(&base, &camera, stated, report);
        return;
    };
    let left = Figure::new(
        "odometry: motions that no mount explains, as a share",
        best.left,
        "",
    );
    report.measure(left.clone());
    if best.left > ALIKE {
        let remedy = "check translation in the table [odometry] of the camera file, that both have stamps of one clock, and whether the wheels slip";
        let what = "odometry moves otherwise than the camera, however that is mounted";
        find(report, what, remedy, vec![left]);
        return;
    }
    for (name, factor, what, remedy) in [
        (
            "odometry: its ways against the camera's",
            best.factors[0],
            "odometry's ways are too long or too short by a factor",
            "look up the wheels' size and the unit: metres are expected",
        ),
        (
            "odometry: its turns against the camera's",
            best.factors[1],
            "odometry's turns are too large or too small by a factor",
            "look up the distance between the wheels",
        ),
    ] {
        // Too little motion gives no factor.
        if factor > 0.0 {
            let figure = Figure::new(name, factor, "");
            report.measure(figure.clone());
            if factor.ln().abs() > FACTOR.ln() {
                find(report, what, remedy, vec![figure]);
            }
        }
    }
    judge_mount(&best, stated, report);
}

fn judge_mount(best: &Fit, stated: &OdometryModel, report: &mut Report) {
    let off = best
        .base_from_camera
        .angle_to(&stated.base_from_camera.rotation);
    let figure = Figure::new(
        "odometry: the camera is mounted otherwise than stated by",
        off.to_degrees(),
        "deg",
    )
    .with_sigma(best.sigma.to_degrees());
    report.measure(figure.clone());
    if off > OFF.max(4.0 * best.sigma) {
        let q = best.base_from_camera.coords;
        let what = format!(
            "the camera stands {:.0} degrees otherwise on the base of the odometry than stated",
            off.to_degrees()
        );
        // On a floor, reversed rotations look like a camera that hangs upside down.
        let other_way = if off > UPSIDE_DOWN {
            "; or, if it does not hang upside down, exchange the left wheel and the right one: the base turns to the other side"
        } else {
            ""
        };
        let remedy = format!(
            "state rotation = [{:.4}, {:.4}, {:.4}, {:.4}] in the table [odometry] of the camera file{other_way}",
            q.x, q.y, q.z, q.w
        );
        find(report, &what, &remedy, vec![figure]);
    }
    let figure = Figure::new("odometry: its clock is behind by", 1e3 * best.shift, "ms");
    report.measure(figure.clone());
    if best.shift.abs() > LATE_S {
        let what = format!(
            "odometry's stamps are {:.0} ms off the camera's",
            1e3 * best.shift
        );
        let remedy = format!(
            "state time_offset = {:.3} in the table [odometry] of the camera file",
            stated.time_offset + best.shift
        );
        find(report, &what, &remedy, vec![figure]);
    }
}

fn judge_jumps(base: &Track, report: &mut Report) -> bool {
    let step = |pair: &[(f64, Se3)]| {
        let (from, to) = (pair[0].1, pair[1].1);
        let turn = so3::log(&(from.rotation.inverse() * to.rotation));
        (
            pair[1].0 - pair[0].0,
            [to.translation - from.translation, turn],
        )
    };
    let steps: Vec<(f64, [Vec3; 2])> = base.0.windows(2).map(step).collect();
    let is_jump = |pair: &&[(f64, [Vec3; 2])]| {
        let ((before, a), (dt, b)) = (&pair[0], &pair[1]);
        *dt < LONGEST_GAP_S
            && (0..2).any(|k| {
                let change = (b[k] - a[k] * (dt / before)).norm();
                change > JUMP * (ENCODER[k] + ACCELERATION[k] * dt * dt)
            })
    };
    let jumps = steps.windows(2).filter(is_jump).count();
    // Away and back, or away and on: a jump is two changes.
    let figure = Figure::new("odometry: jumps", (jumps as f64 / 2.0).ceil(), "");
    report.measure(figure.clone());
    if jumps > 0 {
        find(
            report,
            "odometry jumps as no base does",
            "name a topic that goes on without corrections (odom, and not what a map or a satellite corrects); look for a frame of reference that was set anew",
            vec![figure],
        );
    }
    jumps > 0
}

/// Whether the base stands still while the camera moves, or nothing moves, which is reported.
fn judge_standing(base: &Track, camera: &Track, report: &mut Report) -> bool {
    let motions = motions(base, camera, 0.0);
    if motions.len() < LEAST {
        report.pass_over(
            "odometry: too few of its samples are of times in which the camera has a pose",
        );
        return true;
    }
    let size = |of: &dyn Fn(&Motion) -> Se3| -> f64 {
        let one = |m: &Motion| {
            let moved = of(m);
            moved.translation.norm_squared() + so3::log(&moved.rotation).norm_squared()
        };
        (motions.iter().map(one).sum::<f64>() / motions.len() as f64).sqrt()
    };
    let (of_base, of_camera) = (size(&|m| m.base), size(&|m| m.camera));
    if of_camera < TELLING {
        report.pass_over("odometry: the camera moves too little");
        return true;
    }
    if of_base >= IDLE * of_camera {
        return false;
    }
    let share = Figure::new(
        "odometry: its motion as a share of the camera's",
        of_base / of_camera,
        "",
    );
    report.measure(share.clone());
    find(
        report,
        "odometry stands still while the camera moves",
        "check that the encoders are connected and that the topic is of the base that moves; run with --no-odometry until then",
        vec![share],
    );
    true
}

/// For motions along one axis: compares the camera's direction with that of the odometry.
fn judge_direction(base: &Track, camera: &Track, stated: &OdometryModel, report: &mut Report) {
    let mount = stated.base_from_camera;
    let pairs = vectors(&motions(base, camera, 0.0), &mount.translation);
    let turned = |v: &Vec3| mount.rotation.inverse() * v;
    let along: f64 = pairs.iter().map(|(c, b)| c.dot(&turned(b))).sum();
    let size = |of: &dyn Fn(&(Vec3, Vec3)) -> f64| pairs.iter().map(of).sum::<f64>().sqrt();
    let sizes = size(&|p| p.0.norm_squared()) * size(&|p| p.1.norm_squared());
    if sizes <= 0.0 {
        report.pass_over("odometry: the camera moves too little");
        return;
    }
    let off = (along / sizes).clamp(-1.0, 1.0).acos();
    let figure = Figure::new(
        "odometry: the camera goes beside where it says by",
        off.to_degrees(),
        "deg",
    );
    report.measure(figure.clone());
    report.pass_over("how the camera stands on the base of the odometry: all motions are about or along one axis");
    if off > 2.0 * OFF {
        let what = format!(
            "the camera goes {:.0} degrees beside where the odometry says",
            off.to_degrees()
        );
        find(
            report,
            &what,
            "check rotation in the table [odometry] of the camera file; seconds with a turn tell what to state",
            vec![figure],
        );
    }
}

fn find(report: &mut Report, message: &str, remedy: &str, evidence: Vec<Figure>) {
    report.find(Finding {
        symptom: Symptom::Odometry,
        message: message.to_owned(),
        remedy: remedy.to_owned(),
        evidence,
    });
}

#[cfg(test)]
mod tests;
