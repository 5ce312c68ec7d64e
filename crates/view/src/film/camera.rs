//! Viewpoint of the surface.

use stillpoint_geometry::Vec3;

/// Pitch of the view below the horizon, rad, as when looking at a model on a table.
const PITCH: f64 = 0.70;
/// Free share of the panel at each border.
const MARGIN: f64 = 0.04;
/// Share of the surface points that may lie outside at each border.
const CUT: f64 = 0.03;
/// Focal length relative to the width of the panel: a field of view of 28 degrees, in which parallels hardly converge.
const FOCAL: f64 = 2.0;

/// A pinhole camera outside of the room.
#[derive(Clone, Copy, Debug)]
pub(super) struct Viewpoint {
    pub(super) eye: Vec3,
    right: Vec3,
    down: Vec3,
    forward: Vec3,
    focal: f64,
    centre: (f64, f64),
}

impl Viewpoint {
    /// Looks along a heading, from above, so that all points of `whole` are visible, and all but a few of `cut`.
    pub(super) fn fitting(
        cut: &[Vec3],
        whole: &[Vec3],
        (up, heading): (&Vec3, &Vec3),
        (width, height): (usize, usize),
    ) -> Self {
        let up = up.try_normalize(1e-9).unwrap_or_else(|| -Vec3::y());
        let level = heading - up * up.dot(heading);
        // A camera that looks straight down has no heading: any will do.
        let level = level
            .try_normalize(1e-6)
            .or_else(|| up.cross(&Vec3::x()).try_normalize(1e-6))
            .unwrap_or_else(Vec3::z);
        let forward = level * PITCH.cos() - up * PITCH.sin();
        let right = forward.cross(&up).normalize();
        let mut all = cut.to_vec();
        all.extend_from_slice(whole);
        let middle = all.iter().sum::<Vec3>() / all.len().max(1) as f64;
        let (w, h) = (width as f64, height as f64);
        let mut view = Self {
            eye: middle,
            right,
            down: forward.cross(&right),
            forward,
            focal: FOCAL * w,
            centre: (0.0, 0.0),
        };
        let room = ((1.0 - 2.0 * MARGIN) * w, (1.0 - 2.0 * MARGIN) * h);
        // Bisects the smallest distance from which everything fits, m.
        let (mut near, mut far) = (0.05, 1000.0);
        for _ in 0..40 {
            let distance = 0.5 * (near + far);
            view.eye = middle - forward * distance;
            match view.bounds(cut, whole) {
                Some(([x0, x1], [y0, y1])) if x1 - x0 <= room.0 && y1 - y0 <= room.1 => {
                    far = distance;
                }
                _ => near = distance,
            }
        }
        view.eye = middle - forward * far;
        if let Some(([x0, x1], [y0, y1])) = view.bounds(cut, whole) {
            view.centre = (0.5 * (w - x0 - x1), 0.5 * (h - y0 - y1));
        }
        view
    }

    /// Left and right, top and bottom of the visible range; `None` if a point is behind the camera.
    fn bounds(&self, cut: &[Vec3], whole: &[Vec3]) -> Option<([f64; 2], [f64; 2])> {
        let project = |points: &[Vec3]| -> Option<Vec<(f64, f64)>> {
            let seen = points.iter().map(|p| self.project(p));
            seen.map(|p| p.map(|(x, y, _)| (x, y))).collect()
        };
        let (cut, whole) = (project(cut)?, project(whole)?);
        let range = |of: fn(&(f64, f64)) -> f64| {
            let mut values: Vec<f64> = cut.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            let skip = (CUT * values.len() as f64) as usize;
            let inner = values.get(skip..values.len() - skip).unwrap_or_default();
            let inner = inner.iter().copied().chain(whole.iter().map(of));
            let ends = [f64::INFINITY, f64::NEG_INFINITY];
            let [a, b] = inner.fold(ends, |[a, b], v| [a.min(v), b.max(v)]);
            (a <= b).then_some([a, b])
        };
        Some((range(|p| p.0)?, range(|p| p.1)?))
    }

    /// Column and row, px, and depth, m; `None` behind the camera.
    pub(super) fn project(&self, p: &Vec3) -> Option<(f64, f64, f64)> {
        let ray = p - self.eye;
        let z = ray.dot(&self.forward);
        (z > 1e-3).then(|| {
            let scale = self.focal / z;
            let (x, y) = (ray.dot(&self.right), ray.dot(&self.down));
            (self.centre.0 + scale * x, self.centre.1 + scale * y, z)
        })
    }

    pub(super) fn focal(&self) -> f64 {
        self.focal
    }

    /// The same view for a panel scaled by a factor.
    pub(super) fn scaled(&self, by: f64) -> Self {
        Self {
            focal: self.focal * by,
            centre: (self.centre.0 * by, self.centre.1 * by),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viewpoint_fits_the_scene_to_the_panel() {
        let cut: Vec<Vec3> = (0..1000)
            .map(|i| {
                Vec3::new(
                    f64::from(i % 10),
                    f64::from(i / 100),
                    f64::from(i / 10 % 10),
                )
            })
            .collect();
        let whole = [Vec3::new(-3.0, 2.0, 4.0)];
        let up = -Vec3::y();
        let view = Viewpoint::fitting(&cut, &whole, (&up, &Vec3::z()), (400, 300));
        let inside = |p: &Vec3| {
            let (x, y, _) = view.project(p).unwrap();
            (0.0..400.0).contains(&x) && (0.0..300.0).contains(&y)
        };
        assert!(whole.iter().all(inside));
        let seen = cut.iter().filter(|p| inside(p)).count();
        assert!(seen > 850, "{seen}");
        // Up and right are preserved, and the view is from above.
        let at = |x, y, z| view.project(&Vec3::new(x, y, z)).unwrap();
        assert!(at(5.0, 1.0, 5.0).1 < at(5.0, 2.0, 5.0).1);
        assert!(at(6.0, 1.0, 5.0).0 > at(5.0, 1.0, 5.0).0);
        assert!(at(5.0, 1.0, 6.0).1 < at(5.0, 1.0, 5.0).1);
        assert!(view.eye.y < 0.0, "{}", view.eye);
    }

    #[test]
    fn empty_scene_gives_a_valid_viewpoint() {
        let view = Viewpoint::fitting(&[], &[], (&Vec3::zeros(), &Vec3::zeros()), (40, 30));
        assert!(view.eye.iter().all(|c| c.is_finite()));
        let down = Viewpoint::fitting(&[], &[Vec3::x()], (&Vec3::z(), &-Vec3::z()), (40, 30));
        assert!(down.project(&Vec3::x()).is_some());
    }
}
