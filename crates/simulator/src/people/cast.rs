//! Who is in which scene, and what they do there.

use super::gait::{Gait, Load, SIT_BACK};
use super::mesh::{Cover, Mesh};
use super::route::{Route, Stage};
use super::{Body, Dress, Person};
use crate::random::{Purpose, Stream};
use crate::scene::Builder;
use crate::texture::Pattern;

/// The people of a scene.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cast {
    /// Two people walk behind and before the desk; one of them sits down for a while.
    Walking,
    /// Two people sit behind the desk and talk.
    Sitting,
    /// One person carries a box.
    Carrying,
}

/// Direction towards the camera, rad.
const TO_CAMERA: f64 = -std::f64::consts::FRAC_PI_2;

/// Chairs behind the desk: place of the seat, m, and the direction in which one sits, rad.
pub(crate) const SEATS: [[f64; 3]; 2] = [[-0.62, 0.62, -1.35], [0.62, 0.66, -1.75]];

/// Where the feet's middle of a person is who sits on a seat.
fn feet_of([x, y, yaw]: [f64; 3]) -> [f64; 2] {
    let ahead = SIT_BACK - 0.06;
    [x + ahead * libm::cos(yaw), y + ahead * libm::sin(yaw)]
}

const PLAID: Dress = Dress {
    shirt: (Pattern::Plaid, 0),
    trousers: (Pattern::Denim, 0),
    head: 0,
    shoes: 0,
    long_sleeves: true,
};
const PRINT: Dress = Dress {
    shirt: (Pattern::Print, 1),
    trousers: (Pattern::Chino, 1),
    head: 1,
    shoes: 1,
    long_sleeves: false,
};

impl Cast {
    /// Adds the people to a scene.
    pub(crate) fn enter(self, b: &mut Builder, seed: u64) {
        let rng = &mut Stream::new(seed, Purpose::People, 0);
        let people = match self {
            Self::Walking => vec![
                (PLAID, [1.01, 1.05], walker(), None),
                (PRINT, [0.97, 1.0], sitter(), None),
            ],
            Self::Sitting => [PLAID, PRINT]
                .into_iter()
                .zip(SEATS)
                .map(|(dress, seat)| (dress, [1.0, 1.02], seated(seat), None))
                .collect(),
            Self::Carrying => vec![(PLAID, [1.01, 1.05], carrier(), Some(LOAD))],
        };
        let mut mover = 0;
        for (dress, size, (start, stages), load) in people {
            mover += 1;
            let body = Body::new(b, &dress, size, mover);
            let gait = Gait {
                route: Route::new(start, &stages),
                size: size[0],
                phase: rng.range(0.0, 1.0),
                load,
            };
            let load = load.map(|l: Load| {
                mover += 1;
                let skin = b.skin(Pattern::Package, 60);
                let cover = Cover {
                    texture: skin.texture,
                    infrared: skin.infrared,
                    mover,
                    surface: 0,
                };
                (Mesh::cuboid(l.half, 128.0), cover)
            });
            b.people.push(Person { gait, body, load });
        }
    }
}

const LOAD: Load = Load {
    half: [0.17, 0.21, 0.17],
    wander: 0.07,
};

/// Start and stages of a route.
type Script = ([f64; 3], Vec<Stage>);

/// Walks behind the desk, stops, comes round it and crosses close before the camera.
fn walker() -> Script {
    use Stage::{Stand, Talk, To};
    let stages = vec![
        To(0.35, 0.75, 1.0),
        Talk(1.0, TO_CAMERA),
        To(1.55, 0.5, 1.1),
        To(1.55, -0.75, 1.1),
        To(0.9, -1.12, 1.0),
        To(-1.7, -1.12, 0.8),
        Stand(1.0, 3.0),
    ];
    ([-1.0, 0.75, 0.0], stages)
}

/// Stands before the desk, walks round it and sits down behind it.
fn sitter() -> Script {
    use Stage::{Sit, Talk, To};
    let [x, y] = feet_of(SEATS[0]);
    let stages = vec![
        Talk(1.5, 2.0),
        To(-1.5, -0.9, 0.9),
        To(-1.5, 0.45, 1.1),
        To(x, y, 0.8),
        Sit(8.0, SEATS[0][2]),
    ];
    ([-0.5, -1.1, 2.0], stages)
}

fn seated(seat: [f64; 3]) -> Script {
    let [x, y] = feet_of(seat);
    ([x, y, seat[2]], vec![Stage::Sit(60.0, seat[2])])
}

/// Carries a box from right to left behind the desk and back before it.
fn carrier() -> Script {
    use Stage::{Stand, To};
    let stages = vec![
        Stand(1.0, 3.1),
        To(-1.5, 0.7, 0.8),
        To(-1.5, -0.9, 0.9),
        To(1.6, -1.12, 0.7),
    ];
    ([1.0, 0.7, 3.1], stages)
}
