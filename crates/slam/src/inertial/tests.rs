#![allow(clippy::unwrap_used)] // A failed helper is a failed test.
use super::*;
use stillpoint_geometry::{Se3, so3};

/// Deterministic noise between -1 and 1 for value `k`.
fn noise(k: u32, axis: u32) -> f64 {
    let mut z = u64::from(7 * k + axis)
        .wrapping_add(1)
        .wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z ^= z >> 27;
    (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Pose of a camera that pans and tilts.
fn camera(t: f64) -> UnitQuaternion<f64> {
    so3::exp(&Vec3::new(0.0, 0.6 * libm::sin(2.0 * t), 0.0))
        * so3::exp(&Vec3::new(0.3 * libm::sin(1.3 * t), 0.0, 0.0))
}

/// Samples of a sensor mounted like this at 200 Hz, with a bias and noise of the BMI055's size.
fn samples(mount: &UnitQuaternion<f64>, bias: Vec3, seconds: f64) -> Vec<ImuSample> {
    let sample = |k: u32| {
        let (t, h) = (f64::from(k) / 200.0, 1e-4);
        let turn = camera(t - h).inverse() * camera(t + h);
        let rate = mount.inverse() * (so3::log(&turn) / (2.0 * h));
        let force = mount.inverse() * (camera(t).inverse() * Vec3::new(0.0, -9.8, 0.0));
        let noise = |axis| 0.006 * noise(k, axis);
        ImuSample {
            stamp: t,
            angular_rate: (rate + bias + Vec3::new(noise(0), noise(1), noise(2))).into(),
            specific_force: force.into(),
        }
    };
    (0..=(200.0 * seconds) as u32).map(sample).collect()
}

/// A sensor that learns from exact camera poses, frame by frame.
fn after(model: ImuModel, samples: &[ImuSample], seconds: f64) -> Inertial {
    let mut inertial = Inertial::new(model);
    let mut given = 0;
    for frame in 0..(30.0 * seconds) as u32 {
        let time = f64::from(frame) / 30.0;
        let end = samples.partition_point(|s| s.stamp < time) + 1;
        let end = end.min(samples.len());
        inertial.receive(&samples[given..end]);
        given = end;
        inertial.learn(time, &camera(time), true);
    }
    inertial
}

fn mount() -> UnitQuaternion<f64> {
    so3::exp(&Vec3::new(0.7, -1.1, 0.4))
}

fn mounted() -> ImuModel {
    ImuModel::bmi055().mounted(Se3::new(mount(), Vec3::zeros()))
}

#[test]
fn tracked_rotations_find_bias_and_confirm_the_sensor() {
    let bias = Vec3::new(0.012, -0.02, 0.015);
    let samples = samples(&mount(), bias, 6.0);
    let before = after(mounted(), &samples, 0.4);
    assert_eq!(before.report().state, InertialState::Unconfirmed);
    let known = after(mounted(), &samples, 6.0);
    let report = known.report();
    assert_eq!(report.state, InertialState::Confirmed);
    let found = Vec3::from(report.gyro_bias);
    assert!((found - bias).norm() < 0.003, "{found}");
    assert!(report.gyro_bias_sigma < 0.003);
    // Up is the direction of the specific force.
    let up = Vec3::from(report.up.unwrap());
    assert!((up - Vec3::new(0.0, -1.0, 0.0)).norm() < 0.01, "{up}");
}

#[test]
fn small_mount_and_time_offset_errors_are_estimated() {
    let samples = samples(&mount(), Vec3::new(0.012, -0.02, 0.015), 20.0);
    let turned = mounted().turned(Vec3::new(0.02, -0.015, 0.01));
    // The configured offset is 8 ms too late.
    let stated = ImuModel {
        time_offset: 0.008,
        ..turned
    };
    let found = after(stated, &samples, 20.0).report();
    assert_eq!(found.state, InertialState::Confirmed);
    let off = found.camera_from_imu.angle_to(&mount());
    assert!(off < 0.004, "{off}");
    assert!((found.mount_error - 0.027).abs() < 0.004 && found.mount_sigma < 0.005);
    assert!(found.time_offset.abs() < 0.001, "{}", found.time_offset);
    assert!(found.time_offset_sigma < 0.001);
    // Correct values stay.
    let right = after(mounted(), &samples, 20.0).report();
    assert!(right.mount_error < 0.003 && right.time_offset.abs() < 0.0005);
}

#[test]
fn rotation_errors_are_within_the_stated_sigma() {
    let samples = samples(&mount(), Vec3::new(0.012, -0.02, 0.015), 6.0);
    for seconds in [1.0, 5.5] {
        let inertial = after(mounted(), &samples, seconds);
        let (from, to) = (seconds - 0.4, seconds - 0.1);
        let turn = inertial.turn(from, to).unwrap();
        let truth = camera(to).inverse() * camera(from);
        let off = turn.later_from_earlier.angle_to(&truth);
        assert!(
            off < 3.0 * 3.0_f64.sqrt() * turn.sigma && turn.sigma < 0.01,
            "{off} {}",
            turn.sigma
        );
    }
}

#[test]
fn mirrored_time_inverts_the_rotation() {
    let samples = samples(&mount(), Vec3::new(0.012, -0.02, 0.015), 3.0);
    let inertial = after(mounted(), &samples, 3.0);
    let (pivot, from, to) = (2.9, 2.0, 2.5);
    let back = inertial.mirrored(pivot);
    let turn = back.turn(2.0 * pivot - to, 2.0 * pivot - from).unwrap();
    let there = inertial.turn(from, to).unwrap();
    let closed = turn.later_from_earlier * there.later_from_earlier;
    assert!(closed.angle() < 1e-6, "{}", closed.angle());
    let [a, b] = [back.rate(2.0 * pivot - to), inertial.rate(to)];
    assert!((a.unwrap() + b.unwrap()).norm() < 1e-9);
}

#[test]
fn sensor_with_a_wrong_mount_or_clock_is_ignored() {
    let samples = samples(&mount(), Vec3::zeros(), 4.0);
    let turned = mounted().turned(Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
    let wrong = after(turned, &samples, 4.0);
    let state = wrong.report().state;
    assert_eq!(state, InertialState::Ignored(SensorFault::Contradicts));
    assert!(wrong.turn(3.0, 3.1).is_none() && wrong.rate(3.0).is_none());
    assert!(wrong.report().up.is_none() && state.to_string().contains("camera_from_imu"));
    // Likewise with a clock that is half a second off.
    let late = ImuModel {
        time_offset: 0.5,
        ..mounted()
    };
    let late = after(late, &samples, 4.0);
    assert_eq!(
        late.report().state,
        InertialState::Ignored(SensorFault::Contradicts)
    );
}

#[test]
fn stuck_sensor_is_ignored_until_recovery() {
    let good = samples(&mount(), Vec3::zeros(), 6.0);
    let mut stuck = good.clone();
    for s in &mut stuck {
        if (2.0..3.0).contains(&s.stamp) {
            (s.angular_rate, s.specific_force) = (good[400].angular_rate, good[400].specific_force);
        }
    }
    let then = after(mounted(), &stuck, 2.8);
    assert_eq!(
        then.report().state,
        InertialState::Ignored(SensorFault::Constant)
    );
    assert!(then.turn(2.6, 2.7).is_none());
    assert_eq!(
        after(mounted(), &stuck, 6.0).report().state,
        InertialState::Confirmed
    );
}

#[test]
fn rest_determines_the_gyroscope_bias() {
    let bias = Vec3::new(0.01, 0.015, -0.02);
    let model = ImuModel::bmi055();
    let mut inertial = Inertial::new(model);
    for k in 0..300 {
        let noise = |axis| 0.006 * noise(k, axis);
        inertial.receive(&[ImuSample {
            stamp: f64::from(k) / 200.0,
            angular_rate: (bias + Vec3::new(noise(0), noise(1), noise(2))).into(),
            specific_force: [0.0, -9.8 + noise(3), 0.0],
        }]);
    }
    let report = inertial.report();
    assert!((Vec3::from(report.gyro_bias) - bias).norm() < 0.002);
    assert!(report.gyro_bias_sigma < 0.002);
}

#[test]
fn invalid_and_late_samples_are_dropped() {
    let mut inertial = Inertial::new(ImuModel::bmi055());
    let at = |stamp: f64, x: f64| ImuSample {
        stamp,
        angular_rate: [x, 0.0, 0.0],
        ..ImuSample::default()
    };
    inertial.receive(&[
        at(0.0, 1.0),
        at(0.005, f64::NAN),
        at(0.01, 1.0),
        at(0.004, 9.0),
        at(0.02, 1.0),
    ]);
    let turn = inertial.turn(0.0, 0.02).unwrap();
    assert!((turn.later_from_earlier.angle() - 0.02).abs() < 1e-9);
    // After the clock was set no samples remain.
    inertial.forget_times();
    assert!(inertial.turn(0.0, 0.02).is_none());
}
