//! The geometry of a scene: textured, lit, convex planar faces in world coordinates (z up, m).
//!
//! Answers: which faces there are at a time. Does not know cameras (module `raster`) or paths (module `path`).

mod build;
mod furniture;
mod rooms;

use crate::texture::Texture;
use stillpoint_geometry::Vec3;

/// A convex planar polygon with its texture and its light.
pub(crate) struct Face {
    /// Corners, counter-clockwise as seen from the outside.
    pub(crate) vertices: Vec<Vec3>,
    /// Unit normal, to the outside.
    pub(crate) normal: Vec3,
    /// Number of the texture in the scene.
    pub(crate) texture: u16,
    /// Texel coordinates of a point p: `axes[k] . p + offsets[k]`.
    pub(crate) axes: [Vec3; 2],
    /// See `axes`.
    pub(crate) offsets: [f64; 2],
    /// Brightness `light[0] + light[1] s + light[2] t` at texel (s, t).
    pub(crate) light: [f32; 3],
    /// Share of infrared light that is scattered back, 0..1: black glossy plastic hides from depth cameras.
    pub(crate) infrared: f32,
}

/// All faces and textures.
pub(crate) struct Scene {
    faces: Vec<Face>,
    textures: Vec<Texture>,
}

impl Scene {
    /// The office with its desk, 6 x 5 m.
    pub(crate) fn office(seed: u64) -> Self {
        rooms::office(seed)
    }

    /// Two rooms of 8 x 7 m, joined by two doors.
    pub(crate) fn two_rooms(seed: u64) -> Self {
        rooms::two_rooms(seed)
    }

    /// The corners (x, y) of a walk through both rooms and both doors.
    pub(crate) const TWO_ROOMS_WALK: [[f64; 2]; 7] = rooms::WALK;

    /// The faces at a time (s). What moves is to be chained here with its place at that time: everything downstream
    /// asks for the colour image's stamp and the depth image's stamp separately.
    pub(crate) fn faces_at(&self, _stamp: f64) -> impl Iterator<Item = &Face> {
        self.faces.iter()
    }

    /// A texture by its number.
    pub(crate) fn texture(&self, number: u16) -> &Texture {
        &self.textures[usize::from(number)]
    }
}

#[cfg(test)]
impl Scene {
    /// A scene of given faces, all with one texture.
    pub(crate) fn of(faces: Vec<Face>, texture: Texture) -> Self {
        Self {
            faces,
            textures: vec![texture],
        }
    }
}
