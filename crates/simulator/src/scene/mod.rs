//! The geometry of a scene: textured, lit, convex planar faces in world coordinates (z up, m), as a function of time.

mod build;
mod equal_rooms;
mod furniture;
mod rooms;
mod walls;

pub(crate) use build::{Builder, Place};

use crate::people::{Asked, Cast, Person};
use crate::texture::Texture;
use crate::truth::{MoverState, ThingBox};
use std::ops::{Deref, DerefMut};
use stillpoint_geometry::Vec3;

/// Corners of a convex planar polygon; triangles, of which people have thousands, are stored inline without allocation.
#[derive(Clone)]
pub(crate) enum Corners {
    Triangle([Vec3; 3]),
    Polygon(Vec<Vec3>),
}

impl Deref for Corners {
    type Target = [Vec3];

    fn deref(&self) -> &[Vec3] {
        match self {
            Self::Triangle(corners) => corners,
            Self::Polygon(corners) => corners,
        }
    }
}

impl DerefMut for Corners {
    fn deref_mut(&mut self) -> &mut [Vec3] {
        match self {
            Self::Triangle(corners) => corners,
            Self::Polygon(corners) => corners,
        }
    }
}

/// A convex planar polygon with its texture and its light.
#[derive(Clone)]
pub(crate) struct Face {
    /// Corners, counter-clockwise as seen from the outside.
    pub(crate) vertices: Corners,
    /// Unit normal, to the outside.
    pub(crate) normal: Vec3,
    /// Texture number.
    pub(crate) texture: u16,
    /// Texel coordinates of a point p: `axes[k] . p + offsets[k]`.
    pub(crate) axes: [Vec3; 2],
    pub(crate) offsets: [f64; 2],
    /// Brightness `light[0] + light[1] s + light[2] t` at texel (s, t).
    pub(crate) light: [f32; 3],
    /// Share of infrared light that is scattered back, 0..1: low for black glossy plastic, which depth cameras cannot measure.
    pub(crate) infrared: f32,
    /// Number of its mover; 0 for static faces.
    pub(crate) mover: u8,
    /// Number of its smooth surface; 0 for a separate face.
    pub(crate) surface: u16,
    /// Number of its static object of a known class; 0 for none.
    pub(crate) thing: u16,
}

struct Lamp {
    at: Vec3,
    power: f64,
}

#[derive(Default)]
pub(crate) struct Light {
    lamps: Vec<Lamp>,
}

/// Ambient light, relative to a white face at full brightness.
const AMBIENT: f64 = 0.5;

impl Light {
    /// Brightness of a white surface at `p` with the unit normal `normal`.
    pub(crate) fn brightness(&self, p: &Vec3, normal: &Vec3) -> f64 {
        let lamps: f64 = self
            .lamps
            .iter()
            .map(|lamp| {
                let to = lamp.at - p;
                let distance2 = to.norm_squared();
                lamp.power * (normal.dot(&to) / distance2.sqrt()).max(0.0)
                    / (1.0 + 0.25 * distance2)
            })
            .sum();
        // The white ceiling makes light from above stronger.
        AMBIENT * (1.0 + 0.15 * normal.z) + lamps
    }
}

pub(crate) struct Scene {
    faces: Vec<Face>,
    textures: Vec<Texture>,
    light: Light,
    people: Vec<Person>,
    /// The static objects with a class; object k is entry k - 1.
    things: Vec<ThingBox>,
}

impl Scene {
    /// The office with its desk, 6 x 5 m.
    pub(crate) fn office(seed: u64) -> Self {
        rooms::office(seed, None)
    }

    /// The office prepared for people: without the second desk, with chairs for them.
    pub(crate) fn office_with_people(seed: u64, cast: Cast) -> Self {
        rooms::office(seed, Some(cast))
    }

    /// Two rooms of 8 x 7 m, joined by two doors.
    pub(crate) fn two_rooms(seed: u64) -> Self {
        rooms::two_rooms(seed)
    }

    /// The corners (x, y) of a walk through both rooms and both doors.
    pub(crate) const TWO_ROOMS_WALK: [[f64; 2]; 7] = rooms::WALK;

    /// Two identical rooms of 5.6 x 5.1 m, side by side on a corridor.
    pub(crate) fn equal_rooms(seed: u64) -> Self {
        equal_rooms::equal_rooms(seed)
    }

    /// The corners (x, y) of a closed walk through both of the equal rooms.
    pub(crate) const EQUAL_ROOMS_WALK: [[f64; 2]; 16] = equal_rooms::WALK;

    /// Lengths of that walk, m: until both rooms have been seen once, and until the first one has been seen again.
    pub(crate) const EQUAL_ROOMS_LENGTHS: [f64; 2] = equal_rooms::LENGTHS;

    pub(crate) fn fixed(&self) -> &[Face] {
        &self.faces
    }

    /// The selected faces of movers at a time (s).
    pub(crate) fn moving(&self, stamp: f64, asked: &mut dyn Asked) -> Vec<Face> {
        let mut faces = Vec::new();
        for person in &self.people {
            person.place(stamp, &self.light, asked, &mut faces);
        }
        faces
    }

    /// The state of each mover at a time (s); mover k is entry k - 1.
    pub(crate) fn movers(&self, stamp: f64) -> Vec<MoverState> {
        self.people.iter().flat_map(|p| p.movers(stamp)).collect()
    }

    pub(crate) fn is_still(&self) -> bool {
        self.people.is_empty()
    }

    /// The static objects with a class; object k is entry k - 1.
    pub(crate) fn things(&self) -> &[ThingBox] {
        &self.things
    }

    /// Objects that stand until a person takes them, with their mover numbers.
    pub(crate) fn taken(&self) -> impl Iterator<Item = (u32, ThingBox)> {
        self.people.iter().filter_map(Person::taken)
    }

    pub(crate) fn texture(&self, number: u16) -> &Texture {
        &self.textures[usize::from(number)]
    }
}

#[cfg(test)]
impl Scene {
    /// Distance along x from a point of one of the equal rooms to the same point of the other, m.
    pub(crate) const EQUAL_ROOMS_SHIFT: f64 = equal_rooms::SHIFT;

    /// A scene of given faces, all with one texture.
    pub(crate) fn of(faces: Vec<Face>, texture: Texture) -> Self {
        Self {
            faces,
            textures: vec![texture],
            light: Light::default(),
            people: Vec::new(),
            things: Vec::new(),
        }
    }
}

#[cfg(test)]
impl Face {
    /// A static face of 64 x 64 texels: from a corner to the right and up, seen from where these turn counter-clockwise.
    pub(crate) fn quad(corner: Vec3, right: Vec3, up: Vec3) -> Self {
        let axes = [
            right * (64.0 / right.norm_squared()),
            up * (-64.0 / up.norm_squared()),
        ];
        Self {
            vertices: Corners::Polygon(vec![
                corner,
                corner + right,
                corner + right + up,
                corner + up,
            ]),
            normal: right.cross(&up).normalize(),
            texture: 0,
            axes,
            offsets: [-axes[0].dot(&(corner + up)), -axes[1].dot(&(corner + up))],
            light: [1.0, 0.0, 0.0],
            infrared: 1.0,
            mover: 0,
            surface: 0,
            thing: 0,
        }
    }
}
