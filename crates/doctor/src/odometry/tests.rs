use super::*;
use stillpoint_geometry::nalgebra::UnitQuaternion;

/// A robot that drives curves, its camera swaying a little: `world_from_base`.
fn robot(t: f64) -> Se3 {
    let yaw = 0.5 * (1.7 * t).sin();
    let turn = so3::exp(&Vec3::new(0.0, 0.0, yaw));
    Se3::new(turn, Vec3::new(0.5 * t, 0.1 * (1.3 * t).sin(), 0.0))
}

fn straight(t: f64) -> Se3 {
    Se3::new(UnitQuaternion::identity(), Vec3::new(0.4 * t, 0.0, 0.0))
}

fn mount() -> Se3 {
    let left = so3::exp(&Vec3::new(0.0, 0.0, -std::f64::consts::FRAC_PI_2));
    let down = so3::exp(&Vec3::new(-std::f64::consts::FRAC_PI_2, 0.0, 0.0));
    Se3::new(left * down, Vec3::new(0.2, 0.05, 0.5))
}

fn sample(stamp: f64, pose: &Se3) -> OdometrySample {
    let q = pose.rotation;
    OdometrySample {
        stamp,
        position: pose.translation.into(),
        orientation: [q.i, q.j, q.k, q.w],
        sigmas: None,
    }
}

/// Odometry samples of a path, after a change of each pose; its stamps are `late`.
fn samples(
    way: fn(f64) -> Se3,
    change: impl Fn(u32, Se3) -> Se3,
    late: f64,
) -> Vec<OdometrySample> {
    let one = |k: u32| {
        let t = f64::from(k) / 50.0;
        sample(t + late, &change(k, way(t)))
    };
    (0..200).map(one).collect()
}

fn judged_on(way: fn(f64) -> Se3, samples: &[OdometrySample], stated: Se3) -> Report {
    let pose = |k: u32| {
        let t = f64::from(k) / 30.0;
        (t, way(t) * mount())
    };
    let poses: Vec<(f64, Se3)> = (3..110).map(pose).collect();
    let mut report = Report::default();
    judge_odometry(
        samples,
        &poses,
        &OdometryModel::mounted(stated),
        &mut report,
    );
    report
}

fn same(_: u32, pose: Se3) -> Se3 {
    pose
}

/// The mount with the camera turned to its left by some degrees.
fn turned(degrees: f64) -> Se3 {
    let turn = so3::exp(&Vec3::new(0.0, 0.0, degrees.to_radians()));
    Se3::new(turn * mount().rotation, mount().translation)
}

#[test]
fn correctly_described_odometry_has_no_findings() {
    for way in [robot, straight] {
        let report = judged_on(way, &samples(way, same, 0.0), mount());
        assert!(report.findings.is_empty(), "{report}");
    }
    let curves = judged_on(robot, &samples(robot, same, 0.0), mount());
    assert!(
        curves.not_judged.is_empty() && curves.measured.len() == 6,
        "{curves}"
    );
}

#[test]
fn odometry_faults_are_reported_with_correct_values() {
    let q = mount().rotation.coords;
    let rotation = format!(
        "rotation = [{:.4}, {:.4}, {:.4}, {:.4}]",
        q.x, q.y, q.z, q.w
    );
    let scaled = |_: u32, p: Se3| Se3::new(p.rotation, p.translation * 2.0);
    let jumping = |k: u32, p: Se3| {
        let aside = if k == 77 { 0.5 } else { 0.0 };
        Se3::new(p.rotation, p.translation + Vec3::new(0.0, aside, 0.0))
    };
    let still = |_: u32, _: Se3| Se3::identity();
    for (samples, stated, parts) in [
        (
            samples(robot, same, 0.0),
            turned(90.0),
            ["90 degrees otherwise", rotation.as_str()],
        ),
        (
            samples(robot, same, 0.0),
            turned(-10.0),
            ["10 degrees otherwise", rotation.as_str()],
        ),
        (
            samples(robot, same, 0.08),
            mount(),
            ["-80 ms off", "time_offset = -0.080"],
        ),
        (
            samples(robot, scaled, 0.0),
            Se3::new(mount().rotation, 2.0 * mount().translation),
            ["by a factor", "metres"],
        ),
        (
            samples(robot, jumping, 0.0),
            mount(),
            ["jumps", "corrections"],
        ),
        (
            samples(robot, still, 0.0),
            mount(),
            ["stands still", "--no-odometry"],
        ),
    ] {
        let report = judged_on(robot, &samples, stated);
        let said = report.to_string();
        assert!(
            report.names(Symptom::Odometry) && report.findings.len() == 1,
            "{report}"
        );
        assert!(parts.iter().all(|p| said.contains(p)), "{parts:?}: {said}");
    }
    // Reversed rotations: the path bends the other way too.
    let odd = |t: f64| {
        let p = robot(t);
        let mirrored = Vec3::new(p.translation.x, -p.translation.y, 0.0);
        Se3::new(p.rotation.inverse(), mirrored)
    };
    let said = judged_on(robot, &samples(odd, same, 0.0), mount()).to_string();
    assert!(
        said.contains("exchange the left wheel and the right one"),
        "{said}"
    );
}

#[test]
fn straight_motion_checks_the_camera_direction() {
    let said = judged_on(straight, &samples(straight, same, 0.0), turned(90.0)).to_string();
    assert!(said.contains("goes 90 degrees beside"), "{said}");
    let still = judged_on(|_| Se3::identity(), &samples(straight, same, 0.0), mount());
    assert!(
        still.findings.is_empty() && !still.not_judged.is_empty(),
        "{still}"
    );
    let nothing = judged_on(robot, &[], mount());
    assert!(
        nothing.findings.is_empty() && !nothing.not_judged.is_empty(),
        "{nothing}"
    );
}
