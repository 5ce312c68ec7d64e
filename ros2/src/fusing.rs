//! Surface and floor plan while a run goes on.

use crate::options::Options;
use crate::outlet::Decided;
use crate::outputs::Outputs;
use crate::record::Recorder;
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint::dense::{
    Dense, DenseConfig, Floor, Mesh, MeshOptions, Occupancy, Plan, PlanOptions,
};
use stillpoint::geometry::{Camera, Se3, Vec3};
use stillpoint::imaging::Simd;
use stillpoint::ros_events::{Mount, Outgoing, Publisher};
use stillpoint::slam::{Event, Subscriber};

/// Fuses the frames of a run, and publishes what there is from time to time.
pub struct Fusing {
    dense: Dense,
    publisher: Publisher,
    decided: Decided,
    mount: Option<Mount>,
    outputs: Arc<Outputs>,
    recorder: Option<Recorder>,
    period: f64,
    spacing: f64,
    /// Stamp of what was published last, s.
    last: Option<f64>,
}

impl Fusing {
    /// Of a run of a camera that begins with a map of so many ids of keyframes.
    ///
    /// # Errors
    /// A distance of voxels that cannot be.
    pub fn new(
        publisher: Publisher,
        (decided, outputs): (&Decided, &Arc<Outputs>),
        recorder: Option<Recorder>,
        options: &Options,
        (camera, ids): (&Camera, usize),
    ) -> Result<Self, String> {
        let config = DenseConfig {
            voxel: options.dense_voxel,
            ..DenseConfig::default()
        };
        let dense = Dense::new(&config, camera, Simd::detect());
        let dense = dense.map_err(|e| format!("dense_voxel: {e}"))?;
        Ok(Self {
            dense: dense.with_first_keyframe(ids),
            publisher,
            decided: Arc::clone(decided),
            mount: None,
            outputs: Arc::clone(outputs),
            recorder,
            period: options.dense_period,
            spacing: options.surface_spacing,
            last: None,
        })
    }

    fn begin(&mut self) {
        if self.mount.is_none()
            && let Some(mounting) = self.decided.get()
        {
            self.mount = Some(mounting.mount.unwrap_or_default());
            self.publisher = mounting.apply(self.publisher.clone());
        }
    }

    fn send(&self, message: &Outgoing) {
        self.outputs.send(message);
        if let Some(recorder) = &self.recorder {
            recorder.found(message);
        }
    }

    fn publish(&self) {
        let Some(mount) = &self.mount else { return };
        let map = self.dense.map();
        let mesh = map.mesh(&MeshOptions::default());
        if mesh.triangles.is_empty() {
            return;
        }
        self.send(&self.publisher.surface(&thinned(&mesh, self.spacing)));
        let floor = Floor::find(&mesh, &mount.up());
        if let Some(plan) = floor.and_then(|f| map.plan(&f, &PlanOptions::default())) {
            let grid = flat(&plan, &self.publisher.map_from_world());
            let message =
                self.publisher
                    .grid(grid.width, plan.resolution, &grid.origin, grid.cells);
            self.send(&message);
        }
    }

    /// Publishes what there is in the end.
    pub fn finish(mut self) {
        self.begin();
        if self.last.is_some() {
            self.publish();
        }
    }
}

impl Subscriber for Fusing {
    fn receive(&mut self, event: &Event) {
        self.begin();
        self.dense.receive(event);
        let Some(stamp) = event.as_frame().map(|f| f.report.stamp) else {
            return;
        };
        self.publisher.at(stamp);
        let first = *self.last.get_or_insert(stamp);
        if (stamp - first).abs() >= self.period {
            self.last = Some(stamp);
            self.publish();
        }
    }
}

/// One point of each cube of this side (m): the first of the mesh, so that the same mesh gives the same points.
fn thinned(mesh: &Mesh, side: f64) -> Vec<([f32; 3], [u8; 3])> {
    let mut taken = BTreeMap::new();
    for (i, p) in mesh.positions.iter().enumerate() {
        let cube = p.map(|x| (f64::from(x) / side).floor() as i64);
        let colour = mesh.colours.get(i).copied().unwrap_or([200; 3]);
        taken.entry(cube).or_insert((*p, colour));
    }
    taken.into_values().collect()
}

/// A plan in the axes of the map, since those who drive by grids do not turn them.
struct Flat {
    width: u32,
    origin: Vec3,
    cells: Vec<i8>,
}

fn flat(plan: &Plan, map_from_world: &Se3) -> Flat {
    let side = plan.resolution;
    let world_from_level = plan.floor.level_from_world().transpose();
    let at = |i: f64, j: f64| {
        let [x, y] = plan.origin;
        let level = Vec3::new(x + i * side, y + j * side, plan.floor.offset);
        map_from_world.transform(&(world_from_level * level))
    };
    let (w, h) = (plan.width as f64, plan.height as f64);
    let corners = [at(0.0, 0.0), at(w, 0.0), at(0.0, h), at(w, h)];
    let low = |k: usize| corners.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
    let high = |k: usize| {
        corners
            .iter()
            .map(|c| c[k])
            .fold(f64::NEG_INFINITY, f64::max)
    };
    // Cells at whole multiples of their side: grids of one run fit on each other.
    let first = [0, 1].map(|k| (low(k) / side).floor());
    let cells_along = [0, 1].map(|k| ((high(k) / side).ceil() - first[k]).max(1.0) as usize);
    let height = corners.iter().map(|c| c.z).sum::<f64>() / 4.0;
    let world_from_map = map_from_world.inverse();
    let mut cells = Vec::with_capacity(cells_along[0] * cells_along[1]);
    for j in 0..cells_along[1] {
        for i in 0..cells_along[0] {
            let p = Vec3::new(
                (first[0] + i as f64 + 0.5) * side,
                (first[1] + j as f64 + 0.5) * side,
                height,
            );
            cells.push(match plan.at(&world_from_map.transform(&p)) {
                Occupancy::Occupied => 100,
                Occupancy::Free => 0,
                Occupancy::Unknown => -1,
            });
        }
    }
    Flat {
        width: cells_along[0] as u32,
        origin: Vec3::new(first[0] * side, first[1] * side, height),
        cells,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_lies_in_the_axes_of_the_map() {
        // A camera that looks along x of the map, with y down: the floor is 1 m below.
        let up = -Vec3::y();
        let floor = Floor { up, offset: -1.0 };
        let mut plan = Plan {
            width: 40,
            height: 20,
            resolution: 0.1,
            origin: [-1.0, -1.0],
            cells: vec![Occupancy::Free; 800],
            crossed: vec![0; 800],
            floor,
        };
        plan.cells[5 * 40 + 7] = Occupancy::Occupied;
        let turn = stillpoint::ros_events::axes::body_from_optical();
        let map_from_world = Se3::new(turn, Vec3::zeros());
        let flat = flat(&plan, &map_from_world);
        assert!((flat.origin.z + 1.0).abs() < 1e-9);
        let occupied: Vec<usize> = (0..flat.cells.len())
            .filter(|i| flat.cells[*i] == 100)
            .collect();
        assert!((1..=2).contains(&occupied.len()), "{occupied:?}");
        // The same cell, by both ways.
        let level = Vec3::new(-1.0 + 0.75, -1.0 + 0.55, -1.0);
        let expected = map_from_world.transform(&(floor.level_from_world().transpose() * level));
        let (i, j) = (
            occupied[0] % flat.width as usize,
            occupied[0] / flat.width as usize,
        );
        let found = flat.origin + Vec3::new(i as f64 + 0.5, j as f64 + 0.5, 0.0) * 0.1;
        assert!((found - expected).norm() < 0.11, "{found} {expected}");
        assert_eq!(flat.cells.iter().filter(|c| **c == 0).count(), 799);
    }
}
