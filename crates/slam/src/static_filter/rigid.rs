//! The rigid test of single features: compares flow with that of a static scene.

use super::cells::Cells;
use super::{FlowPair, FrameInput};
use stillpoint_geometry::{Camera, Se3, Vec2};

/// Distance from the position in a static scene beyond which a feature moves, px: flow errs by a third of a pixel
/// (decision 21), the pose before the filter and a rolling shutter by as much again. If the three are independent that
/// is 0.58 px in all; chosen: 3.5 times that.
const MOVING_PX: f64 = 2.0;
/// Distance below which a feature is static, px. Chosen: twice the 0.58 px that flow and pose err by (`MOVING_PX`).
/// Measured: with 1 px people who come in shift the camera by 36 instead of 25 mm (decision 62).
const STATIC_PX: f64 = 1.2;
/// A moving feature is off by at least this many of its own standard deviations, as one static feature of 3000 is by
/// chance (99.97 % quantile of a Rayleigh distribution), and by as many typical distances of the frame, as one of 300
/// is, since the pose before the filter may be off by pixels (the typical distance is the 30 % quantile). One that is
/// off by less than half as many is static, as are 86 % of the static ones.
const MOVING_SIGMAS: f64 = 4.0;
/// Typical distance at which the flow of a frame counts half, px: then an inaccurate pose or rolling shutter explains
/// most apparent motion. Chosen: some three times the third of a pixel that flow errs by (decision 21).
const HALF_CERTAIN_PX: f64 = 0.9;
/// Typical distance above which the camera's motion is in doubt rather than the scene, px. Chosen: three times the 1.5
/// px that flow errs by in blurred images (decision 23).
const MAX_TYPICAL_PX: f64 = 5.0;

/// Vote of a feature on the surface it lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Vote {
    pub(super) cell: usize,
    pub(super) moving: bool,
}

/// Distance of a feature from its position in a static scene, in the last frame, px, as [`FlowPair::length`]; `None`
/// without flow or depth.
pub(super) fn distance_px(
    camera: &Camera,
    pair: &FlowPair,
    z: f32,
    last_from_now: &Se3,
) -> Option<f64> {
    if z <= 0.0 {
        return None;
    }
    let p = last_from_now.transform(&camera.backproject(pair.now, f64::from(z)));
    if p.z <= 0.05 {
        return None;
    }
    let expected: Vec2 = camera.project(&p);
    Some(pair.length(pair.before - expected))
}

/// Likewise for a feature of unknown depth: distance from the segment of its epipolar line for depths from the minimum
/// to infinity; `None` if that is behind the camera.
pub(super) fn least_distance_px(
    camera: &Camera,
    pair: &FlowPair,
    last_from_now: &Se3,
) -> Option<f64> {
    /// Minimum depth, m: the default of `sensor.min_depth`.
    const NEAREST: f64 = 0.3;
    let ray = camera.backproject(pair.now, 1.0);
    let (near, far) = (
        last_from_now.transform(&(NEAREST * ray)),
        last_from_now.rotation * ray,
    );
    if near.z <= 0.05 || far.z <= 0.05 {
        return None;
    }
    let (near, far) = (camera.project(&near), camera.project(&far));
    let (along, to) = (far - near, pair.before - near);
    let at = (to.dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    Some(pair.length(to - at * along))
}

#[derive(Clone, Debug)]
pub(super) struct Votes {
    /// Votes of features with a clear result.
    pub(super) votes: Vec<Vote>,
    /// Reliability of the camera's motion, 0 to 1.
    pub(super) certainty: f32,
    /// Distance beyond which a feature moves, px; infinite while the camera's motion is in doubt.
    pub(super) moving_px: f64,
    /// Per cell, features without depth: number that move by their flow, and total with flow. Empty if not used.
    pub(super) holes: Vec<[u16; 2]>,
    known: Vec<f64>,
}

impl Default for Votes {
    fn default() -> Self {
        Self {
            votes: Vec::new(),
            certainty: 0.0,
            moving_px: f64::INFINITY,
            holes: Vec::new(),
            known: Vec::new(),
        }
    }
}

impl Votes {
    pub(super) fn clear(&mut self) {
        self.votes.clear();
        self.certainty = 0.0;
        self.moving_px = f64::INFINITY;
        self.holes.clear();
    }

    /// Counts the votes of all features with a clear result; none if the camera's motion is in doubt. A feature has a
    /// raw pixel, a distance if flow and depth are known, and its standard deviation (px).
    pub(super) fn count<'a>(
        &mut self,
        cells: &Cells,
        features: impl Iterator<Item = (&'a [f32; 2], Option<f64>, f64)> + Clone,
    ) {
        self.clear();
        self.known.clear();
        self.known.extend(features.clone().filter_map(|f| f.1));
        let typical = typical(&mut self.known);
        if typical > MAX_TYPICAL_PX {
            return;
        }
        let moving = least_moving(MOVING_PX, typical);
        let still = STATIC_PX.max(0.5 * MOVING_SIGMAS * typical);
        // The flow of a single corner is weaker evidence than that of a surface: unused while the camera's motion is
        // uncertain.
        if typical <= HALF_CERTAIN_PX {
            self.moving_px = moving;
        }
        let vote = |(p, d, sigma): (&[f32; 2], Option<f64>, f64)| {
            let d = d?;
            let moving = least_moving(moving, sigma);
            let still = still.max(0.5 * MOVING_SIGMAS * sigma);
            (!(still..=moving).contains(&d)).then(|| Vote {
                cell: cells.at(p[0], p[1]),
                moving: d > moving,
            })
        };
        self.votes.extend(features.filter_map(vote));
        let doubt = typical / HALF_CERTAIN_PX;
        self.certainty = (1.0 / (1.0 + doubt * doubt)) as f32;
    }

    /// Counts the votes of features without depth; call after [`Votes::count`].
    pub(super) fn count_holes(&mut self, cells: &Cells, camera: &Camera, input: &FrameInput<'_>) {
        self.holes.resize(cells.count(), [0; 2]);
        let pairs = input.pairs.iter().zip(input.depths).enumerate();
        for (i, _) in pairs.filter(|(_, (pair, z))| pair.is_some() && **z <= 0.0) {
            let moves = self.contradicts(camera, input, i);
            let [u, v] = input.features[i];
            let [moving, all] = &mut self.holes[cells.at(u, v)];
            *moving += u16::from(moves);
            *all += 1;
        }
    }

    /// Whether the flow of a feature of unknown depth shows motion.
    pub(super) fn contradicts(&self, camera: &Camera, input: &FrameInput<'_>, i: usize) -> bool {
        let pair = input.pairs.get(i).and_then(Option::as_ref);
        pair.is_some_and(|pair| self.contradict(camera, pair, &input.last_from_now))
    }

    fn contradict(&self, camera: &Camera, pair: &FlowPair, last_from_now: &Se3) -> bool {
        least_distance_px(camera, pair, last_from_now)
            .is_some_and(|d| d > least_moving(self.moving_px, pair.sigma()))
    }
}

/// Distance from which a feature with this standard deviation, or in a frame of this typical distance, moves, px.
fn least_moving(moving_px: f64, sigma: f64) -> f64 {
    moving_px.max(MOVING_SIGMAS * sigma)
}

/// Typical distance, px: the 30 % quantile, that of static features even if people fill half of the image. Reorders the
/// input.
fn typical(known: &mut [f64]) -> f64 {
    if known.is_empty() {
        return 0.0;
    }
    let at = known.len() * 3 / 10;
    *known.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::DepthNoise;
    use proptest::prelude::*;
    use stillpoint_geometry::nalgebra::UnitQuaternion;
    use stillpoint_geometry::{BrownConrady, Vec3};

    fn camera() -> Camera {
        Camera {
            distortion: BrownConrady {
                k1: 0.2,
                k2: -0.4,
                ..BrownConrady::default()
            },
            ..Camera::pinhole(640, 480, [520.0, 520.0, 319.5, 239.5])
        }
    }

    /// Votes of features with these distances (px), all in one row.
    fn judge(distances: &[Option<f64>]) -> Vec<Vote> {
        judge_with(distances, 0.1).votes
    }

    /// Likewise for flow with a standard deviation, px.
    fn judge_with(distances: &[Option<f64>], sigma: f64) -> Votes {
        let pixels: Vec<[f32; 2]> = (0..distances.len())
            .map(|i| [(i % 640) as f32, 100.0])
            .collect();
        votes_of(&pixels, distances, sigma)
    }

    fn votes_of(pixels: &[[f32; 2]], distances: &[Option<f64>], sigma: f64) -> Votes {
        let mut votes = Votes::default();
        let features = pixels.iter().zip(distances).map(|(p, d)| (p, *d, sigma));
        votes.count(&Cells::new(&camera(), DepthNoise::default()), features);
        votes
    }

    /// `count` features at each distance.
    fn at(groups: &[(usize, f64)]) -> Vec<Option<f64>> {
        let each = groups.iter().map(|(n, d)| vec![Some(*d); *n]);
        each.flatten().collect()
    }

    fn moving(votes: &[Vote]) -> usize {
        votes.iter().filter(|v| v.moving).count()
    }

    #[test]
    fn static_point_has_zero_rigid_distance() {
        let turn = UnitQuaternion::from_euler_angles(0.01, -0.02, 0.015);
        let last_from_now = Se3::new(turn, Vec3::new(0.03, -0.02, 0.01));
        let camera = camera();
        for (x, y, z) in [(0.3, 0.2, 1.0), (-0.8, 0.4, 2.0), (1.0, -0.7, 4.0)] {
            let p = Vec3::new(x, y, z);
            let before = last_from_now.transform(&p);
            let pair = |before: Vec3| FlowPair {
                before_raw: [0.0; 2],
                before: camera.project(&before),
                before_exposed: camera.project(&before),
                now: camera.project(&p),
                flow_sigma: 0.1,
                shutter_sigma: 0.0,
                edge: Vec2::zeros(),
            };
            let still = distance_px(&camera, &pair(before), z as f32, &last_from_now);
            assert!(still.unwrap() < 1e-3);
            // It moved 5 cm sideways.
            let aside = before + Vec3::new(0.05, 0.0, 0.0);
            let moved = distance_px(&camera, &pair(aside), z as f32, &last_from_now);
            let expected = camera.fx * 0.05 / before.z;
            assert!((moved.unwrap() - expected).abs() < 1e-3);
        }
    }

    /// A feature seen along (x, y, 1) at depth `z`, which moved by `moves` between two frames.
    fn pair_of(last_from_now: &Se3, ray: Vec3, z: f64, moves: Vec3) -> FlowPair {
        let camera = camera();
        let before = camera.project(&(last_from_now.transform(&(z * ray)) + moves));
        FlowPair {
            before_raw: [0.0; 2],
            before,
            before_exposed: before,
            now: camera.project(&ray),
            flow_sigma: 0.1,
            shutter_sigma: 0.0,
            edge: Vec2::zeros(),
        }
    }

    proptest! {
        /// The minimum distance is that of the best depth: 0 for a static feature, and at most that of any depth.
        #[test]
        fn unknown_depth_uses_the_minimum_distance(
            x in -0.5..0.5_f64, y in -0.4..0.4_f64, z in 0.35..8.0_f64, other in 0.35..8.0_f64,
            turn in prop::array::uniform3(-0.03..0.03_f64), go in prop::array::uniform3(-0.03..0.03_f64),
            moves in prop::array::uniform3(-0.1..0.1_f64),
        ) {
            let turn = UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]);
            let pose = Se3::new(turn, Vec3::from(go));
            let ray = Vec3::new(x, y, 1.0);
            let least = |moves| least_distance_px(&camera(), &pair_of(&pose, ray, z, moves), &pose);
            prop_assert!(least(Vec3::zeros()).unwrap() < 1e-3);
            let pair = pair_of(&pose, ray, z, Vec3::from(moves));
            let at_other = distance_px(&camera(), &pair, other as f32, &pose).unwrap();
            prop_assert!(least(Vec3::from(moves)).unwrap() <= at_other + 1e-3);
        }
    }

    #[test]
    fn only_flow_off_the_epipolar_line_contradicts() {
        let pose = Se3::new(UnitQuaternion::identity(), Vec3::new(0.02, 0.0, 0.0));
        let votes = votes_of(&[[100.0, 100.0]; 9], &[Some(0.2); 9], 0.1);
        let ray = Vec3::new(0.1, 0.1, 1.0);
        let contradicts = |votes: &Votes, moves: [f64; 3]| {
            let pair = pair_of(&pose, ray, 1.5, Vec3::from(moves));
            votes.contradict(&camera(), &pair, &pose)
        };
        assert!(contradicts(&votes, [0.0, 0.02, 0.0]));
        // Motion against the camera's would put it behind the camera or implausibly near.
        assert!(contradicts(&votes, [-0.05, 0.0, 0.0]));
        assert!(
            !contradicts(&votes, [0.01, 0.0, 0.0]),
            "as something nearer"
        );
        assert!(!contradicts(&votes, [0.0; 3]));
        // While the camera's motion is in doubt, no feature moves.
        let doubt = votes_of(&[[100.0, 100.0]; 9], &[Some(9.0); 9], 0.1);
        assert!(!contradicts(&doubt, [0.0, 0.02, 0.0]));
        assert!(!contradicts(&Votes::default(), [0.0, 0.02, 0.0]));
    }

    #[test]
    fn no_depth_gives_no_distance() {
        let pair = pair_of(&Se3::identity(), Vec3::z(), 1.0, Vec3::zeros());
        let distance = |z, pose| distance_px(&camera(), &pair, z, &pose);
        assert_eq!(distance(0.0, Se3::identity()), None);
        assert!(distance(1.0, Se3::identity()).is_some());
        // Points behind the camera have no distance either.
        let back = Se3::new(UnitQuaternion::identity(), Vec3::new(0.0, 0.0, -2.0));
        assert_eq!(distance(1.0, back), None);
    }

    #[test]
    fn only_clear_features_vote() {
        let votes = judge(&at(&[(60, 0.2), (20, 1.6), (20, 9.0)]));
        assert_eq!((votes.len(), moving(&votes)), (80, 20));
        // Features without flow do not count.
        let mut distances = at(&[(60, 0.2), (20, 9.0)]);
        distances.extend([None; 300]);
        let votes = judge(&distances);
        assert_eq!((votes.len(), moving(&votes)), (80, 20));
        assert!(judge(&[]).is_empty());
        assert!(judge(&[None; 10]).is_empty());
    }

    #[test]
    fn vote_is_assigned_to_the_cell_of_its_feature() {
        let cells = Cells::new(&camera(), DepthNoise::default());
        let pixels = [[4.0, 4.0], [100.0, 50.0], [630.0, 470.0], [300.0, 10.0]];
        let distances = [Some(0.1), Some(0.1), Some(8.0), None];
        let votes = votes_of(&pixels, &distances, 0.1).votes;
        let expected = pixels.map(|[u, v]| cells.at(u, v));
        assert_eq!(votes.len(), 3);
        for (vote, cell) in votes.iter().zip(expected) {
            assert_eq!(vote.cell, cell);
        }
        assert!(votes[2].moving);
    }

    #[test]
    fn motion_is_relative_to_the_typical_distance() {
        // With a good pose, 3 px are a motion.
        assert_eq!(moving(&judge(&at(&[(70, 0.2), (30, 3.0)]))), 30);
        // If the whole image is off by a pixel, they are not, but 6 px still are.
        assert_eq!(moving(&judge(&at(&[(70, 1.0), (30, 3.0)]))), 0);
        assert_eq!(moving(&judge(&at(&[(70, 1.0), (30, 6.0)]))), 30);
        // People may fill more than half of the image.
        assert_eq!(moving(&judge(&at(&[(40, 0.2), (60, 12.0)]))), 60);
    }

    #[test]
    fn uncertain_camera_motion_gives_no_moving_votes() {
        // All distances are large: the pose is wrong.
        assert_eq!(moving(&judge(&at(&[(100, 40.0)]))), 0);
        assert_eq!(moving(&judge(&at(&[(10, 0.2), (90, 40.0)]))), 0);
    }

    #[test]
    fn uncertain_flow_raises_the_motion_threshold() {
        let distances = at(&[(70, 0.2), (30, 3.0)]);
        let moving_of = |sigma: f64| moving(&judge_with(&distances, sigma).votes);
        assert_eq!(moving_of(0.3), 30);
        assert_eq!(moving_of(1.0), 0);
        assert_eq!(
            judge_with(&at(&[(70, 0.2), (30, 6.0)]), 1.0).votes.len(),
            100
        );
    }

    #[test]
    fn flow_certainty_falls_with_the_typical_distance() {
        let certainty = |typical: f64| judge_with(&at(&[(100, typical)]), 0.1).certainty;
        assert!(certainty(0.1) > 0.95);
        assert!((certainty(HALF_CERTAIN_PX) - 0.5).abs() < 1e-6);
        assert!(certainty(2.0) < 0.2 && certainty(6.0).abs() < f32::EPSILON);
    }
}
