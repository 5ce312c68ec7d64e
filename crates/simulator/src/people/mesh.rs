//! Closed triangle meshes with smooth normals and a wrapped texture, for the rigid parts of a body.

use super::Asked;
use crate::scene::{Corners, Face, Light};
use stillpoint_geometry::{Se3, Vec3};

#[derive(Clone, Copy)]
pub(crate) struct Ring {
    /// Position along the part's axis, m.
    pub(crate) at: f64,
    /// Centre across the axis, m.
    pub(crate) centre: [f64; 2],
    /// Half axes of its superellipse, m.
    pub(crate) radius: [f64; 2],
}

/// A ring about the axis.
pub(crate) const fn ring(at: f64, rx: f64, ry: f64) -> Ring {
    off_axis(at, 0.0, rx, ry)
}

/// A ring whose centre is shifted along x.
pub(crate) const fn off_axis(at: f64, x: f64, rx: f64, ry: f64) -> Ring {
    Ring {
        at,
        centre: [x, 0.0],
        radius: [rx, ry],
    }
}

/// How a texture is wrapped around a part.
#[derive(Clone, Copy)]
pub(crate) struct Winding {
    /// Texels once around; the seam is at the back (-x).
    pub(crate) around: f64,
    /// Texels per metre along the axis.
    pub(crate) along: f64,
    /// Texel row of the first ring.
    pub(crate) first: f64,
}

#[derive(Clone, Copy)]
struct Vertex {
    at: Vec3,
    normal: Vec3,
    texel: [f64; 2],
}

pub(crate) struct Mesh {
    vertices: Vec<Vertex>,
    triangles: Vec<[usize; 3]>,
    /// Corners of its axis-aligned bounding box.
    bounds: [Vec3; 2],
}

#[derive(Clone, Copy)]
pub(crate) struct Cover {
    pub(crate) texture: u16,
    pub(crate) infrared: f32,
    pub(crate) mover: u8,
    pub(crate) surface: u16,
}

impl Mesh {
    /// A tube through rings, listed from top (greatest z) to bottom, closed at both ends; `sides` vertices per ring. Its cross-sections are
    /// superellipses of exponent `power`: 2 is an ellipse, more is closer to a rectangle.
    pub(crate) fn tube(rings: &[Ring], sides: usize, power: f64, winding: Winding) -> Self {
        let mut vertices = Vec::new();
        let columns = sides + 1;
        let mut rows = Vec::with_capacity(rings.len() + 2);
        let end = |r: &Ring| Ring {
            radius: [0.0; 2],
            ..*r
        };
        rows.extend(rings.first().map(end));
        rows.extend_from_slice(rings);
        rows.extend(rings.last().map(end));
        let mut along = winding.first;
        for (i, r) in rows.iter().enumerate() {
            if i > 0 {
                let before = rows[i - 1];
                let step = libm::hypot(r.at - before.at, r.radius[0] - before.radius[0]);
                along += step * winding.along;
            }
            for j in 0..columns {
                let share = j as f64 / sides as f64;
                // From the back around the left (+y), as seen from above.
                let angle = std::f64::consts::TAU * share;
                let (c, s) = (-libm::cos(angle), -libm::sin(angle));
                let round = |v: f64| v.signum() * libm::pow(v.abs(), 2.0 / power);
                let at = Vec3::new(
                    r.centre[0] + r.radius[0] * round(c),
                    r.centre[1] + r.radius[1] * round(s),
                    r.at,
                );
                vertices.push(Vertex {
                    at,
                    normal: Vec3::zeros(),
                    texel: [winding.around * share, along],
                });
            }
        }
        let mut mesh = Self::new(vertices);
        mesh.stitch(rows.len(), sides);
        mesh
    }

    fn new(vertices: Vec<Vertex>) -> Self {
        let far = Vec3::repeat(f64::INFINITY);
        let points = vertices.iter().map(|v| v.at);
        Self {
            bounds: points.fold([far, -far], |[a, b], p| [a.inf(&p), b.sup(&p)]),
            vertices,
            triangles: Vec::new(),
        }
    }

    /// Corners of its axis-aligned bounding box.
    pub(crate) fn bounds(&self) -> [Vec3; 2] {
        self.bounds
    }

    pub(crate) fn moved(mut self, by: [f64; 3]) -> Self {
        for at in self
            .vertices
            .iter_mut()
            .map(|v| &mut v.at)
            .chain(&mut self.bounds)
        {
            *at += Vec3::from(by);
        }
        self
    }

    /// A box about the origin with a whole texture on each side.
    pub(crate) fn cuboid(half: [f64; 3], texels: f64) -> Self {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()];
        for k in 0..6 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let out = axes[k / 2] * sign;
            let up = if k / 2 == 2 { Vec3::x() } else { Vec3::z() };
            let right = up.cross(&out);
            let first = vertices.len();
            for (s, t) in [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)] {
                let p = out + right * (2.0 * s - 1.0) + up * (1.0 - 2.0 * t);
                vertices.push(Vertex {
                    at: Vec3::new(p.x * half[0], p.y * half[1], p.z * half[2]),
                    normal: out,
                    texel: [s * texels, t * texels],
                });
            }
            triangles.push([first, first + 1, first + 2]);
            triangles.push([first, first + 2, first + 3]);
        }
        Self {
            triangles,
            ..Self::new(vertices)
        }
    }

    /// Adds the triangles between rows of vertices, with smooth normals.
    fn stitch(&mut self, rows: usize, sides: usize) {
        let columns = sides + 1;
        let mut normals = vec![Vec3::zeros(); rows * sides];
        for i in 0..rows - 1 {
            for j in 0..sides {
                let (a, b) = (i * columns + j, (i + 1) * columns + j);
                for t in [[a, b, b + 1], [a, b + 1, a + 1]] {
                    let [p, q, r] = t.map(|k| self.vertices[k].at);
                    let normal = (q - p).cross(&(r - p));
                    // The fans at both ends have one empty triangle per side.
                    if normal.norm_squared() < 1e-16 {
                        continue;
                    }
                    self.triangles.push(t);
                    for k in t {
                        normals[k / columns * sides + k % columns % sides] += normal;
                    }
                }
            }
        }
        // The vertices at a fan's centre are one point.
        for row in [0, rows - 1] {
            let mut sum = Vec3::zeros();
            (0..sides).for_each(|j| sum += normals[row * sides + j]);
            (0..sides).for_each(|j| normals[row * sides + j] = sum);
        }
        for (k, v) in self.vertices.iter_mut().enumerate() {
            v.normal = normals[k / columns * sides + k % columns % sides].normalize();
        }
    }

    /// Adds the requested faces at a pose in the world, lit there.
    pub(crate) fn place(
        &self,
        pose: &Se3,
        cover: Cover,
        light: &Light,
        asked: &mut dyn Asked,
        out: &mut Vec<Face>,
    ) {
        let turn = pose.rotation_matrix();
        let place = |p: &Vec3| turn * p + pose.translation;
        let corner = |k: usize| {
            let of = |axis: usize| self.bounds[(k >> axis) & 1][axis];
            place(&Vec3::new(of(0), of(1), of(2)))
        };
        if !asked.about(&std::array::from_fn(corner)) {
            return;
        }
        let placed: Vec<Vec3> = self.vertices.iter().map(|v| place(&v.at)).collect();
        let mut lit: Vec<Option<f64>> = vec![None; placed.len()];
        for t in &self.triangles {
            let corners = t.map(|k| placed[k]);
            let across = across(&corners);
            if !asked.asks(&corners, &across.normalize()) {
                continue;
            }
            let light = t.map(|k| {
                let normal = &self.vertices[k].normal;
                *lit[k].get_or_insert_with(|| light.brightness(&placed[k], &(turn * normal)))
            });
            let texels = t.map(|k| self.vertices[k].texel);
            out.push(triangle(corners, across, texels, light, cover));
        }
    }
}

/// A triangle's normal, with twice its area as length.
fn across(p: &[Vec3; 3]) -> Vec3 {
    (p[1] - p[0]).cross(&(p[2] - p[0]))
}

/// A face from its corners, the normal `n` of [`across`], and their texels and brightnesses: all three are affine in the plane.
fn triangle(p: [Vec3; 3], n: Vec3, texels: [[f64; 2]; 3], light: [f64; 3], cover: Cover) -> Face {
    let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
    let (g1, g2) = (
        e2.cross(&n) / n.norm_squared(),
        n.cross(&e1) / n.norm_squared(),
    );
    let d = [0, 1].map(|k| [texels[1][k] - texels[0][k], texels[2][k] - texels[0][k]]);
    let axes = d.map(|[d1, d2]| g1 * d1 + g2 * d2);
    let offsets = [0, 1].map(|k| texels[0][k] - axes[k].dot(&p[0]));
    let [[s1, s2], [t1, t2]] = d;
    let det = s1 * t2 - s2 * t1;
    let (l1, l2) = (light[1] - light[0], light[2] - light[0]);
    let light = if det.abs() > 1e-6 {
        let (ls, lt) = ((l1 * t2 - l2 * t1) / det, (l2 * s1 - l1 * s2) / det);
        [light[0] - ls * texels[0][0] - lt * texels[0][1], ls, lt]
    } else {
        [(light[0] + light[1] + light[2]) / 3.0, 0.0, 0.0]
    };
    Face {
        vertices: Corners::Triangle(p),
        normal: n.normalize(),
        texture: cover.texture,
        axes,
        offsets,
        light: light.map(|l| l as f32),
        infrared: cover.infrared,
        mover: cover.mover,
        surface: cover.surface,
        thing: 0,
    }
}
