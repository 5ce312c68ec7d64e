#![allow(clippy::unwrap_used)] // A failed helper is a failed test.
use super::*;
use stillpoint_geometry::Vec3;

/// Pose of a camera that moves back and forth on a curve.
fn camera(t: f64) -> Se3 {
    let turn = so3::exp(&Vec3::new(0.0, 0.5 * libm::sin(1.1 * t), 0.0));
    Se3::new(
        turn,
        Vec3::new(0.4 * libm::sin(1.7 * t), 0.0, 0.6 * libm::sin(t)),
    )
}

fn mounted() -> OdometryModel {
    let mount = so3::exp(&Vec3::new(0.7, -1.1, 0.4));
    OdometryModel::mounted(Se3::new(mount, Vec3::new(0.3, -0.1, 0.5)))
}

fn sample(stamp: f64, odom_from_base: &Se3) -> OdometrySample {
    let q = odom_from_base.rotation;
    OdometrySample {
        stamp,
        position: odom_from_base.translation.into(),
        orientation: [q.i, q.j, q.k, q.w],
        sigmas: None,
    }
}

/// Exact odometry at 50 Hz of a base that is at `path(t)` on its trajectory at time t.
fn samples(path: impl Fn(f64) -> f64, seconds: f64) -> Vec<OdometrySample> {
    let camera_from_base = mounted().base_from_camera.inverse();
    let at = |k: u32| {
        let t = f64::from(k) / 50.0;
        sample(t, &(camera(path(t)) * camera_from_base))
    };
    (0..=(50.0 * seconds) as u32).map(at).collect()
}

/// Odometry that learns from exact camera poses, frame by frame.
fn after(model: OdometryModel, samples: &[OdometrySample], seconds: f64) -> Odometry {
    let mut odometry = Odometry::new(model);
    let mut given = 0;
    for frame in 0..(30.0 * seconds) as u32 {
        let time = f64::from(frame) / 30.0;
        let end = samples.partition_point(|s| s.stamp < time) + 1;
        let end = end.min(samples.len());
        odometry.receive(&samples[given..end]);
        given = end;
        odometry.learn(time, &camera(time), true);
    }
    odometry
}

#[test]
fn motion_is_in_the_camera_frame_with_its_sigma() {
    let samples = samples(|t| t, 3.0);
    let odometry = after(mounted(), &samples, 3.0);
    assert_eq!(odometry.report().state, OdometryState::Confirmed);
    assert_eq!(odometry.report().samples, samples.len() as u64 - 1);
    let mut before = 0.0;
    for (from, to) in [(1.01, 1.04), (1.01, 1.5), (0.5, 2.93)] {
        let motion = odometry.motion(from, to).unwrap();
        let exact = camera(to).inverse() * camera(from);
        let off = exact * motion.later_from_earlier.inverse();
        assert!(off.translation.norm() < 2.0 * motion.sigma_m, "{from} {to}");
        assert!(off.rotation.angle() < 2.0 * motion.sigma_rad);
        assert!(motion.sigma_m > before && motion.sigma_m < 0.1);
        before = motion.sigma_m;
    }
    // Stated deviations count where they are larger.
    let unsure: Vec<OdometrySample> = samples
        .iter()
        .map(|s| OdometrySample {
            sigmas: Some([0.2 * s.stamp, 0.0]),
            ..*s
        })
        .collect();
    let odometry = after(mounted(), &unsure, 3.0);
    let motion = odometry.motion(0.5, 2.5).unwrap();
    assert!(motion.sigma_m > 0.4, "{}", motion.sigma_m);
}

#[test]
fn mirrored_time_inverts_the_motion() {
    let odometry = after(mounted(), &samples(|t| t, 3.0), 3.0);
    let back = odometry.mirrored(3.0);
    let there = odometry.motion(1.0, 1.5).unwrap().later_from_earlier;
    let again = back.motion(4.5, 5.0).unwrap().later_from_earlier;
    assert!((there * again).log().norm() < 1e-9);
}

#[test]
fn faulty_odometry_is_detected() {
    let right = samples(|t| t, 4.0);
    let quarter = Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let turned = after(mounted().turned(quarter), &right, 4.0);
    let ignored = OdometryState::Ignored(OdometryFault::Contradicts);
    assert_eq!(turned.report().state, ignored);
    assert!(turned.motion(3.0, 3.1).is_none());
    let stuck = after(mounted(), &samples(|_| 1.0, 4.0), 4.0);
    let ignored = OdometryState::Ignored(OdometryFault::Stuck);
    assert_eq!(stuck.report().state, ignored);
    let mut wild = right.clone();
    for (k, s) in wild.iter_mut().enumerate() {
        s.position[0] += if k % 2 == 0 { 0.3 } else { 0.0 };
    }
    let wild = after(mounted(), &wild, 4.0);
    let ignored = OdometryState::Ignored(OdometryFault::Noisy);
    assert_eq!(wild.report().state, ignored);
}

#[test]
fn odometry_is_trusted_again_after_slip() {
    let mut odometry = after(mounted(), &samples(|t| t.max(3.0), 9.0), 9.0);
    assert_eq!(odometry.report().state, OdometryState::Confirmed);
    // After slip, odometry is ignored for that time and a while after.
    odometry.note_slip(8.0);
    assert!(odometry.motion(7.9, 8.1).is_none() && odometry.motion(8.1, 8.3).is_none());
    assert!(odometry.motion(8.1, 8.6).is_some() && odometry.motion(7.0, 7.5).is_some());
    odometry.note_slip(8.2);
    assert_eq!(odometry.report().slips, 1);
    odometry.note_slip(9.0);
    assert_eq!(odometry.report().slips, 2);
}

#[test]
fn invalid_and_late_samples_are_dropped() {
    let mut odometry = Odometry::new(mounted());
    let at = |stamp: f64| sample(stamp, &Se3::identity());
    let mut broken = at(0.02);
    broken.orientation = [0.0; 4];
    odometry.receive(&[at(0.0), broken, at(0.04), at(0.03), at(0.05)]);
    assert_eq!(odometry.report().samples, 3);
    odometry.forget_times();
    odometry.receive(&[at(-5.0)]);
    assert_eq!(odometry.report().samples, 4);
}
