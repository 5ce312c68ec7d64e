use super::*;

const DT: f64 = 1.0 / 30.0;

fn camera() -> Camera {
    Camera::pinhole(640, 480, [520.0, 520.0, 319.5, 239.5])
}

/// Pose and velocity of a camera with changing rotation about an axis.
struct Path {
    /// Twist per second at time 0, and its change per second.
    velocity: Vec6,
    change: Vec6,
}

impl Path {
    /// Motion from the camera at time 0: exact if velocity and change have the same axis.
    fn camera_from_start(&self, t: f64) -> Se3 {
        Se3::exp(&(self.velocity * t + self.change * (0.5 * t * t)))
    }

    fn velocity(&self, t: f64) -> Vec6 {
        self.velocity + self.change * t
    }

    /// Pixel and row at which a point (m, camera at time 0) is exposed in the frame stamped `stamp`.
    fn exposed(&self, p: &Vec3, stamp: f64, readout: f64) -> (Vec2, f64) {
        let camera = camera();
        let mut late = 0.0;
        let mut pixel = Vec2::zeros();
        for _ in 0..20 {
            let seen = self.camera_from_start(stamp + late).transform(p);
            pixel = camera.project(&seen);
            late = Shutter::row_share(&camera, pixel.y) * readout;
        }
        (pixel, pixel.y)
    }

    /// Exact static points in the frame before and at stamp `t`.
    fn between(&self, t: f64, readout: f64) -> Between {
        let stamps = [t - DT, t];
        let mut pairs = Vec::new();
        for i in 0..300 {
            let at = |k: u32, from: f64, to: f64| {
                let unit = f64::from((i * k + 7) % 101) / 101.0;
                from + (to - from) * unit
            };
            let p = Vec3::new(at(37, -1.2, 1.2), at(59, -0.9, 0.9), at(83, 1.5, 3.5));
            let [before, now] = stamps.map(|t| self.exposed(&p, t, readout));
            let late = Shutter::row_share(&camera(), now.1) * readout;
            let z = self.camera_from_start(t + late).transform(&p).z;
            pairs.push(RowPair {
                now,
                before,
                z,
                sigma: 0.5,
            });
        }
        let [before, now] = stamps.map(|t| self.camera_from_start(t));
        Between {
            before_from_now: before * now.inverse(),
            seconds: DT,
            pairs,
        }
    }
}

/// Oscillating yaw, as of a head: up to 2 rad/s, with 1.5 Hz.
fn swinging(t: f64) -> Path {
    let w = 3.0 * std::f64::consts::PI;
    Path {
        velocity: Vec6::new(0.0, 0.0, 0.0, 0.0, 2.0 * libm::sin(w * t), 0.0),
        change: Vec6::new(0.0, 0.0, 0.0, 0.0, 2.0 * w * libm::cos(w * t), 0.0),
    }
}

fn start(readout: f64) -> SelfCalibration {
    SelfCalibration::new(Timing {
        readout,
        readout_sigma: 0.02,
        depth_delay: 0.0,
    })
}

/// Passes as many frames as are needed to learn once.
fn pass(
    estimate: &mut SelfCalibration,
    path: &Path,
    readout: f64,
    mut change: impl FnMut(&mut Between),
) {
    for k in 0..RUN {
        let mut between = path.between(DT * (k as f64 - 2.0), readout);
        change(&mut between);
        estimate.learn(&camera(), Some(between));
    }
    estimate.learn(&camera(), None);
}

fn learn_swinging(truth: f64, from: f64) -> SelfCalibration {
    let mut estimate = start(from);
    for i in 0..30 {
        // Each start time has its own local path.
        pass(&mut estimate, &swinging(0.07 * f64::from(i)), truth, |_| ());
    }
    estimate
}

#[test]
fn readout_converges_from_any_initial_value() {
    for truth in [0.0, 0.01, 0.03] {
        for from in [0.0, 0.02, 0.05] {
            let estimate = learn_swinging(truth, from);
            let off = estimate.timing().readout - truth;
            assert!(off.abs() < 0.001, "{truth} from {from}: off by {off} s");
            assert!(estimate.timing().readout_sigma < 0.001 + 0.1 * truth);
        }
    }
}

/// Velocities are wrong while it is undecided which surfaces move, and with them the readout.
#[test]
fn wrong_estimate_is_corrected_by_new_data() {
    let mut estimate = start(0.0);
    let mut passes = |truth: f64, times: u32| {
        for i in 0..times {
            pass(&mut estimate, &swinging(0.07 * f64::from(i)), truth, |_| ());
        }
        *estimate.timing()
    };
    let wrong = passes(0.01, 30);
    assert!((wrong.readout - 0.01).abs() < 0.001, "{wrong:?}");
    let corrected = passes(0.02, 15);
    assert!((corrected.readout - 0.02).abs() < 0.001, "{corrected:?}");
}

/// A prior known to ten microseconds hardly moves.
#[test]
fn strong_prior_is_kept() {
    let mut estimate = SelfCalibration::new(Timing {
        readout: 0.02,
        readout_sigma: 1e-5,
        depth_delay: 0.0,
    });
    for i in 0..30 {
        pass(&mut estimate, &swinging(0.07 * f64::from(i)), 0.01, |_| ());
    }
    let readout = estimate.timing().readout;
    assert!((readout - 0.02).abs() < 0.0005, "{readout}");
}

#[test]
fn steady_rotation_gives_little_information() {
    let path = Path {
        velocity: Vec6::new(0.0, 0.0, 0.0, 0.0, 2.0, 0.0),
        change: Vec6::zeros(),
    };
    let mut estimate = start(0.02);
    for _ in 0..30 {
        pass(&mut estimate, &path, 0.02, |_| ());
    }
    let swinging = learn_swinging(0.02, 0.0);
    let share = estimate.information / swinging.information;
    assert!(share < 0.04, "{share}");
}

#[test]
fn static_camera_or_few_points_give_no_information() {
    let still = Path {
        velocity: Vec6::repeat(0.01),
        change: Vec6::zeros(),
    };
    let mut estimate = start(0.0);
    pass(&mut estimate, &still, 0.02, |_| ());
    pass(&mut estimate, &swinging(0.1), 0.02, |b| {
        b.pairs.truncate(MIN_PAIRS - 1)
    });
    // Nor does a sequence with a gap.
    for k in 0..3 * RUN {
        let between = swinging(0.1).between(DT, 0.02);
        estimate.learn(&camera(), (k % RUN != 0).then_some(between));
    }
    assert_eq!(*estimate.timing(), *start(0.0).timing());
    pass(&mut estimate, &swinging(0.1), 0.02, |_| ());
    assert_ne!(*estimate.timing(), *start(0.0).timing());
}

/// A third of the points move, or are mismatched.
#[test]
fn estimate_is_robust_to_outliers() {
    let mut estimate = start(0.0);
    for i in 0..30 {
        let path = swinging(0.07 * f64::from(i));
        pass(&mut estimate, &path, 0.02, |between| {
            for (k, pair) in between.pairs.iter_mut().enumerate().step_by(3) {
                pair.before.0 += Vec2::new(8.0 + (k % 7) as f64, (k % 5) as f64 - 12.0);
            }
        });
    }
    let readout = estimate.timing().readout;
    assert!((readout - 0.02).abs() < 0.002, "{readout}");
}

/// Independent pose errors of centimetres and half a degree, as among people; static points still give the motion
/// between two frames.
#[test]
fn estimate_is_robust_to_pose_jitter() {
    let mut estimate = start(0.0);
    for i in 0..30 {
        let path = swinging(0.07 * f64::from(i));
        let mut k = 17 * i;
        pass(&mut estimate, &path, 0.02, |between| {
            let off = [
                (0, 0.02),
                (1, 0.02),
                (2, 0.02),
                (3, 0.01),
                (4, 0.01),
                (5, 0.01),
            ];
            let off = off.map(|(axis, most)| {
                k += 1;
                most * (f64::from((37 * k + 11 * axis) % 101) / 50.0 - 1.0)
            });
            between.before_from_now = Se3::exp(&Vec6::from(off)) * between.before_from_now;
        });
    }
    let timing = estimate.timing();
    assert!((timing.readout - 0.02).abs() < 0.001, "{timing:?}");
    // The information is nearly that of exact poses.
    let exact = learn_swinging(0.02, 0.0).information;
    assert!(estimate.information > 0.5 * exact, "{timing:?}");
}

#[test]
fn derivatives_match_finite_differences() {
    let path = swinging(0.2);
    let between = path.between(DT, 0.02);
    let velocities = [&path.velocity(0.0), &path.velocity(DT)];
    let pose = Se3::exp(&Vec6::new(0.01, -0.02, 0.01, 0.004, 0.01, -0.006));
    let from = pose * between.before_from_now;
    let (readout, h) = (0.013, 1e-6);
    for pair in &between.pairs[..40] {
        let at = |from: &Se3, r: f64| Row::new(&camera(), pair, from, velocities, r).unwrap();
        let row = at(&from, readout);
        for k in 0..2 {
            let by_readout = (at(&from, readout + h).residual[k]
                - at(&from, readout - h).residual[k])
                / (2.0 * h);
            let off = (by_readout - row.by_readout[k]).abs();
            assert!(
                off < 1e-3 * (1.0 + by_readout.abs()),
                "{by_readout}: off by {off}"
            );
            for i in 0..6 {
                let mut d = Vec6::zeros();
                d[i] = h;
                let moved = |d: Vec6| at(&(Se3::exp(&d) * from), readout).residual[k];
                let by_motion = (moved(d) - moved(-d)) / (2.0 * h);
                let off = (by_motion + row.by_motion[k][i]).abs();
                assert!(off < 1e-3 * (1.0 + by_motion.abs()), "{i}: off by {off}");
            }
        }
    }
}

#[test]
fn mirrored_time_negates_the_readout() {
    let estimate = learn_swinging(0.02, 0.0);
    let mirrored = estimate.mirrored();
    assert_eq!(mirrored.timing().readout, -estimate.timing().readout);
    assert_eq!(
        mirrored.timing().readout_sigma,
        estimate.timing().readout_sigma
    );
}

#[test]
fn cubic_velocity_is_interpolated_exactly() {
    let at = |t: f64| 1.0 + 2.0 * t - 30.0 * t * t + 400.0 * t * t * t;
    let path = |t: f64| t + t * t - 10.0 * t * t * t + 100.0 * t * t * t * t;
    let stamps = [-0.13, -0.08, -0.035, 0.0, 0.027, 0.1, 0.12];
    let intervals = [0, 1, 2, 3, 4, 5].map(|i| {
        let (from, to) = (stamps[i], stamps[i + 1]);
        let mean = (path(to) - path(from)) / (to - from);
        (Vec6::repeat(mean), to - from)
    });
    let both = [
        velocity_between::<4>(&intervals),
        velocity_between::<6>(&intervals),
    ];
    for found in both.map(Option::unwrap) {
        assert!((found - Vec6::repeat(at(0.0))).norm() < 1e-8, "{found}");
    }
    assert!(velocity_between::<4>(&[(Vec6::zeros(), 0.0); 6]).is_none());
}
