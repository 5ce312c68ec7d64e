//! Votes on the camera's motion: sharp ones, known translations, and refinement without samples.

use crate::camera_motion::{camera, error, follow};
use stillpoint_estimation::{
    Intrinsics, KnownPlace, MotionOptions, MotionPrior, Purpose, find_camera_motion, rng,
};
use stillpoint_geometry::{Mat3, Se3, Vec3, Vec6};

/// A room and a person walking in it, between two frames.
struct Walk {
    camera_moves: Vec6,
    /// Number of the room's pairs, and their depths, m.
    room: (usize, (f64, f64)),
    /// Likewise for the person, who fills these columns of the image.
    person: (usize, (f64, f64)),
    columns: (f64, f64),
    /// The person's motion, as a translation of the camera, m.
    step: f64,
    /// Stated error of the pairs, px: larger than the true one.
    judged: f64,
    /// Whether the earlier frame has usable depths.
    with_depth: bool,
}

impl Walk {
    /// Translation errors with wide and sharp voting, m: medians of 20 seeds.
    fn errors(&self) -> [f64; 2] {
        let camera_moves = Se3::exp(&self.camera_moves);
        let step = Vec6::new(self.step, 0.002, 0.0, 0.0, 0.0, 0.0);
        let person_moves = camera_moves * Se3::exp(&step);
        let of_seed = |seed: u64| {
            let random = &mut rng(seed, 0, Purpose(1002));
            let (count, depths) = self.room;
            let mut pairs = follow(
                &camera_moves,
                count,
                (10.0, 630.0),
                depths,
                self.with_depth,
                random,
            );
            let (count, depths) = self.person;
            pairs.extend(follow(
                &person_moves,
                count,
                self.columns,
                depths,
                self.with_depth,
                random,
            ));
            for p in &mut pairs {
                p.measurement.pixel_weight = 1.0 / (self.judged * self.judged);
            }
            [0.0, 60.0].map(|peak| {
                let options = MotionOptions {
                    peak,
                    ..MotionOptions::default()
                };
                let rng = rng(seed, 7, Purpose::CAMERA_MOTION);
                let camera = Intrinsics::from(&camera());
                let motion = find_camera_motion(&camera, &pairs, None, &options, rng).unwrap();
                error(&motion.b_from_a, &camera_moves).0
            })
        };
        let all: Vec<[f64; 2]> = (0..20).map(of_seed).collect();
        [0, 1].map(|k| {
            let mut errors: Vec<f64> = all.iter().map(|e| e[k]).collect();
            errors.sort_by(f64::total_cmp);
            errors[errors.len() / 2]
        })
    }
}

/// A person walking slowly past a desk: a compromise between both motions is within pixels of all points. With wide
/// voting almost all pairs agree with that; with sharp voting the desk's own motion wins.
#[test]
fn sharp_voting_rejects_a_compromise_motion() {
    let [wide, sharp] = Walk {
        camera_moves: Vec6::new(0.005, -0.004, -0.007, 0.001, -0.012, 0.002),
        room: (140, (1.0, 2.2)),
        person: (70, (0.8, 1.0)),
        columns: (350.0, 500.0),
        step: -0.01,
        judged: 1.5,
        with_depth: true,
    }
    .errors();
    assert!(sharp < 0.5 * wide, "{sharp} m sharply, {wide} m widely");
}

/// A camera that rotates in front of a desk of nearly constant depth: a rotation with the opposite translation moves
/// all of it alike, and a few nearer people decide between both. With wide voting these walking people decide.
#[test]
fn sharp_voting_ignores_a_few_points_at_another_depth() {
    let [wide, sharp] = Walk {
        camera_moves: Vec6::new(0.005, 0.0, 0.002, 0.0, -0.05, 0.01),
        room: (200, (1.0, 1.15)),
        person: (40, (0.65, 0.75)),
        columns: (400.0, 630.0),
        step: 0.03,
        judged: 10.0,
        with_depth: false,
    }
    .errors();
    assert!(wide > 0.01, "{wide} m");
    assert!(sharp < 0.005, "{sharp} m sharply, {wide} m widely");
}

/// Pairs at one depth in the image centre hardly distinguish translation from rotation; a known translation does.
#[test]
fn known_translation_disambiguates_rotation() {
    let truth = Se3::exp(&Vec6::new(0.006, 0.0, 0.0, 0.0, 0.05, 0.0));
    let (mut with, mut without) = (0.0, 0.0);
    for seed in 0..40 {
        let random = &mut rng(seed, 0, Purpose(1000));
        let pairs = follow(&truth, 60, (260.0, 380.0), (1.9, 2.1), true, random);
        let place = KnownPlace {
            in_a: Vec3::zeros(),
            in_b: truth.translation,
            information: Mat3::from_diagonal_element(1.0 / (0.002 * 0.002)),
        };
        let find = |place| {
            let options = MotionOptions {
                place,
                ..MotionOptions::default()
            };
            let rng = rng(seed, 7, Purpose::CAMERA_MOTION);
            find_camera_motion(&Intrinsics::from(&camera()), &pairs, None, &options, rng).unwrap()
        };
        with += error(&find(Some(place)).b_from_a, &truth).0;
        without += error(&find(None).b_from_a, &truth).0;
    }
    assert!(without > 5.0 * with, "{without} m against {with} m");
}

/// Most pairs follow the room, and the prior is near a person's motion: without samples that motion is refined.
#[test]
fn without_samples_only_the_prior_is_refined() {
    let random = &mut rng(0, 0, Purpose(1003));
    let room_moves = Se3::exp(&Vec6::new(0.012, -0.004, 0.008, 0.004, -0.006, 0.002));
    let person_moves = room_moves * Se3::exp(&Vec6::new(0.045, 0.0, 0.01, 0.0, 0.0, 0.0));
    let mut pairs = follow(&room_moves, 200, (10.0, 400.0), (1.5, 4.0), true, random);
    let person = follow(&person_moves, 100, (400.0, 630.0), (1.0, 1.5), true, random);
    pairs.extend(person);
    let prior = MotionPrior {
        b_from_a: person_moves * Se3::exp(&Vec6::new(0.006, -0.005, 0.005, 0.001, 0.001, 0.0)),
        sigma_m: 0.02,
        sigma_rad: 0.02,
    };
    let find = |prior: Option<&MotionPrior>, max_iterations| {
        let options = MotionOptions {
            max_iterations,
            ..MotionOptions::default()
        };
        let rng = rng(0, 7, Purpose::CAMERA_MOTION);
        find_camera_motion(&Intrinsics::from(&camera()), &pairs, prior, &options, rng)
    };
    let refined = find(Some(&prior), 0).unwrap();
    assert_eq!(refined.iterations, 0);
    assert!(error(&refined.b_from_a, &person_moves).0 < 0.005);
    assert!(
        error(&prior.b_from_a, &person_moves).0 > 0.008,
        "the prior is worse"
    );
    assert!(find(None, 0).is_none(), "nothing to refine");
    // Control: samples find the room.
    let sampled = find(Some(&prior), 200).unwrap();
    assert!(error(&sampled.b_from_a, &room_moves).0 < 0.003);
}
