//! Accuracy of surfaces.

use super::{Scene, chosen};
use crate::Failure;
use crate::table::{self, Table, figure};
use stillpoint::geometry::Vec3;
use stillpoint::simulator::{Simulator, SimulatorConfig, Surfaces};

pub(super) struct Judge {
    faces: Surfaces,
    measured: Vec<Vec3>,
    table: Table,
}

impl Judge {
    pub(super) fn new(scene: &Scene) -> Result<Self, Failure> {
        let header = "surface | points | mean, mm | median | 95 % | 99 % | farther than 10 cm, % | complete, % | of";
        Ok(Self {
            faces: Surfaces::new(scene.simulator()?.static_surfaces()),
            measured: measured(scene, 0.04)?,
            table: Table::new(header.split(" | ")),
        })
    }

    /// Adds a row: distances to the true surface, and completeness.
    pub(super) fn add(&mut self, surface: &str, points: &[Vec3]) {
        let mut distances: Vec<f64> = points.iter().map(|p| self.faces.distance(p)).collect();
        let far = distances.iter().filter(|d| **d > 0.1).count();
        distances.sort_by(f64::total_cmp);
        let n = distances.len().max(1);
        let mean = distances.iter().sum::<f64>() / n as f64;
        let at = |share: f64| distances.get((share * n as f64) as usize).copied();
        let (seen, found) = completeness(&self.measured, points);
        let quantiles = [0.5, 0.95, 0.99].map(|s| figure(1e3 * at(s).unwrap_or(0.0), 2));
        let [median, most, nearly_all] = quantiles;
        self.table.row([
            surface.to_owned(),
            points.len().to_string(),
            figure(1e3 * mean, 2),
            median,
            most,
            nearly_all,
            figure(100.0 * far as f64 / n as f64, 4),
            figure(100.0 * found as f64 / seen.max(1) as f64, 2),
            seen.to_string(),
        ]);
    }

    pub(super) fn print(&self) {
        table::print(&self.table);
    }
}

/// Measured points of the true surface, and those with a point of the map within 2 cm.
fn completeness(truth: &[Vec3], points: &[Vec3]) -> (usize, usize) {
    let cell = |p: &Vec3| <[i32; 3]>::from(p.map(|v| (v / 0.02).floor() as i32));
    let mut cells: Vec<([i32; 3], usize)> = points
        .iter()
        .enumerate()
        .map(|(i, p)| (cell(p), i))
        .collect();
    cells.sort_unstable();
    let near = |p: &Vec3| {
        let [x, y, z] = cell(p);
        (0..27).any(|k| {
            let c = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
            let from = cells.partition_point(|e| e.0 < c);
            cells[from..]
                .iter()
                .take_while(|e| e.0 == c)
                .any(|e| (points[e.1] - p).norm() <= 0.02)
        })
    };
    (truth.len(), truth.iter().filter(|p| near(p)).count())
}

/// Points of the true surface, `apart` m from each other, that were measured in at least three frames.
pub(super) fn measured(scene: &Scene, apart: f64) -> Result<Vec<Vec3>, Failure> {
    let sim = scene.simulator()?;
    let ideal = Simulator::new(&SimulatorConfig {
        scene: scene.name.clone(),
        frames: scene.frames,
        noise: false,
        ..SimulatorConfig::default()
    })?;
    let mut points = samples(&sim.static_surfaces(), apart);
    for i in chosen(&sim) {
        let (depth, sight, camera) = (sim.depth(i), ideal.depth(i), sim.camera());
        let moving = sim.truth(i).mask;
        let pose = sim.world_from_camera(sim.depth_stamp(i));
        let from_world = pose.inverse();
        for point in points.iter_mut().filter(|p| p.seen < 3) {
            let q = from_world.transform(&point.position);
            let px = camera.project_distorted(&q);
            // Skips back faces.
            let faces = point.normal.dot(&(pose.translation - point.position)) > 0.0;
            if !faces || q.z < 0.35 || q.z > 3.9 || !camera.contains(px) {
                continue;
            }
            let (x, y) = ((px.x + 0.5) as usize, (px.y + 0.5) as usize);
            let (x, y) = (x.min(depth.width() - 1), y.min(depth.height() - 1));
            let off = |d: f32| (f64::from(d) - q.z).abs();
            // The point is visible at the pixel, and was measured.
            let near = off(sight.at(x, y)) < 0.005 + 0.003 * q.z && off(depth.at(x, y)) < 0.1;
            point.seen += u8::from(near && moving.at(x, y) == 0);
        }
    }
    let seen = points.iter().filter(|p| p.seen >= 3);
    Ok(seen.map(|p| p.position).collect())
}

struct Sample {
    position: Vec3,
    normal: Vec3,
    seen: u8,
}

/// Points of the true surfaces, on a grid of spacing `apart`, m.
fn samples(faces: &[Vec<Vec3>], apart: f64) -> Vec<Sample> {
    let mut points = Vec::new();
    for face in faces {
        let normal = (face[1] - face[0]).cross(&(face[2] - face[0])).normalize();
        let whole = Surfaces::new(vec![face.clone()]);
        let u = (face[1] - face[0]).normalize();
        let v = normal.cross(&u);
        let at = |p: &Vec3| [(p - face[0]).dot(&u), (p - face[0]).dot(&v)];
        let all: Vec<[f64; 2]> = face.iter().map(at).collect();
        let low = [0, 1].map(|k| all.iter().map(|a| a[k]).fold(f64::INFINITY, f64::min));
        let high = [0, 1].map(|k| all.iter().map(|a| a[k]).fold(f64::NEG_INFINITY, f64::max));
        let steps = [0, 1].map(|k| ((high[k] - low[k]) / apart) as usize + 1);
        for k in 0..steps[0] * steps[1] {
            let along = |axis: usize, k: usize| low[axis] + apart * (k as f64 + 0.5);
            let (a, b) = (along(0, k % steps[0]), along(1, k / steps[0]));
            let position = face[0] + u * a + v * b;
            if whole.distance(&position) < 1e-6 {
                points.push(Sample {
                    position,
                    normal,
                    seen: 0,
                });
            }
        }
    }
    points
}
