//! Wheel odometry of the base that carries the camera: whether it moves as the camera does, how the camera stands on the base, and its clock.
//!
//! Motions of the camera over a few frames are compared with those of the base meanwhile: `X A = B X`, where X is the mount. Turns and ways are vectors that X turns alike, so its
//! rotation is that of Kabsch (Acta Cryst. A32, 1976) over both, at the time shift that leaves least; where the camera is on the base is taken as stated.

mod fit;

use crate::finding::{Figure, Finding, Report, Symptom};
use fit::{Fit, Motion, Track, best, motions, vectors};
use stillpoint_geometry::{OdometryModel, Se3, Vec3, so3};
use stillpoint_imaging::OdometrySample;

/// Samples that are farther apart leave open how the base moved between them, s.
const LONGEST_GAP_S: f64 = 0.35;
/// Motions that are compared, at least.
const LEAST: usize = 20;
/// Motions of this size along or about an axis tell, m or rad per window, root mean square.
const TELLING: f64 = 0.01;
/// A mount is off from here on, rad: 6 degrees.
const OFF: f64 = 0.105;
/// If a mount is off by more than this, the turns may have the wrong sign instead, rad.
const UPSIDE_DOWN: f64 = 2.6;
/// A clock is reported when it is off by more than this, s.
const LATE_S: f64 = 0.04;
/// What is left of the motions, as a share, where the base moves as the camera does, however that is mounted.
const ALIKE: f64 = 0.5;
/// Ways and turns are off by a factor beyond this and its inverse.
const FACTOR: f64 = 1.25;
/// A base that moves by less than this share of the camera's motion stands still.
const IDLE: f64 = 0.02;
/// From step to step a base changes its velocity by so much at most, m/s^2 and rad/s^2, and encoders add so much, m and rad; a jump is so many times more.
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
        // What hardly moved so has no factor.
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
        // On a floor, turns to the other side look like a camera that hangs upside down.
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

/// Whether it jumps as no base does, which is said.
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

/// Whether the base stands still while the camera moves, or nothing moves, which is said.
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

/// Where all motions are along one axis: whether the camera goes where the odometry says.
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
