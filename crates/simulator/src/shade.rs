//! Colour and infrared reflection of visible faces; visibility is in `raster`.

use crate::lens::Lens;
use crate::raster::{AT_ONCE, Eye, PLACES, View};
use crate::scene::{Face, Scene};
use stillpoint_geometry::{Camera, Vec3};

/// `c[0] + c[1] u + c[2] v` over the image.
type Affine = [f64; 3];

pub(crate) struct Visible {
    pub(crate) inverse_depth: Affine,
    s_over_z: Affine,
    t_over_z: Affine,
    light: [f32; 3],
    texture: u16,
    infrared: f32,
    /// Number of its mover; 0 for static faces.
    pub(crate) mover: u8,
    /// Number of its smooth surface; 0 for a separate face.
    surface: u16,
    /// Number of its object of a known class; 0 for none.
    pub(crate) thing: u16,
    /// Distance of the camera from the face's plane, m.
    plane_distance: f32,
}

impl View {
    /// Shades one row of the recorded image into `out`, RGB interleaved in grey levels; the view must have 2 x 2 samples per pixel. If the
    /// four samples see one face, it is shaded once at the pixel's centre; otherwise each sample is shaded.
    pub(crate) fn shade_row(&self, scene: &Scene, lens: &Lens, y: usize, out: &mut [f32]) {
        let mut x = 0;
        while x < lens.width {
            let place = lens.place(x, y);
            let numbers = self.samples(place);
            let only = match self.one_face(&numbers) {
                Some(number) => number,
                None => {
                    self.shade_mixed(scene, place, &numbers, &mut out[3 * x..3 * x + 3]);
                    x += 1;
                    continue;
                }
            };
            // Distorted pixels have unequal steps, so only ideal ones are shaded in runs.
            let mut end = x + 1;
            if lens.is_ideal() {
                let (upper, lower) = (self.row(2 * y).1, self.row(2 * y + 1).1);
                let others = upper[2 * end..2 * lens.width].iter().zip(&lower[2 * end..]);
                let same = others.take_while(|(a, b)| **a == only && **b == only);
                end += same.count() / 2;
            }
            let run = &mut out[3 * x..3 * end];
            match self.faces.get(only as usize) {
                Some(face) => face.shade(scene, place, run),
                None => run.fill(0.0),
            }
            x = end;
        }
    }

    /// The faces of the four samples about a position in the image.
    #[inline]
    fn samples(&self, [u, v]: [f64; 2]) -> [u32; 4] {
        // Sample k is at pixel (k + 0.5) / 2 - 0.5.
        let clip = |p: f64, size: usize| ((2.0 * p + 0.5).max(0.0) as usize).min(size - 2);
        let (x, y) = (clip(u, self.width), clip(v, self.whole()));
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| self.face_at(x + i, y + j))
    }

    /// The face that colours a whole pixel: the common face of its samples or, if they see one smooth surface, whose faces are continuous,
    /// the face closest to frontal.
    #[inline]
    fn one_face(&self, numbers: &[u32; 4]) -> Option<u32> {
        let [first, rest @ ..] = numbers;
        if rest.iter().all(|n| n == first) {
            return Some(*first);
        }
        let mut best = (*first, self.faces.get(*first as usize)?);
        for number in rest {
            let face = self.faces.get(*number as usize)?;
            if face.surface == 0 || face.surface != best.1.surface {
                return None;
            }
            if face.plane_distance > best.1.plane_distance {
                best = (*number, face);
            }
        }
        Some(best.0)
    }

    fn shade_mixed(&self, scene: &Scene, [u, v]: [f64; 2], numbers: &[u32; 4], out: &mut [f32]) {
        out.fill(0.0);
        for (k, number) in numbers.iter().enumerate() {
            let (du, dv) = (0.5 * (k % 2) as f64 - 0.25, 0.5 * (k / 2) as f64 - 0.25);
            if let Some(face) = self.faces.get(*number as usize) {
                let mut one = [0.0; 3];
                face.shade(scene, [u + du, v + dv], &mut one);
                (0..3).for_each(|c| out[c] += 0.25 * one[c]);
            }
        }
    }
}

impl Visible {
    pub(crate) fn new(face: &Face, eye: &Eye, distance: f64) -> Self {
        let (camera, camera_from_world) = (eye.camera, &eye.camera_from_world);
        let normal = camera_from_world.rotation * face.normal;
        // The plane is normal . X = -distance, so 1 / z = -(normal . ray) / distance.
        let inverse_depth = affine(&(normal / -distance), camera);
        let over_z = |k: usize| {
            let offset = face.axes[k].dot(&eye.centre) + face.offsets[k];
            let a = affine(&(camera_from_world.rotation * face.axes[k]), camera);
            [0, 1, 2].map(|i| a[i] + offset * inverse_depth[i])
        };
        Self {
            inverse_depth,
            s_over_z: over_z(0),
            t_over_z: over_z(1),
            light: face.light,
            texture: face.texture,
            infrared: face.infrared,
            mover: face.mover,
            surface: face.surface,
            thing: face.thing,
            plane_distance: distance as f32,
        }
    }

    fn shade(&self, scene: &Scene, [u, v]: [f64; 2], out: &mut [f32]) {
        let texture = scene.texture(self.texture);
        let start = |a: &Affine| (a[0] + a[1] * u + a[2] * v) as f32;
        let slope = |a: &Affine| [a[1] as f32, a[2] as f32];
        let (w0, [wu, wv]) = (start(&self.inverse_depth), slope(&self.inverse_depth));
        let (s0, [su, sv]) = (start(&self.s_over_z), slope(&self.s_over_z));
        let (t0, [tu, tv]) = (start(&self.t_over_z), slope(&self.t_over_z));
        let [l0, ls, lt] = self.light;
        // Values independent of the texture are computed for several pixels at once; pixel numbers are small integers, which floats
        // represent exactly.
        let mut first = 0.0;
        for pixels in out.chunks_mut(3 * AT_ONCE) {
            let mut at = [[0.0_f32; AT_ONCE]; 3];
            for (k, place) in PLACES.into_iter().enumerate() {
                let x = first + place;
                let z = 1.0 / (w0 + wu * x);
                let (s, t) = ((s0 + su * x) * z, (t0 + tu * x) * z);
                // Derivatives of s and t along u and v: the quotient rule.
                let (dsu, dsv) = ((su - s * wu) * z, (sv - s * wv) * z);
                let (dtu, dtv) = ((tu - t * wu) * z, (tv - t * wv) * z);
                let along_u = dsu * dsu + dtu * dtu;
                let along_v = dsv * dsv + dtv * dtv;
                at[0][k] = s;
                at[1][k] = t;
                at[2][k] = FOOTPRINT2 * along_u.max(along_v);
            }
            for (k, pixel) in pixels.chunks_exact_mut(3).enumerate() {
                let [s, t, footprint2] = [at[0][k], at[1][k], at[2][k]];
                let colour = texture.sample(s, t, footprint2);
                let light = (l0 + ls * s + lt * t) * (1.0 / 256.0);
                (0..3).for_each(|c| pixel[c] = colour[c] * light);
            }
            first += AT_ONCE as i32 as f32;
        }
    }

    /// Cosine of the angle between the face's normal and the line of sight to a point at depth `z` on a ray (x, y, 1) of length `ray`.
    #[inline]
    pub(crate) fn cosine(&self, z: f32, ray: f32) -> f32 {
        self.plane_distance / (z * ray)
    }

    /// Share of infrared light reflected from a point at depth `z` on a ray (x, y, 1) of length `ray`: Lambert's law, and for glossy black
    /// plastic a lobe of the fourth power of the cosine.
    #[inline]
    pub(crate) fn infrared_back(&self, z: f32, ray: f32) -> f32 {
        let cosine = self.cosine(z, ray);
        if self.infrared < GLOSSY {
            self.infrared * cosine * cosine * cosine * cosine
        } else {
            self.infrared * cosine
        }
    }
}

/// Diffuse infrared reflection below which faces are glossy.
const GLOSSY: f32 = 0.1;

/// Squared size of a texture sample relative to the longer side of a pixel's footprint; under 1, because the box filters of the mip levels
/// and the bilinear sampling add blur.
const FOOTPRINT2: f32 = 0.5;

/// `a . ray(u, v)` as an affine function of the pixel.
fn affine(a: &Vec3, camera: &Camera) -> Affine {
    let (au, av) = (a.x / camera.fx, a.y / camera.fy);
    [a.z - au * camera.cx - av * camera.cy, au, av]
}
