//! Which face each pixel sees, and its depth there.
//!
//! Answers: visibility of convex planar faces in a pinhole view, by scan lines and a depth buffer on 1 / z (which is
//! affine in the image). Knows no colours (module `shade`) and no noise (module `sensor`).

use crate::scene::Face;
use crate::shade::Visible;
use std::ops::Range;
use stillpoint_geometry::{Camera, Se3, Vec3};

/// Faces nearer than this are cut off, m.
const NEAR: f64 = 0.03;
/// The face number of a pixel that sees nothing.
pub(crate) const NOTHING: u32 = u32::MAX;

/// Where a view is seen from.
pub(crate) struct Eye<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) camera_from_world: Se3,
    /// The camera's centre in the world, m.
    pub(crate) centre: Vec3,
}

/// The faces of one view, sample by sample: of the whole image, or of some of its rows.
pub(crate) struct View {
    pub(crate) width: usize,
    /// Rows of samples that there are.
    pub(crate) height: usize,
    /// The first of them.
    top: usize,
    /// Rows of samples of the whole image.
    whole: usize,
    /// Samples per pixel along each side.
    factor: usize,
    /// 1 / z of each sample, 1/m; 0 where nothing is seen.
    pub(crate) inverse_depth: Vec<f32>,
    /// Number of the face in `faces`, or [`NOTHING`].
    pub(crate) face: Vec<u32>,
    pub(crate) faces: Vec<Visible>,
    left: Vec<f64>,
    right: Vec<f64>,
}

impl View {
    /// Finds what a camera at `world_from_camera` sees of `faces`, with `factor`^2 samples per pixel.
    pub(crate) fn new<'a>(
        faces: impl Iterator<Item = &'a Face>,
        camera: &Camera,
        world_from_camera: &Se3,
        factor: usize,
    ) -> Self {
        let rows = 0..camera.height as usize;
        Self::of_rows(faces, camera, world_from_camera, factor, rows)
    }

    /// The same of some rows of the image alone.
    pub(crate) fn of_rows<'a>(
        faces: impl Iterator<Item = &'a Face>,
        camera: &Camera,
        world_from_camera: &Se3,
        factor: usize,
        rows: Range<usize>,
    ) -> Self {
        let (width, height) = (camera.width as usize * factor, rows.len() * factor);
        let mut view = Self {
            width,
            height,
            top: rows.start * factor,
            whole: camera.height as usize * factor,
            factor,
            inverse_depth: vec![0.0; width * height],
            face: vec![NOTHING; width * height],
            faces: Vec::new(),
            left: vec![0.0; height],
            right: vec![0.0; height],
        };
        let camera_from_world = world_from_camera.inverse();
        let eye = Eye {
            camera,
            centre: camera_from_world.inverse().translation,
            camera_from_world,
        };
        let mut polygon = Vec::new();
        for face in faces {
            view.draw(face, &eye, &mut polygon);
        }
        view
    }

    fn draw(&mut self, face: &Face, eye: &Eye, polygon: &mut Vec<[f64; 2]>) {
        let distance = face.normal.dot(&(eye.centre - face.vertices[0]));
        if distance < 1e-4 {
            return;
        }
        project_clipped(&face.vertices, eye.camera, &eye.camera_from_world, polygon);
        if polygon.len() < 3 {
            return;
        }
        let k = self.factor as f64;
        for p in polygon.iter_mut() {
            *p = p.map(|v| (v + 0.5) * k - 0.5);
        }
        let Some(rows) = self.scan(polygon) else {
            return;
        };
        let visible = Visible::new(face, eye, distance);
        let number = self.faces.len() as u32;
        let [c0, cu, cv] = visible.inverse_depth;
        // From samples to pixels: u = (x + 0.5) / k - 0.5.
        let offset = 0.5 / k - 0.5;
        let (start, du, dv) = (c0 + (cu + cv) * offset, cu / k, cv / k);
        let mut seen = false;
        for y in rows {
            let bound = |v: f64| v.ceil().clamp(0.0, self.width as f64) as usize;
            let (x0, x1) = (
                bound(self.left[y - self.top]),
                bound(self.right[y - self.top]),
            );
            if x0 >= x1 {
                continue;
            }
            let row = (y - self.top) * self.width;
            let w0 = (start + dv * y as f64 + du * x0 as f64) as f32;
            let du = du as f32;
            let depths = &mut self.inverse_depth[row + x0..row + x1];
            let numbers = &mut self.face[row + x0..row + x1];
            seen |= put(depths, numbers, [w0, du], number);
        }
        if seen {
            self.faces.push(visible);
        }
    }

    /// Fills `left` and `right` with the borders of a convex polygon for each row that it covers.
    fn scan(&mut self, polygon: &[[f64; 2]]) -> Option<Range<usize>> {
        let (first, end) = (self.top, self.top + self.height);
        let bound = |v: f64| v.ceil().clamp(first as f64, end as f64) as usize;
        let (mut top, mut bottom, mut west, mut east) = (f64::MAX, f64::MIN, f64::MAX, f64::MIN);
        for p in polygon {
            (west, east) = (west.min(p[0]), east.max(p[0]));
            (top, bottom) = (top.min(p[1]), bottom.max(p[1]));
        }
        let rows = bound(top)..bound(bottom);
        if rows.is_empty() || east <= 0.0 || west >= self.width as f64 {
            return None;
        }
        self.left[rows.start - first..rows.end - first].fill(f64::MAX);
        self.right[rows.start - first..rows.end - first].fill(f64::MIN);
        for i in 0..polygon.len() {
            let (mut a, mut b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            if a[1] > b[1] {
                (a, b) = (b, a);
            }
            let slope = (b[0] - a[0]) / (b[1] - a[1]);
            for y in bound(a[1])..bound(b[1]) {
                let x = a[0] + (y as f64 - a[1]) * slope;
                let y = y - first;
                self.left[y] = self.left[y].min(x);
                self.right[y] = self.right[y].max(x);
            }
        }
        Some(rows)
    }

    /// The number of the face that a sample of the whole image sees.
    #[inline]
    pub(crate) fn face_at(&self, x: usize, y: usize) -> u32 {
        self.face[(y - self.top) * self.width + x]
    }

    /// 1 / z (1/m) and faces of a row of samples of the whole image.
    #[inline]
    pub(crate) fn row(&self, y: usize) -> (&[f32], &[u32]) {
        let row = (y - self.top) * self.width;
        let row = row..row + self.width;
        (&self.inverse_depth[row.clone()], &self.face[row])
    }

    /// Rows of samples of the whole image.
    pub(crate) fn whole(&self) -> usize {
        self.whole
    }
}

/// Samples of a row that are compared at once.
const AT_ONCE: usize = 8;

/// Puts a face into a part of a row, in front of what is farther: its 1 / z is `start + step * i` at sample `i`. Whether any of it is seen.
#[inline]
fn put(depths: &mut [f32], faces: &mut [u32], [start, step]: [f32; 2], number: u32) -> bool {
    let mut seen = 0;
    let mut one = |z: &mut f32, face: &mut u32, i: i32| {
        let w = start + step * i as f32;
        let nearer = w > *z;
        *z = if nearer { w } else { *z };
        *face = if nearer { number } else { *face };
        seen |= u32::from(nearer);
    };
    let (depths, depths_left) = depths.as_chunks_mut::<AT_ONCE>();
    let (faces, faces_left) = faces.as_chunks_mut::<AT_ONCE>();
    let mut first = 0;
    for (z, face) in depths.iter_mut().zip(faces) {
        for k in 0..AT_ONCE {
            one(&mut z[k], &mut face[k], first + k as i32);
        }
        first += AT_ONCE as i32;
    }
    for (k, (z, face)) in depths_left.iter_mut().zip(faces_left).enumerate() {
        one(z, face, first + k as i32);
    }
    seen != 0
}

/// The pixels of a polygon's part in front of the near plane.
pub(crate) fn project_clipped(
    vertices: &[Vec3],
    camera: &Camera,
    camera_from_world: &Se3,
    out: &mut Vec<[f64; 2]>,
) {
    out.clear();
    let mut push = |p: &Vec3| {
        let px = camera.project(p);
        out.push([px.x, px.y]);
    };
    let Some(last) = vertices.last() else {
        return;
    };
    let mut a = camera_from_world.transform(last);
    for vertex in vertices {
        let b = camera_from_world.transform(vertex);
        if (a.z >= NEAR) != (b.z >= NEAR) {
            push(&(a + (b - a) * ((NEAR - a.z) / (b.z - a.z))));
        }
        if b.z >= NEAR {
            push(&b);
        }
        a = b;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Lens;
    use crate::scene::Scene;
    use crate::texture::tests::ramp;
    use stillpoint_geometry::{Vec2, so3};

    #[test]
    fn a_slanted_face_has_its_colour_and_depth_at_whole_pixels() {
        let camera = Camera::pinhole(640, 480, [535.0, 530.0, 319.5, 239.5]);
        let lens = Lens::new(&camera);
        let pose = Se3::new(
            so3::exp(&Vec3::new(0.2, -0.5, 0.1)),
            Vec3::new(0.1, -0.05, 0.2),
        );
        let (corner, right, up) = (
            Vec3::new(-0.3, 0.25, 1.6),
            Vec3::x() * 0.64,
            Vec3::y() * -0.64,
        );
        let normal = right.cross(&up).normalize();
        let face = Face::quad(corner, right, up);
        let (axes, offsets) = (face.axes, face.offsets);
        let scene = Scene::of(vec![face], ramp());
        let (fine, coarse) = (
            View::new(scene.fixed().iter(), &camera, &pose, 2),
            View::new(scene.fixed().iter(), &camera, &pose, 1),
        );
        let (mut errors, mut n) = ([0.0; 2], 0.0);
        for v in 0..480 {
            let mut row = vec![0.0; 3 * 640];
            fine.shade_row(&scene, &lens, v, &mut row);
            for u in 0..640 {
                let ray = pose.rotation * camera.ray(Vec2::new(u as f64, v as f64));
                let z = normal.dot(&(corner - pose.translation)) / normal.dot(&ray);
                let p = pose.translation + ray * z;
                let [s, t] = [0, 1].map(|k| axes[k].dot(&p) + offsets[k]);
                let inside = |m: f64| (m..64.0 - m).contains(&s) && (m..64.0 - m).contains(&t);
                let seen = coarse.inverse_depth[v * 640 + u];
                assert_eq!(seen > 0.0, inside(0.0), "at {u} {v}");
                if inside(2.0) {
                    assert!((f64::from(seen) * z - 1.0).abs() < 1e-5);
                    errors[0] += f64::from(row[3 * u]) - (2.0 * s - 1.0);
                    errors[1] += f64::from(row[3 * u + 1]) - (3.0 * t - 1.5);
                    n += 1.0;
                }
            }
        }
        // A texel is about 3 px: these are errors of some hundredths of a pixel.
        assert!(
            n > 10_000.0 && (errors[0] / n).abs() < 0.04 && (errors[1] / n).abs() < 0.06,
            "{errors:?} of {n}"
        );
    }
}
