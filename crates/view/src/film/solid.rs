//! Renders the surface incrementally with a depth buffer: each triangle is drawn once, when it appears.

use super::camera::Viewpoint;
use crate::{Colour, Picture};
use stillpoint_geometry::Vec3;

/// Supersampling factor along each side, for smooth edges.
const FINE: usize = 2;
/// Ambient light, and light along the viewing direction.
const AMBIENT: f64 = 0.45;
const LIGHT: f64 = 0.65;

/// A surface as triangles, with the time at which each vertex appears.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// m, world.
    pub positions: &'a [[f32; 3]],
    /// Unit normals, one per position.
    pub normals: &'a [[f32; 3]],
    /// Red, green, blue, one per position.
    pub colours: &'a [[u8; 3]],
    /// Vertices of each triangle, counter-clockwise as seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Number of the image in which each position appears.
    pub since: &'a [u32],
}

pub(super) struct Solid {
    view: Viewpoint,
    fine: Picture,
    depth: Vec<f32>,
    /// Triangles by the image in which they appear, the next one last.
    waiting: Vec<(u32, [u32; 3])>,
}

/// A projected vertex: column, row, depth, and colour.
type Corner = ([f64; 3], [f64; 3]);

impl Solid {
    pub(super) fn new(
        surface: &Surface<'_>,
        view: &Viewpoint,
        (width, height): (usize, usize),
        ground: Colour,
    ) -> Self {
        let since = |t: &[u32; 3]| {
            let since = t.iter().filter_map(|i| surface.since.get(*i as usize));
            since.max().copied().unwrap_or(0)
        };
        let all = surface.triangles.iter().map(|t| (since(t), *t));
        let mut waiting: Vec<(u32, [u32; 3])> = all.collect();
        waiting.sort_by_key(|(since, _)| std::cmp::Reverse(*since));
        let (w, h) = (FINE * width, FINE * height);
        Self {
            view: view.scaled(FINE as f64),
            fine: Picture::new(w, h, ground),
            depth: vec![f32::INFINITY; w * h],
            waiting,
        }
    }

    /// The image with everything that is visible in image `number`.
    pub(super) fn picture(&mut self, surface: &Surface<'_>, number: u32) -> Picture {
        while let Some((_, triangle)) = self.waiting.pop_if(|(since, _)| *since <= number) {
            self.draw(surface, &triangle);
        }
        self.fine.halved()
    }

    fn draw(&mut self, surface: &Surface<'_>, triangle: &[u32; 3]) {
        let corners = triangle.map(|i| self.corner(surface, i as usize));
        let [Some((a, pa)), Some((b, pb)), Some((c, pc))] = corners else {
            return;
        };
        // Back faces are walls between the viewpoint and the room.
        if (pb - pa).cross(&(pc - pa)).dot(&(self.view.eye - pa)) <= 0.0 {
            return;
        }
        self.fill([a, b, c]);
    }

    fn corner(&self, surface: &Surface<'_>, i: usize) -> Option<(Corner, Vec3)> {
        let p = Vec3::from(surface.positions.get(i)?.map(f64::from));
        let n = Vec3::from(surface.normals.get(i)?.map(f64::from));
        let (x, y, z) = self.view.project(&p)?;
        let towards = (self.view.eye - p).try_normalize(1e-9)?;
        let light = AMBIENT + LIGHT * n.dot(&towards).max(0.0);
        let colour = surface.colours.get(i)?.map(|v| f64::from(v) * light);
        Some((([x, y, z], colour), p))
    }

    fn fill(&mut self, [a, b, c]: [Corner; 3]) {
        let (w, h) = (self.fine.width() as f64, self.fine.height() as f64);
        let range = |i: usize, end: f64| {
            let (p, q, r) = (a.0[i], b.0[i], c.0[i]);
            let low = p.min(q).min(r).ceil().clamp(0.0, end);
            let high = (p.max(q).max(r).floor() + 1.0).clamp(0.0, end);
            low as usize..high as usize
        };
        let cross = |p: &[f64; 3], q: &[f64; 3], x: f64, y: f64| {
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
        };
        let area = cross(&a.0, &b.0, c.0[0], c.0[1]);
        if area == 0.0 {
            return;
        }
        for y in range(1, h) {
            for x in range(0, w) {
                let (u, v) = (x as f64, y as f64);
                let shares = [
                    cross(&b.0, &c.0, u, v) / area,
                    cross(&c.0, &a.0, u, v) / area,
                    cross(&a.0, &b.0, u, v) / area,
                ];
                if shares.iter().any(|s| *s < 0.0) {
                    continue;
                }
                let mix = |of: fn(&Corner) -> f64| {
                    shares[0] * of(&a) + shares[1] * of(&b) + shares[2] * of(&c)
                };
                let z = mix(|p| p.0[2]) as f32;
                let at = y * self.fine.width() + x;
                if z < self.depth[at] {
                    self.depth[at] = z;
                    let colour = [mix(|p| p.1[0]), mix(|p| p.1[1]), mix(|p| p.1[2])];
                    // The casts saturate.
                    let [r, g, b] = colour.map(|v| (v + 0.5) as u8);
                    self.fine.blend(x as i64, y as i64, Colour(r, g, b), 1.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square that faces up (-y) at this height, and its colour.
    fn square(y: f32, colour: [u8; 3]) -> ([[f32; 3]; 4], [[u8; 3]; 4]) {
        let p = [[0.0, y, 0.0], [1.0, y, 0.0], [1.0, y, 1.0], [0.0, y, 1.0]];
        (p, [colour; 4])
    }

    #[test]
    fn triangles_appear_in_order_and_occlude() {
        let (floor, red) = square(1.0, [200, 0, 0]);
        let (top, blue) = square(0.5, [0, 0, 200]);
        let positions = [floor, top].concat();
        let colours = [red, blue].concat();
        let normals = [[0.0, -1.0, 0.0]; 8];
        let up = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let down = [[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]];
        let since = [0, 0, 0, 0, 2, 2, 2, 2];
        let whole: Vec<Vec3> = positions
            .iter()
            .map(|p| Vec3::from(p.map(f64::from)))
            .collect();
        let view = Viewpoint::fitting(&[], &whole, (&-Vec3::y(), &Vec3::z()), (80, 60));
        let middle = view.project(&Vec3::new(0.5, 0.5, 0.3)).unwrap();
        let (x, y) = (middle.0 as usize, middle.1 as usize);
        let drawn = |triangles: &[[u32; 3]], number| {
            let surface = Surface {
                positions: &positions,
                normals: &normals,
                colours: &colours,
                triangles,
                since: &since,
            };
            let mut solid = Solid::new(&surface, &view, (80, 60), Colour::BLACK);
            solid.picture(&surface, number).at(x, y).unwrap()
        };
        let (first, later) = (drawn(&up, 1), drawn(&up, 2));
        assert!(later.2 > 90 && later.0 == 0, "{later:?}");
        assert!(first.2 == 0, "{first:?}");
        // Back faces are not drawn.
        assert_eq!(drawn(&down, 2), Colour::BLACK);
        let count = |number| {
            let surface = Surface {
                positions: &positions,
                normals: &normals,
                colours: &colours,
                triangles: &up,
                since: &since,
            };
            let mut solid = Solid::new(&surface, &view, (80, 60), Colour::BLACK);
            let picture = solid.picture(&surface, number);
            picture.data().chunks_exact(3).filter(|p| p[0] > 60).count()
        };
        assert!(count(0) > 300, "{}", count(0));
    }
}
