//! The people of each scene, and their actions.

use super::gait::{Gait, Load, SIT_BACK, Standing};
use super::mesh::{Cover, Mesh};
use super::route::{Leg, Route};
use super::{Body, Dress, Person};
use crate::path::{blocked_eye, blocked_turn};
use crate::random::{Purpose, Stream};
use crate::scene::{Builder, Place};
use crate::texture::Pattern;

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cast {
    /// Two people walk behind and before the desk; one of them sits down for a while.
    Walking,
    /// Two people sit behind the desk and talk.
    Sitting,
    /// One person carries a box.
    Carrying,
    /// Two people walk to and fro between the camera and the desk, from the first frame on.
    Crowd,
    /// One person in a patterned coat walks close before the camera from the first frame on, with the back to it.
    Coated,
    /// Two people step before the camera and follow its rotation, face to face with it.
    Blocking { walks: bool },
    /// One person comes, lifts a chair before the desk and carries it out of the view.
    Fetching,
}

/// Direction towards the camera, rad.
const TO_CAMERA: f64 = -std::f64::consts::FRAC_PI_2;

/// A chair: position of the seat, m, and direction of a seated person, rad.
type Seat = [f64; 3];

const SEAT: Seat = [-0.62, 0.62, -1.35];
const SEATS: [Seat; 2] = [[-0.55, 0.5, -1.3], [0.5, 0.52, -1.8]];
/// Line along which people pass between the camera and the desk, m.
const BEFORE: f64 = -1.06;
/// Line along which they pass behind the desk, m.
const BEHIND: f64 = 0.5;

/// Centre between the feet of a seated person.
fn feet_of([x, y, yaw]: Seat) -> [f64; 2] {
    let ahead = SIT_BACK - 0.06;
    [x + ahead * libm::cos(yaw), y + ahead * libm::sin(yaw)]
}

const PLAID: Dress = Dress {
    shirt: (Pattern::Plaid, 0),
    trousers: (Pattern::Denim, 0),
    head: 0,
    shoes: 0,
    long_sleeves: true,
    coat: false,
};
const COAT: Dress = Dress {
    shirt: (Pattern::Coat, 0),
    coat: true,
    ..PLAID
};
const PRINT: Dress = Dress {
    shirt: (Pattern::Print, 1),
    trousers: (Pattern::Chino, 1),
    head: 1,
    shoes: 1,
    long_sleeves: false,
    coat: false,
};

impl Cast {
    /// The two chairs of the office.
    fn seats(self) -> [Seat; 2] {
        match self {
            Self::Walking => [SEAT, [0.9, 1.65, 0.8]],
            Self::Sitting => SEATS,
            Self::Carrying
            | Self::Crowd
            | Self::Coated
            | Self::Blocking { .. }
            | Self::Fetching => [[-1.3, 1.6, -0.4], [0.9, 1.65, 0.8]],
        }
    }

    /// Adds the people and their chairs to a scene.
    pub(crate) fn enter(self, b: &mut Builder, seed: u64) {
        for (k, [x, y, yaw]) in self.seats().into_iter().enumerate() {
            // A chair faces -y at yaw 0.
            b.chair(&Place::new(x, y, 0.0, yaw + std::f64::consts::FRAC_PI_2), k);
        }
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
            Self::Fetching => vec![(PLAID, [1.01, 1.05], fetcher(), Some(CHAIR))],
            Self::Blocking { walks } => vec![
                (PLAID, [1.01, 1.05], blocker(-BLOCKERS_APART, walks), None),
                (PRINT, [0.97, 1.0], blocker(BLOCKERS_APART, walks), None),
            ],
            Self::Coated => vec![(COAT, [1.01, 1.05], coated(), None)],
            Self::Crowd => vec![
                (PLAID, [1.01, 1.05], near_one(), None),
                (PRINT, [0.97, 1.0], far_one(), None),
            ],
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
            let load = load.map_or_else(Vec::new, |l: Load| {
                mover += 1;
                parts(b, &l, mover)
            });
            b.people.push(Person {
                gait,
                body,
                load,
                from_behind: self == Self::Coated,
            });
        }
    }
}

const LOAD: Load = Load {
    class: "box",
    half: [0.14, 0.17, 0.14],
    wander: 0.07,
    stands: None,
};

/// Position of the chair to fetch, m; it faces -x.
const FETCHED: [f64; 2] = [-0.45, -0.5];
/// Height of a chair's centre above its feet where hands hold it, m.
const HOLD: f64 = 0.62;
const CHAIR: Load = Load {
    class: "chair",
    half: [0.27, 0.27, 0.5],
    wander: 0.02,
    stands: Some(Standing {
        at: [FETCHED[0], FETCHED[1], HOLD],
        yaw: std::f64::consts::PI,
        until: 4.8,
    }),
};

/// Seat, back, post, the foot's two bars and two arms of a chair that faces its x axis: lower and upper corner above the floor, m, and
/// whether it is upholstered.
const CHAIR_PARTS: [([f64; 3], [f64; 3], bool); 7] = [
    ([-0.24, -0.24, 0.42], [0.24, 0.24, 0.5], true),
    ([-0.27, -0.22, 0.5], [-0.2, 0.22, 1.05], true),
    ([-0.03, -0.03, 0.04], [0.03, 0.03, 0.42], false),
    ([-0.27, -0.025, 0.0], [0.27, 0.025, 0.04], false),
    ([-0.025, -0.27, 0.0], [0.025, 0.27, 0.04], false),
    ([-0.2, -0.27, 0.66], [0.1, -0.23, 0.69], false),
    ([-0.2, 0.23, 0.66], [0.1, 0.27, 0.69], false),
];

fn parts(b: &mut Builder, load: &Load, mover: u8) -> Vec<(Mesh, Cover)> {
    let mut cover = |pattern, variant| {
        let skin = b.skin(pattern, variant);
        Cover {
            texture: skin.texture,
            infrared: skin.infrared,
            mover,
            surface: 0,
        }
    };
    if load.class != "chair" {
        return vec![(Mesh::cuboid(load.half, 256.0), cover(Pattern::Carton, 0))];
    }
    let part = |(low, high, soft): ([f64; 3], [f64; 3], bool)| {
        let half = [0, 1, 2].map(|k| 0.5 * (high[k] - low[k]));
        let middle = [0, 1, 2].map(|k| 0.5 * (high[k] + low[k]) - if k == 2 { HOLD } else { 0.0 });
        let skin = if soft {
            cover(Pattern::Fabric, 0)
        } else {
            cover(Pattern::Plastic, 90)
        };
        (Mesh::cuboid(half, 128.0).moved(middle), skin)
    };
    CHAIR_PARTS.into_iter().map(part).collect()
}

type Script = ([f64; 3], Vec<Leg>);

/// Crosses close before the camera, stops there with the back to it, goes on, turns round and crosses again.
fn walker() -> Script {
    use Leg::{Stand, Talk, To};
    let stages = vec![
        To(0.12, BEFORE, 0.8),
        Talk(2.8, 1.3),
        To(1.1, BEFORE, 0.8),
        Stand(0.6, 2.9),
        To(-1.6, BEFORE, 0.62),
        Stand(60.0, 3.1),
    ];
    ([-1.5, BEFORE, 0.0], stages)
}

/// Stands behind the desk, walks there to and fro, and sits down.
fn sitter() -> Script {
    use Leg::{Sit, Stand, Talk, To};
    let [x, y] = feet_of(SEAT);
    let stages = vec![
        Talk(1.2, TO_CAMERA),
        To(1.0, BEHIND, 0.9),
        Stand(0.8, 2.6),
        To(0.1, BEHIND, 0.9),
        To(x, y, 0.8),
        Sit(60.0, SEAT[2]),
    ];
    ([0.2, BEHIND, TO_CAMERA], stages)
}

fn seated(seat: Seat) -> Script {
    let [x, y] = feet_of(seat);
    ([x, y, seat[2]], vec![Leg::Sit(60.0, seat[2])])
}

/// Moves a box into the view from the right, then carries it across before the desk and back behind it.
fn carrier() -> Script {
    use Leg::{Stand, To};
    let stages = vec![
        Stand(2.5, 3.1),
        To(-1.3, BEFORE, 0.65),
        To(-1.35, BEHIND, 1.2),
        To(0.7, BEHIND, 0.7),
        Stand(60.0, TO_CAMERA),
    ];
    ([0.95, BEFORE, 3.1], stages)
}

/// Waits beside the view, walks to the chair, lifts it and carries it away.
fn fetcher() -> Script {
    use Leg::{Stand, To};
    let [x, y] = FETCHED;
    let stages = vec![
        Stand(2.0, std::f64::consts::PI),
        To(x + 0.47, y, 0.8),
        Stand(1.8, std::f64::consts::PI),
        To(1.75, y, 0.7),
        Stand(60.0, 0.0),
    ];
    ([1.9, y, std::f64::consts::PI], stages)
}

/// The y coordinate of the line on which the nearer person of a crowd walks, m: 0.9 m in front of the camera.
const NEAR_LINE: f64 = -1.15;
/// The y coordinate of the line on which the farther person of a crowd walks, m.
const FAR_LINE: f64 = -0.6;

/// Walks to and fro on one side of the image centre, then on the other.
fn near_one() -> Script {
    let to = |x: f64| Leg::To(x, NEAR_LINE, 0.6);
    let stages = vec![to(0.45), to(-0.75), to(0.7), to(-0.5), to(0.7), to(-0.7)];
    ([-0.35, NEAR_LINE, 0.0], stages)
}

/// Walks faster, and against the nearer one from the second stage on.
fn far_one() -> Script {
    let to = |x: f64| Leg::To(x, FAR_LINE, 0.7);
    let stages = vec![to(0.7), to(-0.7), to(0.7), to(-0.7), to(0.7), to(-0.7)];
    ([0.25, FAR_LINE, 0.0], stages)
}

/// Heading of a person who faces away from the camera, rad: along +y, as cameras of crowds look.
const AWAY: f64 = std::f64::consts::FRAC_PI_2;

/// Walks to and fro with the back to the camera, 1.4 to 1.6 m before it.
fn coated() -> Script {
    let to = |x: f64, y: f64| Leg::Aside(x, y, 0.45, AWAY);
    let stages = vec![
        to(0.45, -0.62),
        to(-0.45, -0.7),
        to(0.4, -0.6),
        to(-0.4, -0.68),
        to(0.45, -0.62),
        to(-0.45, -0.68),
    ];
    ([-0.3, -0.7, AWAY], stages)
}

/// Distance from the camera of people who block its view, m.
const BLOCKERS_AT: f64 = 0.78;
/// Angle between the image centre and each person who blocks the view, rad.
const BLOCKERS_APART: f64 = 0.36;
/// Times at which people begin to block the view, s, and leave again.
const BLOCKERS_COME: f64 = 1.6;
const BLOCKERS_LEAVE: f64 = 6.2;
/// Duration of a step aside, s.
const BLOCKERS_STEP: f64 = 0.2;

/// Comes from the side, stays before the camera while it turns, a little to one side of the image centre, and leaves to the same side.
fn blocker(apart: f64, walks: bool) -> Script {
    let at = |t: f64| {
        let [x, y] = blocked_eye(t, walks);
        // To the right of the image is clockwise.
        let angle = -TO_CAMERA + blocked_turn(t, walks) - apart;
        [
            x + BLOCKERS_AT * libm::cos(angle),
            y + BLOCKERS_AT * libm::sin(angle),
            angle + std::f64::consts::PI,
        ]
    };
    let side = 1.9 * apart.signum();
    let [x, y] = blocked_eye(0.0, walks);
    let outside = [x + side, y + 0.9];
    let [first_x, first_y, _] = at(0.0);
    let way = libm::hypot(first_x - outside[0], first_y - outside[1]);
    let mut stages = vec![
        Leg::Stand(BLOCKERS_COME, at(0.0)[2]),
        Leg::Aside(first_x, first_y, way / 1.2, at(0.0)[2]),
    ];
    let mut t = BLOCKERS_COME + 1.2;
    let mut here = [first_x, first_y];
    while t < BLOCKERS_LEAVE {
        t += BLOCKERS_STEP;
        let [to_x, to_y, yaw] = at(t);
        let way = libm::hypot(to_x - here[0], to_y - here[1]);
        stages.push(match way < 1e-3 {
            true => Leg::Stand(BLOCKERS_STEP, yaw),
            false => Leg::Aside(to_x, to_y, way / BLOCKERS_STEP, yaw),
        });
        here = match way < 1e-3 {
            true => here,
            false => [to_x, to_y],
        };
    }
    let [x, y] = blocked_eye(BLOCKERS_LEAVE, walks);
    stages.push(Leg::To(x + side, y + 1.2, 1.3));
    stages.push(Leg::Stand(60.0, 0.0));
    ([outside[0], outside[1], at(0.0)[2]], stages)
}
