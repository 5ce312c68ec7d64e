//! Surface and floor plan during a run.

use crate::options::Options;
use crate::outlet::Decided;
use crate::outputs::Outputs;
use crate::record::Recorder;
use std::sync::Arc;
use stillpoint::dense::{Dense, DenseConfig, Floor, MeshOptions, PlanOptions};
use stillpoint::geometry::Camera;
use stillpoint::imaging::Simd;
use stillpoint::ros_events::{Mount, Outgoing, Publisher};
use stillpoint::slam::{Event, Subscriber};

/// Fuses the frames of a run, and publishes the result periodically.
pub struct Fusing {
    dense: Dense,
    publisher: Publisher,
    decided: Decided,
    mount: Option<Mount>,
    outputs: Arc<Outputs>,
    recorder: Option<Recorder>,
    period: f64,
    spacing: f64,
    /// Stamp of the last publication, s.
    last: Option<f64>,
}

impl Fusing {
    /// For a run of a camera; `ids` is the number of keyframe ids used by the loaded map.
    ///
    /// # Errors
    /// Invalid voxel size.
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
        self.send(&self.publisher.surface(&mesh.thinned(self.spacing)));
        let floor = Floor::find(&mesh, &mount.up());
        if let Some(plan) = floor.and_then(|f| map.plan(&f, &PlanOptions::default())) {
            let grid = plan.in_axes_of(&self.publisher.map_from_world());
            let message =
                self.publisher
                    .grid(grid.width as u32, grid.resolution, &grid.origin, grid.cells);
            self.send(&message);
        }
    }

    /// Publishes the final result.
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
