//! Visibility of convex planar faces in a pinhole view, by scan lines and a depth buffer on 1 / z (which is affine in the image). Colours
//! are in `shade`, noise is in `sensor`.

use crate::scene::Face;
use crate::shade::Visible;
use std::ops::Range;
use stillpoint_geometry::{Camera, Se3, Vec3};

/// Near plane, m.
const NEAR: f64 = 0.03;
/// The face number of a pixel without a face.
pub(crate) const NOTHING: u32 = u32::MAX;

pub(crate) struct Eye<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) camera_from_world: Se3,
    /// The camera's centre in the world, m.
    pub(crate) centre: Vec3,
}

/// The faces of one view, and the visible face of each sample in some rows.
pub(crate) struct View {
    pub(crate) width: usize,
    /// The sample rows drawn last, of the whole image.
    rows: Range<usize>,
    /// Number of sample rows of the whole image.
    whole: usize,
    /// Samples per pixel along each side.
    factor: usize,
    /// 1 / z of each sample, 1/m; 0 for no face.
    pub(crate) inverse_depth: Vec<f32>,
    /// Index in `faces`, or [`NOTHING`].
    pub(crate) face: Vec<u32>,
    pub(crate) faces: Vec<Visible>,
    shapes: Vec<Shape>,
    spans: Vec<[u32; 2]>,
    borders: Borders,
}

struct Shape {
    /// The sample rows that it covers.
    rows: Range<usize>,
    /// Index of the first of them in the view's `spans`, the covered samples of each row.
    first: usize,
    /// Its 1 / z over the samples, 1/m: constant, along rows, along columns.
    inverse_depth: [f64; 3],
}

/// The borders of a polygon by rows: scratch space.
#[derive(Default)]
struct Borders {
    polygon: Vec<[f64; 2]>,
    left: Vec<f64>,
    right: Vec<f64>,
}

impl View {
    /// The view of `faces` from a camera at `world_from_camera`, with `factor`^2 samples per pixel.
    pub(crate) fn new<'a>(
        faces: impl Iterator<Item = &'a Face>,
        camera: &Camera,
        world_from_camera: &Se3,
        factor: usize,
    ) -> Self {
        let rows = 0..camera.height as usize;
        let mut view = Self::blank(camera, factor);
        view.place(faces, camera, world_from_camera, rows.clone());
        view.draw(rows);
        view
    }

    /// An empty view, with `factor`^2 samples per pixel.
    pub(crate) fn blank(camera: &Camera, factor: usize) -> Self {
        Self {
            width: camera.width as usize * factor,
            rows: 0..0,
            whole: camera.height as usize * factor,
            factor,
            inverse_depth: Vec::new(),
            face: Vec::new(),
            faces: Vec::new(),
            shapes: Vec::new(),
            spans: Vec::new(),
            borders: Borders::default(),
        }
    }

    /// Replaces the faces by those that some rows of the image may show, without drawing.
    pub(crate) fn place<'a>(
        &mut self,
        faces: impl Iterator<Item = &'a Face>,
        camera: &Camera,
        world_from_camera: &Se3,
        rows: Range<usize>,
    ) {
        self.faces.clear();
        self.shapes.clear();
        self.spans.clear();
        let camera_from_world = world_from_camera.inverse();
        let eye = Eye {
            camera,
            centre: camera_from_world.inverse().translation,
            camera_from_world,
        };
        let rows = rows.start * self.factor..rows.end * self.factor;
        let mut borders = std::mem::take(&mut self.borders);
        let mut polygon = std::mem::take(&mut borders.polygon);
        for face in faces {
            let distance = face.normal.dot(&(eye.centre - face.vertices[0]));
            if distance < 1e-4 {
                continue;
            }
            project_clipped(
                &face.vertices,
                eye.camera,
                &eye.camera_from_world,
                &mut polygon,
            );
            if polygon.len() >= 3 && self.cover(&mut polygon, &rows, &mut borders) {
                self.show(Visible::new(face, &eye, distance));
            }
        }
        self.borders = Borders { polygon, ..borders };
    }

    /// Records the samples of some rows that a convex polygon covers, given in pixels. Returns whether there are any.
    fn cover(&mut self, polygon: &mut [[f64; 2]], rows: &Range<usize>, by: &mut Borders) -> bool {
        let k = self.factor as f64;
        for p in polygon.iter_mut() {
            *p = p.map(|v| (v + 0.5) * k - 0.5);
        }
        let Some(rows) = by.scan(polygon, rows, self.width) else {
            return false;
        };
        let first = self.spans.len();
        let borders = by.left.iter().zip(&by.right);
        let spans =
            borders.map(|(left, right)| [*left, *right].map(|v| up(v, 0..self.width) as u32));
        self.spans.extend(spans);
        let covers = self.spans[first..].iter().any(|[x0, x1]| x0 < x1);
        if covers {
            self.shapes.push(Shape {
                rows,
                first,
                inverse_depth: [0.0; 3],
            });
        } else {
            self.spans.truncate(first);
        }
        covers
    }

    /// Sets the appearance of the face placed last.
    fn show(&mut self, visible: Visible) {
        let k = self.factor as f64;
        let [c0, cu, cv] = visible.inverse_depth;
        // From samples to pixels: u = (x + 0.5) / k - 0.5.
        let offset = 0.5 / k - 0.5;
        if let Some(shape) = self.shapes.last_mut() {
            shape.inverse_depth = [c0 + (cu + cv) * offset, cu / k, cv / k];
        }
        self.faces.push(visible);
    }

    /// Draws some rows of the image, replacing those drawn before.
    pub(crate) fn draw(&mut self, rows: Range<usize>) {
        let (width, rows) = (self.width, rows.start * self.factor..rows.end * self.factor);
        self.inverse_depth.clear();
        self.inverse_depth.resize(width * rows.len(), 0.0);
        self.face.clear();
        self.face.resize(width * rows.len(), NOTHING);
        for (number, shape) in (0..).zip(&self.shapes) {
            let [start, du, dv] = shape.inverse_depth;
            for y in rows.start.max(shape.rows.start)..rows.end.min(shape.rows.end) {
                let [x0, x1] = self.spans[shape.first + y - shape.rows.start].map(|x| x as usize);
                if x0 >= x1 {
                    continue;
                }
                let row = (y - rows.start) * width;
                let w0 = (start + dv * y as f64 + du * x0 as f64) as f32;
                let depths = &mut self.inverse_depth[row + x0..row + x1];
                put(
                    depths,
                    &mut self.face[row + x0..row + x1],
                    [w0, du as f32],
                    number,
                );
            }
        }
        self.rows = rows;
    }

    /// The face number of a sample of the whole image.
    #[inline]
    pub(crate) fn face_at(&self, x: usize, y: usize) -> u32 {
        self.face[(y - self.rows.start) * self.width + x]
    }

    /// 1 / z (1/m) and faces of a row of samples of the whole image.
    #[inline]
    pub(crate) fn row(&self, y: usize) -> (&[f32], &[u32]) {
        let row = (y - self.rows.start) * self.width;
        let row = row..row + self.width;
        (&self.inverse_depth[row.clone()], &self.face[row])
    }

    pub(crate) fn whole(&self) -> usize {
        self.whole
    }
}

/// The first integer from `v` on, within a range.
#[inline]
fn up(v: f64, range: Range<usize>) -> usize {
    let v = v.clamp(range.start as f64, range.end as f64);
    let down = v as i32;
    (down + i32::from(v > f64::from(down))) as usize
}

impl Borders {
    /// The borders of a convex polygon in each of `rows` that it covers; `None` if it covers none, or nothing within `width`.
    fn scan(
        &mut self,
        polygon: &[[f64; 2]],
        rows: &Range<usize>,
        width: usize,
    ) -> Option<Range<usize>> {
        let bound = |v: f64| up(v, rows.clone());
        let (mut top, mut bottom, mut west, mut east) = (f64::MAX, f64::MIN, f64::MAX, f64::MIN);
        for p in polygon {
            (west, east) = (west.min(p[0]), east.max(p[0]));
            (top, bottom) = (top.min(p[1]), bottom.max(p[1]));
        }
        let covered = bound(top)..bound(bottom);
        if covered.is_empty() || east <= 0.0 || west >= width as f64 {
            return None;
        }
        self.left.clear();
        self.left.resize(covered.len(), f64::MAX);
        self.right.clear();
        self.right.resize(covered.len(), f64::MIN);
        let first = covered.start;
        for i in 0..polygon.len() {
            let (mut a, mut b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            if a[1] > b[1] {
                (a, b) = (b, a);
            }
            let slope = (b[0] - a[0]) / (b[1] - a[1]);
            let part = bound(a[1])..bound(b[1]);
            if part.is_empty() {
                continue;
            }
            let part_of = part.start - first..part.end - first;
            let borders = self.left[part_of.clone()]
                .iter_mut()
                .zip(&mut self.right[part_of]);
            for (y, (left, right)) in part.zip(borders) {
                let x = a[0] + (y as f64 - a[1]) * slope;
                *left = left.min(x);
                *right = right.max(x);
            }
        }
        Some(covered)
    }
}

/// Number of samples of a row compared at once, or of pixels shaded at once.
pub(crate) const AT_ONCE: usize = 8;

/// Draws a face into a part of a row with a depth test: its 1 / z is `start + step * i` at sample `i`.
#[inline]
fn put(depths: &mut [f32], faces: &mut [u32], [start, step]: [f32; 2], number: u32) {
    let one = |z: &mut f32, face: &mut u32, i: f32| {
        let w = start + step * i;
        let nearer = w > *z;
        *z = if nearer { w } else { *z };
        *face = if nearer { number } else { *face };
    };
    let (depths, depths_left) = depths.as_chunks_mut::<AT_ONCE>();
    let (faces, faces_left) = faces.as_chunks_mut::<AT_ONCE>();
    // Sample numbers are small integers, which floats represent exactly.
    let mut first = 0.0;
    for (z, face) in depths.iter_mut().zip(faces) {
        for k in 0..AT_ONCE {
            one(&mut z[k], &mut face[k], first + PLACES[k]);
        }
        first += AT_ONCE as i32 as f32;
    }
    for ((z, face), place) in depths_left.iter_mut().zip(faces_left).zip(PLACES) {
        one(z, face, first + place);
    }
}

/// Their indices.
pub(crate) const PLACES: [f32; AT_ONCE] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// The pixels of a polygon's part in front of the near plane.
fn project_clipped(
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
    fn slanted_face_has_exact_colour_and_depth() {
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
