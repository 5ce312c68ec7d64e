//! The scenes by name.

use crate::disparity::DepthModel;
use crate::path::Path;
use crate::people::Cast;
use crate::scene::Scene;
use crate::shutter::Shutter;

const NAMES: [&str; 33] = [
    "xyz",
    "rpy",
    "halfsphere",
    "static",
    "loop_two_rooms",
    "loop_in_haste",
    "equal_rooms",
    "equal_rooms_return",
    "equal_rooms_in_haste",
    "walking_xyz",
    "walking_rpy",
    "walking_halfsphere",
    "walking_static",
    "sitting_xyz",
    "box_carried",
    "chair_carried",
    "xyz_jolting",
    "walking_xyz_jolting",
    "rpy_60",
    "rpy_100",
    "rpy_150",
    "walking_rpy_60",
    "walking_rpy_100",
    "walking_rpy_150",
    "crowd_xyz",
    "crowd_static",
    "crowd_halfsphere",
    "crowd_rpy_60",
    "crowd_rpy_150",
    "crowd_coat",
    "crowd_pitch",
    "blocked_turn",
    "blocked_walk",
];

/// Speed factors relative to `rpy` at which it turns by up to 60, 100 and 150 deg/s.
const PACES: [f64; 3] = [1.0, 1.7, 2.5];

/// Names of the scenes: the values of [`SimulatorConfig::scene`](crate::SimulatorConfig::scene).
#[must_use]
pub fn scene_names() -> &'static [&'static str] {
    &NAMES
}

/// Time at which the camera on the half sphere passes before the desk, where the crowd is, s.
pub(crate) const CROWD_AHEAD: f64 = 0.95;

/// The scene and the path of a name.
pub(crate) fn build(name: &str, seed: u64) -> Option<(Scene, Path)> {
    let people = |cast| Scene::office_with_people(seed, cast);
    let fast = |pace: usize| Path::rpy_at(seed, PACES[pace]);
    Some(match name {
        "xyz" => (Scene::office(seed), Path::xyz(seed)),
        "rpy" => (Scene::office(seed), Path::rpy(seed)),
        "halfsphere" => (Scene::office(seed), Path::halfsphere(seed)),
        "static" => (Scene::office(seed), Path::still(seed)),
        "loop_two_rooms" => (
            Scene::two_rooms(seed),
            Path::walk(seed, &Scene::TWO_ROOMS_WALK),
        ),
        "loop_in_haste" => (
            Scene::two_rooms(seed),
            Path::walk(seed, &Scene::TWO_ROOMS_WALK).in_haste(),
        ),
        "equal_rooms" => equal_rooms(seed, 0),
        "equal_rooms_return" => equal_rooms(seed, 1),
        "equal_rooms_in_haste" => {
            let (scene, path) = equal_rooms(seed, 1);
            (scene, path.in_haste())
        }
        "walking_xyz" => (people(Cast::Walking), Path::xyz(seed).farther(0.7)),
        "walking_rpy" => (people(Cast::Walking), Path::rpy(seed).farther(0.6)),
        "walking_halfsphere" => (people(Cast::Walking), Path::halfsphere(seed).farther(1.1)),
        "walking_static" => (people(Cast::Walking), Path::still(seed).farther(0.66)),
        "sitting_xyz" => (people(Cast::Sitting), Path::xyz(seed).farther(0.25)),
        "box_carried" => (people(Cast::Carrying), Path::xyz(seed).farther(0.85)),
        "chair_carried" => (people(Cast::Fetching), Path::xyz(seed).farther(1.2)),
        "xyz_jolting" => (Scene::office(seed), Path::xyz(seed).jolting()),
        "walking_xyz_jolting" => {
            let path = Path::xyz(seed).farther(0.7);
            (people(Cast::Walking), path.jolting())
        }
        "rpy_60" => (Scene::office(seed), fast(0)),
        "rpy_100" => (Scene::office(seed), fast(1)),
        "rpy_150" => (Scene::office(seed), fast(2)),
        "walking_rpy_60" => (people(Cast::Walking), fast(0).farther(0.6)),
        "walking_rpy_100" => (people(Cast::Walking), fast(1).farther(0.6)),
        "walking_rpy_150" => (people(Cast::Walking), fast(2).farther(0.6)),
        "crowd_xyz" => (people(Cast::Crowd), Path::xyz(seed).farther(1.0)),
        "crowd_static" => (people(Cast::Crowd), Path::still(seed).farther(0.9)),
        "crowd_halfsphere" => (
            people(Cast::Crowd),
            Path::halfsphere_at(seed, 2.2)
                .farther(0.9)
                .starting_at(CROWD_AHEAD),
        ),
        "crowd_rpy_60" => (people(Cast::Crowd), fast(0).farther(0.9)),
        "crowd_rpy_150" => (people(Cast::Crowd), fast(2).farther(0.9)),
        "crowd_coat" => (people(Cast::Coated), Path::xyz(seed).farther(1.15)),
        "crowd_pitch" => (people(Cast::Crowd), Path::nodding(seed).farther(0.75)),
        "blocked_turn" | "blocked_walk" => {
            let walks = name == "blocked_walk";
            (people(Cast::Blocking { walks }), Path::blocked(seed, walks))
        }
        _ => return None,
    })
}

/// The shutter and the depth model of a scene's own camera. The hard scenes have those of a real camera.
pub(crate) fn camera(name: &str) -> (Shutter, DepthModel) {
    let fast = ["_60", "_100", "_150"].iter().any(|s| name.ends_with(s));
    if fast || name.starts_with("crowd_") {
        return (Shutter::ROLLING, DepthModel::StructuredLight);
    }
    (Shutter::default(), DepthModel::default())
}

/// The equal rooms with the shorter or the longer walk.
fn equal_rooms(seed: u64, walk: usize) -> (Scene, Path) {
    let path = Path::walk(seed, &Scene::EQUAL_ROOMS_WALK);
    let length = Scene::EQUAL_ROOMS_LENGTHS[walk];
    (Scene::equal_rooms(seed), path.for_length(length))
}

/// The scene name with the smallest edit distance to `name`.
pub(crate) fn nearest_name(name: &str) -> &'static str {
    let distance = |other: &str| {
        let b: Vec<char> = other.chars().collect();
        let mut row: Vec<usize> = (0..=b.len()).collect();
        for (i, a) in name.chars().enumerate() {
            let mut diagonal = row[0];
            row[0] = i + 1;
            for (j, c) in b.iter().enumerate() {
                let replace = diagonal + usize::from(a != *c);
                diagonal = row[j + 1];
                row[j + 1] = replace.min(row[j] + 1).min(diagonal + 1);
            }
        }
        row[b.len()]
    };
    NAMES
        .into_iter()
        .min_by_key(|n| distance(n))
        .unwrap_or(NAMES[0])
}
