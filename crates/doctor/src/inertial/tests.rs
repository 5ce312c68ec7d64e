use super::*;
use stillpoint_geometry::Se3;

fn camera(t: f64) -> UnitQuaternion<f64> {
    so3::exp(&Vec3::new(0.0, 0.35 * (2.1 * t).sin(), 0.0))
        * so3::exp(&Vec3::new(0.25 * (1.3 * t).sin(), 0.0, 0.0))
        * so3::exp(&Vec3::new(0.0, 0.0, 0.2 * (1.7 * t).cos()))
}

fn mount() -> UnitQuaternion<f64> {
    so3::exp(&Vec3::new(0.5, -0.3, 0.9))
}

/// Samples of a sensor whose axes are turned by `to_sensor` against the camera's, and whose stamps are `late`.
fn samples(to_sensor: &Mat3, scale: f64, force: f64, late: f64) -> Vec<ImuSample> {
    let sample = |k: u32| {
        let (t, h) = (f64::from(k) / 200.0, 1e-4);
        let rate = so3::log(&(camera(t - h).inverse() * camera(t + h))) / (2.0 * h);
        let bias = Vec3::new(0.01, -0.02, 0.015);
        ImuSample {
            stamp: t + late,
            angular_rate: ((to_sensor * rate + bias) * scale).into(),
            specific_force: [0.0, -force, 0.0],
        }
    };
    (0..800).map(sample).collect()
}

fn poses() -> Vec<(f64, UnitQuaternion<f64>)> {
    let pose = |k: u32| (f64::from(k) / 30.0, camera(f64::from(k) / 30.0));
    (3..110).map(pose).collect()
}

fn to_sensor() -> Mat3 {
    mount().inverse().to_rotation_matrix().into_inner()
}

fn stated(rotation: UnitQuaternion<f64>) -> ImuModel {
    ImuModel::bmi055().mounted(Se3::new(rotation, Vec3::zeros()))
}

fn judged(samples: &[ImuSample], stated: &ImuModel) -> Report {
    let mut report = Report::default();
    judge_inertial(samples, &poses(), stated, &mut report);
    report
}

#[test]
fn correctly_described_inertial_sensor_has_no_findings() {
    let report = judged(&samples(&to_sensor(), 1.0, 9.8, 0.0), &stated(mount()));
    assert!(report.findings.is_empty(), "{report}");
    assert!(
        report.not_judged.is_empty() && report.measured.len() == 5,
        "{report}"
    );
}

#[test]
fn inertial_faults_are_reported_with_correct_values() {
    let right = stated(mount());
    let mirror = Mat3::from_diagonal(&Vec3::new(1.0, -1.0, 1.0));
    let q = mount().coords;
    let rotation = format!("rotation = [{:.4}, {:.4}", q.x, q.y);
    for (samples, stated, parts) in [
        (
            samples(&to_sensor(), 1.0, 9.8, 0.0),
            stated(UnitQuaternion::identity()),
            ["mounted", rotation.as_str()],
        ),
        (
            samples(&to_sensor(), 1.0, 9.8, 0.04),
            right,
            ["40 ms off", "time_offset = -0.040"],
        ),
        (
            samples(&to_sensor(), 1.0_f64.to_degrees(), 9.8, 0.0),
            right,
            ["degrees per second", "57.3"],
        ),
        (
            samples(&to_sensor(), 1.0, 1.0, 0.0),
            right,
            ["specific forces", "9.80665"],
        ),
        (
            samples(&(mirror * to_sensor()), 1.0, 9.8, 0.0),
            right,
            ["however it is mounted", "mirrored"],
        ),
    ] {
        let report = judged(&samples, &stated);
        assert_eq!(report.findings.len(), 1, "{parts:?}: {report}");
        assert!(report.names(Symptom::InertialSensor));
        let said = report.to_string();
        assert!(parts.iter().all(|p| said.contains(p)), "{parts:?}: {said}");
    }
}

#[test]
fn unrelated_inertial_data_is_reported() {
    let mut other = samples(&to_sensor(), 1.0, 9.8, 0.0);
    other.reverse();
    let stamps: Vec<f64> = other.iter().rev().map(|s| s.stamp).collect();
    other.iter_mut().zip(stamps).for_each(|(s, t)| {
        s.stamp = t;
        s.angular_rate[1] *= -1.0;
    });
    let report = judged(&other, &stated(mount()));
    assert!(
        report.to_string().contains("however it is mounted"),
        "{report}"
    );
}

#[test]
fn static_camera_gives_no_inertial_findings() {
    let samples = samples(&to_sensor(), 1.0, 9.8, 0.0);
    let mut report = Report::default();
    let still: Vec<_> = poses().iter().map(|p| (p.0, camera(0.0))).collect();
    judge_inertial(&samples, &still, &stated(mount()), &mut report);
    assert!(report.findings.is_empty() && report.not_judged[0].contains("turns too little"));
    judge_inertial(&[], &poses(), &stated(mount()), &mut report);
    assert!(report.findings.is_empty());
}
