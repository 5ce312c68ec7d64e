use super::*;
use stillpoint_estimation::{Purpose, Rng, rng};

/// A camera on a path, tracked by position measurements.
struct Followed {
    momentum: Momentum,
    at: Vec3,
    /// Standard deviations of the measurements, m.
    noise: [f64; 3],
}

/// Standard deviations of a measurement, m: at rest, and in a fast turn, where x is hardly observable.
const CALM: [f64; 3] = [0.003; 3];
const TURN: [f64; 3] = [0.02, 0.003, 0.003];
const DT: f64 = 1.0 / 30.0;

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit()).sum::<f64>() - 6.0
}

impl Followed {
    fn new(noise: [f64; 3]) -> Self {
        Self {
            momentum: Momentum::default(),
            at: Vec3::zeros(),
            noise,
        }
    }

    /// A noisy measurement of a position.
    fn seen(&self, place: &Vec3, random: &mut Rng) -> Vec3 {
        place + Vec3::from(self.noise.map(|s| s * normal(random)))
    }

    fn measure(&mut self, place: &Vec3, learns: bool) {
        let expected = self.momentum.expect(DT);
        let weight = Mat3::from_diagonal(&Vec3::from(self.noise.map(|s| 1.0 / (s * s))));
        let known = expected.place().try_inverse().unwrap();
        let covariance = (known + weight).try_inverse().unwrap();
        let before = self.at + expected.shift;
        let off = covariance * (weight * (place - before));
        self.at = before + off;
        let acceleration = self.momentum.acceleration;
        self.momentum = expected.found(&off, Some(covariance));
        if !learns {
            self.momentum.acceleration = acceleration;
        }
    }

    /// Tracks a path for `frames` frames. Returns the sum of squared errors of the estimates and of the measurements
    /// along x, m^2, over the second half.
    fn follow(
        &mut self,
        path: impl Fn(f64) -> Vec3,
        frames: u32,
        learns: bool,
        random: &mut Rng,
    ) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for k in 1..=frames {
            let truth = path(f64::from(k) * DT);
            let measured = self.seen(&truth, random);
            self.measure(&measured, learns);
            if k > frames / 2 {
                let errors = [self.at.x - truth.x, measured.x - truth.x];
                for (sum, e) in sums.iter_mut().zip(errors) {
                    *sum += e * e;
                }
            }
        }
        sums
    }
}

/// Hand-held motion: half a metre per second back and forth, with up to 1.2 m/s^2.
fn by_hand(t: f64) -> Vec3 {
    Vec3::new(0.2 * libm::sin(2.4 * t), 0.1 * libm::sin(1.7 * t), 0.0)
}

/// Jolting motion: up to 9 m/s^2 along x.
fn jolting(t: f64) -> Vec3 {
    Vec3::new(0.03 * libm::sin(17.0 * t), 0.0, 0.0)
}

fn random(seed: u64) -> Rng {
    rng(seed, 0, Purpose::CAMERA_MOTION)
}

#[test]
fn momentum_improves_poorly_measured_positions() {
    let (mut sums, mut learnt) = ([0.0; 2], 0.0);
    for seed in 0..50 {
        let mut camera = Followed::new(TURN);
        let errors = camera.follow(by_hand, 120, true, &mut random(seed));
        sums = [0, 1].map(|k| sums[k] + errors[k]);
        learnt += camera.momentum.acceleration / 50.0;
    }
    assert!(learnt < 1.5 * ACCELERATION, "{learnt} m/s^2");
    let [held, measured] = sums.map(libm::sqrt);
    assert!(held < 0.7 * measured, "{held} of {measured}");
}

#[test]
fn acceleration_estimate_adapts_to_jolts_and_recovers() {
    let (mut sums, mut learnt, mut rested) = ([0.0; 3], 0.0, 0.0);
    for seed in 0..50 {
        let mut camera = Followed::new(CALM);
        let [held, measured] = camera.follow(jolting, 90, true, &mut random(seed));
        learnt += camera.momentum.acceleration / 50.0;
        // Control: without learning the estimate lags behind.
        let mut other = Followed::new(CALM);
        let [lags, _] = other.follow(jolting, 90, false, &mut random(seed));
        assert_eq!(other.momentum.acceleration, ACCELERATION);
        sums = [sums[0] + held, sums[1] + measured, sums[2] + lags];
        let end = camera.at;
        camera.follow(|_| end, 90, true, &mut random(seed));
        rested += camera.momentum.acceleration / 50.0;
    }
    assert!(learnt > 2.0 * ACCELERATION, "{learnt} m/s^2");
    assert!(rested < 1.3 * ACCELERATION, "{rested} m/s^2");
    let [held, measured, lags] = sums.map(libm::sqrt);
    assert!(held < 1.2 * measured, "{held} of {measured}");
    assert!(lags > 1.5 * held, "{lags} against {held}");
}

#[test]
fn errors_match_the_stated_covariance() {
    let (mut sum, mut count) = (0.0, 0);
    for seed in 0..200 {
        let random = &mut random(seed);
        let mut velocity = Vec3::from_fn(|_, _| SPEED * normal(random));
        let (mut truth, mut camera) = (Vec3::zeros(), Followed::new(TURN));
        for _ in 0..30 {
            let a = Vec3::from_fn(|_, _| ACCELERATION * normal(random));
            truth += velocity * DT + a * (0.5 * DT * DT);
            velocity += a * DT;
            let measured = camera.seen(&truth, random);
            camera.measure(&measured, false);
            let off = camera.at - truth;
            sum += off.dot(&(camera.momentum.place.try_inverse().unwrap() * off));
            let wrong = camera.momentum.velocity - velocity;
            sum += wrong.dot(&(camera.momentum.spread.try_inverse().unwrap() * wrong));
            count += 1;
        }
    }
    let mean = sum / f64::from(count);
    assert!((mean - 6.0).abs() < 0.5, "{mean}");
}

/// A frame far from its prediction raises the acceleration no more than one three deviations away.
#[test]
fn single_frame_has_limited_influence_on_the_acceleration() {
    let mut camera = Followed::new(TURN);
    camera.follow(by_hand, 60, true, &mut random(0));
    let expected = camera.momentum.expect(DT);
    // The measurement halves the variance. The innovation is expected to have the other half.
    let covariance = expected.place() * 0.5;
    let deviation = libm::sqrt(covariance.trace());
    let learned = |n: f64| expected.accelerated(&Vec3::new(n * deviation, 0.0, 0.0), &covariance);
    assert!((learned(100.0) - learned(3.0)).abs() < 1e-9);
    // Control: below that, a larger error raises it more.
    assert!(learned(2.0) > 1.1 * learned(1.0) && learned(3.0) > 1.05 * learned(2.5));
}

/// A wrong pose does not change the velocity. After a hit, the velocity is right again within a third of a second.
#[test]
fn position_jump_keeps_the_velocity() {
    let mut camera = Followed::new(CALM);
    camera.follow(by_hand, 60, true, &mut random(0));
    let before = camera.momentum;
    let mut jumped = Followed { ..camera };
    jumped.measure(&(camera.at + Vec3::new(0.0, 0.05, 0.0)), true);
    assert_eq!(jumped.momentum.velocity, before.velocity);
    assert!(jumped.momentum.acceleration > 1.2 * before.acceleration);
    // Control: a smaller step changes the velocity.
    let mut near = Followed { ..camera };
    near.measure(&(camera.at + Vec3::new(0.0, 0.01, 0.0)), true);
    assert!((near.momentum.velocity - before.velocity).norm() > 0.05);

    let from = camera.at;
    let hit = |t: f64| from + Vec3::new(0.0, 1.5 * t, 0.0);
    camera.follow(hit, 10, true, &mut random(1));
    let after = camera.momentum.velocity;
    assert!((after.y - 1.5).abs() < 0.3, "{after:?}");
}

#[test]
fn reversed_momentum_negates_the_prediction() {
    let mut camera = Followed::new(TURN);
    camera.follow(by_hand, 40, true, &mut random(1));
    let (there, back) = (camera.momentum, camera.momentum.reversed());
    assert_eq!(there.expect(DT).shift, -back.expect(DT).shift);
    assert_eq!(back.reversed().cross, there.cross);
    // A prediction over zero time changes nothing.
    let still = there.expect(0.0);
    assert_eq!(still.shift, Vec3::zeros());
    assert_eq!(still.found(&Vec3::zeros(), None).velocity, there.velocity);
}
