//! The scenes by their names.

use crate::path::Path;
use crate::people::Cast;
use crate::scene::Scene;

const NAMES: [&str; 13] = [
    "xyz",
    "rpy",
    "halfsphere",
    "static",
    "loop_two_rooms",
    "equal_rooms",
    "equal_rooms_return",
    "walking_xyz",
    "walking_rpy",
    "walking_halfsphere",
    "walking_static",
    "sitting_xyz",
    "box_carried",
];

/// The names of the scenes: what [`SimulatorConfig::scene`] may be.
#[must_use]
pub fn scene_names() -> &'static [&'static str] {
    &NAMES
}

/// The scene and the path of a name.
pub(crate) fn build(name: &str, seed: u64) -> Option<(Scene, Path)> {
    let people = |cast| Scene::office_with_people(seed, cast);
    Some(match name {
        "xyz" => (Scene::office(seed), Path::xyz(seed)),
        "rpy" => (Scene::office(seed), Path::rpy(seed)),
        "halfsphere" => (Scene::office(seed), Path::halfsphere(seed)),
        "static" => (Scene::office(seed), Path::still(seed)),
        "loop_two_rooms" => (
            Scene::two_rooms(seed),
            Path::walk(seed, &Scene::TWO_ROOMS_WALK),
        ),
        "equal_rooms" => equal_rooms(seed, 0),
        "equal_rooms_return" => equal_rooms(seed, 1),
        "walking_xyz" => (people(Cast::Walking), Path::xyz(seed).farther(0.7)),
        "walking_rpy" => (people(Cast::Walking), Path::rpy(seed).farther(0.6)),
        "walking_halfsphere" => (people(Cast::Walking), Path::halfsphere(seed).farther(1.1)),
        "walking_static" => (people(Cast::Walking), Path::still(seed).farther(0.66)),
        "sitting_xyz" => (people(Cast::Sitting), Path::xyz(seed).farther(0.25)),
        "box_carried" => (people(Cast::Carrying), Path::xyz(seed).farther(0.85)),
        _ => return None,
    })
}

/// The equal rooms with the shorter or the longer walk.
fn equal_rooms(seed: u64, walk: usize) -> (Scene, Path) {
    let path = Path::walk(seed, &Scene::EQUAL_ROOMS_WALK);
    let length = Scene::EQUAL_ROOMS_LENGTHS[walk];
    (Scene::equal_rooms(seed), path.for_length(length))
}

/// The scene whose name needs the fewest edits (Levenshtein) to become `name`.
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
