//! Finds the floor.

use crate::mesh::Mesh;
use stillpoint_geometry::{Mat3, Vec3};

/// The plane of the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Unit normal, upwards, world.
    pub up: Vec3,
    /// Points `p` on it have `up . p = offset`, m.
    pub offset: f64,
}

/// Bin size of heights, m.
const STEP: f64 = 0.02;
/// Minimum area of a floor, m^2: less is a shelf.
const LEAST_AREA: f64 = 0.1;
/// Minimum area of a floor, as a share of the largest horizontal surface.
const LEAST_SHARE: f64 = 0.1;

impl Floor {
    /// The lowest large horizontal surface; `about_up` is the up direction within 45 degrees. `None` if there is none.
    #[must_use]
    pub fn find(mesh: &Mesh, about_up: &Vec3) -> Option<Self> {
        let mut up = about_up.try_normalize(1e-9)?;
        let pieces: Vec<(Vec3, Vec3)> = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| mesh.position(i));
                ((a + b + c) / 3.0, 0.5 * (b - a).cross(&(c - a)))
            })
            .collect();
        // All horizontal surfaces refine the up direction: tables, seats and the floor together.
        for least in [0.71, 0.86, 0.94, 0.97] {
            let level = |n: &Vec3| n.dot(&up) > least * n.norm();
            let sum: Vec3 = pieces.iter().map(|p| p.1).filter(level).sum();
            up = sum.try_normalize(1e-9)?;
        }
        let level: Vec<(Vec3, f64)> = pieces
            .iter()
            .map(|(p, n)| (*p, n.dot(&up), n.norm()))
            .filter(|(_, along, area)| *along > 0.9 * area)
            .map(|(p, _, area)| (p, area))
            .collect();
        let height = lowest(&level, &up)?;
        let mut floor = Self { up, offset: height };
        for reach in [0.06, 0.03] {
            floor = floor.fitted(&level, reach).unwrap_or(floor);
        }
        Some(floor)
    }

    /// Height of a point above it, m.
    #[must_use]
    pub fn height(&self, p: &Vec3) -> f64 {
        self.up.dot(p) - self.offset
    }

    /// Rotation from the world to axes of which the third is up; the first lies in the floor along the world's x, or z where x is up.
    #[must_use]
    pub fn level_from_world(&self) -> Mat3 {
        let along = if self.up.x.abs() < 0.9 {
            Vec3::x()
        } else {
            Vec3::z()
        };
        let x = (along - self.up * self.up.dot(&along)).normalize();
        let y = self.up.cross(&x);
        Mat3::from_rows(&[x.transpose(), y.transpose(), self.up.transpose()])
    }

    /// Least squares plane through the surface elements within `reach`.
    fn fitted(&self, level: &[(Vec3, f64)], reach: f64) -> Option<Self> {
        let turn = self.level_from_world();
        let near = level.iter().filter(|(p, _)| self.height(p).abs() < reach);
        let local: Vec<(Vec3, f64)> = near.map(|(p, a)| (turn * p, *a)).collect();
        let total: f64 = local.iter().map(|p| p.1).sum();
        let mean = local.iter().map(|(p, a)| p * *a).sum::<Vec3>() / total;
        let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (p, a) in &local {
            let d = p - mean;
            xx += a * d.x * d.x;
            xy += a * d.x * d.y;
            yy += a * d.y * d.y;
            xz += a * d.x * d.z;
            yz += a * d.y * d.z;
        }
        let det = xx * yy - xy * xy;
        // A strip does not determine the slope across it.
        if det <= 1e-6 * total * total || !det.is_finite() {
            return None;
        }
        let (a, b) = ((xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det);
        let up = (turn.transpose() * Vec3::new(-a, -b, 1.0)).normalize();
        Some(Self {
            up,
            offset: up.dot(&(turn.transpose() * mean)),
        })
    }
}

/// The height of the lowest large horizontal surface.
fn lowest(level: &[(Vec3, f64)], up: &Vec3) -> Option<f64> {
    let heights = level.iter().map(|(p, area)| (up.dot(p), area));
    let least = heights.clone().map(|h| h.0).fold(f64::INFINITY, f64::min);
    let most = heights
        .clone()
        .map(|h| h.0)
        .fold(f64::NEG_INFINITY, f64::max);
    if !(least.is_finite() && most - least < 1000.0) {
        return None;
    }
    let mut areas = vec![0.0; ((most - least) / STEP) as usize + 3];
    for (h, area) in heights {
        areas[((h - least) / STEP) as usize + 1] += area;
    }
    let around = |i: usize| areas[i - 1] + areas[i] + areas[i + 1];
    let last = areas.len() - 1;
    let largest = (1..last).map(around).fold(0.0, f64::max);
    let needed = LEAST_AREA.max(LEAST_SHARE * largest);
    let first = (1..last).find(|i| around(*i) >= needed)?;
    // The first bin with enough area may be the foot of the peak.
    let end = (first + 4).min(last);
    let at = (first..end).max_by(|a, b| around(*a).total_cmp(&around(*b)).then(b.cmp(a)))?;
    Some(least + (at as f64 - 0.5) * STEP)
}
