//! Builds lit faces from quads, boxes and prisms.

use super::{Corners, Face, Lamp, Light, Scene};
use crate::people::Person;
use crate::random::{Purpose, Stream};
use crate::texture::{Pattern, Texture};
use crate::truth::ThingBox;
use stillpoint_geometry::Vec3;

#[derive(Clone, Copy)]
pub(crate) struct Skin {
    pub(crate) texture: u16,
    /// Texels per metre; `None` stretches the texture over the face.
    density: Option<f64>,
    pub(crate) infrared: f32,
}

impl Skin {
    /// The same skin repeated at `density` texels per metre.
    pub(crate) fn tiled(self, density: f64) -> Self {
        Self {
            density: Some(density),
            ..self
        }
    }
}

/// A local frame on the floor plan: origin and rotation about the vertical.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    origin: Vec3,
    cos: f64,
    sin: f64,
}

impl Place {
    pub(crate) fn new(x: f64, y: f64, z: f64, yaw: f64) -> Self {
        Self {
            origin: Vec3::new(x, y, z),
            cos: libm::cos(yaw),
            sin: libm::sin(yaw),
        }
    }

    pub(crate) fn then(&self, x: f64, y: f64, z: f64, yaw: f64) -> Self {
        let (c, s) = (libm::cos(yaw), libm::sin(yaw));
        Self {
            origin: self.point(x, y, z),
            cos: self.cos * c - self.sin * s,
            sin: self.sin * c + self.cos * s,
        }
    }

    pub(crate) fn direction(&self, x: f64, y: f64, z: f64) -> Vec3 {
        Vec3::new(self.cos * x - self.sin * y, self.sin * x + self.cos * y, z)
    }

    pub(crate) fn point(&self, x: f64, y: f64, z: f64) -> Vec3 {
        self.origin + self.direction(x, y, z)
    }

    fn local(&self, p: &Vec3) -> Vec3 {
        let d = p - self.origin;
        Vec3::new(
            self.cos * d.x + self.sin * d.y,
            self.cos * d.y - self.sin * d.x,
            d.z,
        )
    }
}

pub(crate) struct Builder {
    seed: u64,
    pub(crate) rng: Stream,
    faces: Vec<Face>,
    textures: Vec<Texture>,
    names: Vec<(Pattern, u64)>,
    light: Light,
    pub(crate) people: Vec<Person>,
    things: Vec<ThingBox>,
}

impl Builder {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            seed,
            rng: Stream::new(seed, Purpose::Layout, 0),
            faces: Vec::new(),
            textures: Vec::new(),
            names: Vec::new(),
            light: Light::default(),
            people: Vec::new(),
            things: Vec::new(),
        }
    }

    /// Registers all faces from `first` on as an object of a class, with the axes of a place.
    fn note(&mut self, class: &'static str, place: &Place, first: usize) {
        let far = Vec3::repeat(f64::INFINITY);
        let corners = self.faces[first..].iter().flat_map(|f| f.vertices.iter());
        let [low, high] = corners
            .map(|p| place.local(p))
            .fold([far, -far], |[a, b], p| [a.inf(&p), b.sup(&p)]);
        let middle = 0.5 * (low + high);
        self.things.push(ThingBox {
            class,
            centre: place.point(middle.x, middle.y, middle.z).into(),
            size: (high - low).into(),
            yaw: libm::atan2(place.sin, place.cos),
            taken_at: None,
        });
        let number = self.things.len() as u16;
        for face in &mut self.faces[first..] {
            face.thing = number;
        }
    }

    /// Builds an object of a COCO class at a place.
    pub(crate) fn thing(
        &mut self,
        class: &'static str,
        place: &Place,
        build: impl FnOnce(&mut Self),
    ) {
        let first = self.faces.len();
        build(self);
        self.note(class, place, first);
    }

    pub(crate) fn finish(self) -> Scene {
        Scene {
            faces: self.faces,
            textures: self.textures,
            light: self.light,
            people: self.people,
            things: self.things,
        }
    }

    /// Adds a copy of everything, moved by `shift` (m), with the original's lighting.
    pub(crate) fn copy_all(&mut self, shift: &Vec3) {
        for k in 0..self.faces.len() {
            let mut face = self.faces[k].clone();
            for vertex in face.vertices.iter_mut() {
                *vertex += shift;
            }
            for (offset, axis) in face.offsets.iter_mut().zip(&face.axes) {
                *offset -= axis.dot(shift);
            }
            if face.thing > 0 {
                face.thing += self.things.len() as u16;
            }
            self.faces.push(face);
        }
        let moved = |thing: &ThingBox| ThingBox {
            centre: (Vec3::from(thing.centre) + shift).into(),
            ..*thing
        };
        let copies: Vec<ThingBox> = self.things.iter().map(moved).collect();
        self.things.extend(copies);
    }

    /// Lamps light only faces that are added after them.
    pub(crate) fn lamp(&mut self, x: f64, y: f64, z: f64, power: f64) {
        self.light.lamps.push(Lamp {
            at: Vec3::new(x, y, z),
            power,
        });
    }

    /// The skin with the `variant`-th texture of a pattern, stretched over each face.
    pub(crate) fn skin(&mut self, pattern: Pattern, variant: usize) -> Skin {
        let name = (pattern, variant as u64);
        let number = self
            .names
            .iter()
            .position(|n| *n == name)
            .unwrap_or_else(|| {
                let seed = crate::random::key(self.seed, Purpose::Texture, name.1);
                self.textures.push(Texture::paint(pattern, seed));
                self.names.push(name);
                self.names.len() - 1
            });
        let infrared = match pattern {
            Pattern::Black | Pattern::DarkScreen => 0.026,
            Pattern::LitScreen => 0.03,
            Pattern::Fabric => 0.35,
            _ => 0.8,
        };
        Skin {
            texture: number as u16,
            density: None,
            infrared,
        }
    }

    /// A parallelogram: `corner` at the lower left as seen from the outside, `right` and `up` its sides.
    pub(crate) fn quad(&mut self, corner: Vec3, right: Vec3, up: Vec3, skin: Skin) {
        let corners = [corner, corner + right, corner + right + up, corner + up];
        let normal = right.cross(&up).normalize();
        let [width, height] = self.textures[usize::from(skin.texture)].size();
        let (length, rise) = (right.norm(), up.norm());
        let (per_s, per_t) = match skin.density {
            Some(density) => (density / length, density / rise),
            None => (width / (length * length), height / (rise * rise)),
        };
        // Rows of a texture go down.
        let axes = [right * per_s, up * -per_t];
        let top_left = corner + up;
        let offsets = [-axes[0].dot(&top_left), -axes[1].dot(&top_left)];
        let l = corners.map(|p| self.light.brightness(&p, &normal));
        let (span_s, span_t) = (axes[0].dot(&right), -axes[1].dot(&up));
        let along_s = 0.5 * (l[1] - l[0] + l[2] - l[3]) / span_s;
        let along_t = 0.5 * (l[0] - l[3] + l[1] - l[2]) / span_t;
        let mean = 0.25 * (l[0] + l[1] + l[2] + l[3]);
        let base = mean - 0.5 * (along_s * span_s + along_t * span_t);
        self.faces.push(Face {
            vertices: Corners::Polygon(corners.to_vec()),
            normal,
            texture: skin.texture,
            axes,
            offsets,
            light: [base as f32, along_s as f32, along_t as f32],
            infrared: skin.infrared,
            mover: 0,
            surface: 0,
            thing: 0,
        });
    }

    /// A box from `low` to `high` in a place's coordinates, with skins for its sides and its top (and bottom).
    pub(crate) fn cuboid(
        &mut self,
        place: &Place,
        low: [f64; 3],
        high: [f64; 3],
        [side, top]: [Skin; 2],
    ) {
        let [x0, y0, z0] = low;
        let [x1, y1, z1] = high;
        let (dx, dy, dz) = (x1 - x0, y1 - y0, z1 - z0);
        let (ex, ey, ez) = (
            place.direction(dx, 0.0, 0.0),
            place.direction(0.0, dy, 0.0),
            place.direction(0.0, 0.0, dz),
        );
        self.quad(place.point(x0, y0, z0), ex, ez, side);
        self.quad(place.point(x1, y1, z0), -ex, ez, side);
        self.quad(place.point(x0, y1, z0), -ey, ez, side);
        self.quad(place.point(x1, y0, z0), ey, ez, side);
        self.quad(place.point(x0, y0, z1), ex, ey, top);
        self.quad(place.point(x0, y1, z0), ex, -ey, top);
    }

    /// An upright prism with `sides` faces about the vertical axis of a place.
    pub(crate) fn prism(
        &mut self,
        place: &Place,
        [radius, height]: [f64; 2],
        sides: usize,
        [side, top]: [Skin; 2],
    ) {
        let rim = |k: usize| {
            let angle = std::f64::consts::TAU * k as f64 / sides as f64;
            (radius * libm::cos(angle), radius * libm::sin(angle))
        };
        for k in 0..sides {
            let ((x0, y0), (x1, y1)) = (rim(k), rim(k + 1));
            let first = self.faces.len();
            self.quad(
                place.point(x0, y0, 0.0),
                place.direction(x1 - x0, y1 - y0, 0.0),
                place.direction(0.0, 0.0, height),
                side,
            );
            // Each face shows its share of the texture, so that the print goes around.
            let width = self.textures[usize::from(side.texture)].size()[0];
            let face = &mut self.faces[first];
            if side.density.is_none() {
                face.axes[0] /= sides as f64;
                face.offsets[0] = face.offsets[0] / sides as f64 + width * k as f64 / sides as f64;
                let mean = face.light[0] + 0.5 * width as f32 * face.light[1];
                face.light = [mean, 0.0, face.light[2]];
            }
        }
        let lid = self.faces.len();
        self.quad(
            place.point(-radius, -radius, height),
            place.direction(2.0 * radius, 0.0, 0.0),
            place.direction(0.0, 2.0 * radius, 0.0),
            top,
        );
        let rim = (0..sides).map(|k| place.point(rim(k).0, rim(k).1, height));
        self.faces[lid].vertices = Corners::Polygon(rim.collect());
    }
}
