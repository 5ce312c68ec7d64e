//! `--dense`: fuses the static scene into a surface and grids during a run.

use crate::console;
use crate::dense::{Fused, Logged};
use crate::failure::Failure;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use crate::sinks::view::SurfaceWindow;
use clap::Args;
use std::sync::Arc;
use std::time::{Duration, Instant};
use stillpoint::dense::{Dense, DenseConfig, DenseMap, MeshOptions};
use stillpoint::detection::MotionWeights;
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameId, Simd};
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::{Event, Subscriber};

/// Minimum interval between updates of the displayed surface.
const SHOWN: Duration = Duration::from_secs(3);
/// Minimum interval between those updates as a multiple of their duration: they use at most 5 % of a core.
const SHOWN_SHARE: u32 = 20;

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct DenseOutput {
    /// Fuse the static scene into a surface: mesh.ply and mesh.glb in the result folder, and a floor plan for ROS 2's map_server (grid.pgm,
    /// grid.yaml) where the floor was seen. Moving objects are left out. --save-map stores the surface in the map, for map mesh, map grid
    /// and map octomap.
    #[arg(long, verbatim_doc_comment)]
    pub(crate) dense: bool,
    /// Voxel size of the surface, m [default: 0.02].
    #[arg(long, value_name = "M", requires = "dense", value_parser = voxel)]
    pub(crate) voxel: Option<f64>,
}

/// Parses a voxel size, m.
pub(crate) fn voxel(text: &str) -> Result<f64, String> {
    let m = text.parse().ok();
    m.filter(|m| (0.005..=0.2).contains(m))
        .ok_or_else(|| "expected 0.005 to 0.2 metres".to_owned())
}

impl Output for DenseOutput {
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let known = start.known.and_then(|k| k.dense.as_ref());
        if !self.dense {
            if start.saves_map && known.is_some() {
                console::warn(
                    "the surface in the map is not saved with it again: this run has no --dense",
                );
            }
            return Ok(None);
        }
        let wish = Wish {
            voxel: self.voxel,
            known: known.cloned(),
            weights: start.config.motion_weights.clone(),
            keyframes: start.first_keyframe(),
            logged: start.logged.dense.take(),
        };
        let window = SurfaceWindow::default();
        start.shelf.put(window.clone());
        let fusion = Fusion::new(wish, &start.camera, start.simd)?;
        Ok(Some(Box::new(fusion.shown_in(window))))
    }

    fn wants_colour(&self) -> bool {
        self.dense
    }
}

#[derive(Default)]
pub(crate) struct Wish {
    pub(crate) voxel: Option<f64>,
    pub(crate) known: Option<DenseMap>,
    /// Which classes of objects move by themselves.
    pub(crate) weights: MotionWeights,
    /// Number of keyframe ids in the initial map.
    pub(crate) keyframes: usize,
    pub(crate) logged: Option<Logged>,
}

pub(crate) struct Fusion {
    dense: Option<Dense>,
    most_bytes: usize,
    window: SurfaceWindow,
    /// Earliest time of the next display.
    next_shown: Option<Instant>,
}

impl Fusion {
    pub(crate) fn new(wish: Wish, camera: &Camera, simd: Simd) -> Result<Self, Failure> {
        let known = wish.known.as_ref();
        let logged = wish.logged.as_ref().map(|l| l.voxel);
        let voxel = wish.voxel.or(known.map(DenseMap::voxel)).or(logged);
        if let (Some(known), Some(voxel)) = (known, voxel)
            && known.voxel() != voxel
        {
            return Err(Failure::input(format!(
                "--voxel: expected {} m, as the surface in the map has it, found {voxel}; leave it out",
                known.voxel()
            )));
        }
        let mut config = DenseConfig::default();
        config.voxel = voxel.unwrap_or(config.voxel);
        let dense = Dense::new(&config, camera, simd)
            .map_err(|e| Failure::input(format!("--voxel: {e}")))?;
        let mut dense = dense
            .with_first_keyframe(wish.keyframes)
            .with_weights(wish.weights);
        if let Some(known) = wish.known {
            dense = dense.starting_with(known);
        }
        if let Some(logged) = wish.logged {
            dense = dense.with_frames(logged.frames.into_iter().map(FrameId));
        }
        Ok(Self {
            dense: Some(dense),
            most_bytes: 0,
            window: SurfaceWindow::default(),
            next_shown: None,
        })
    }

    fn shown_in(mut self, window: SurfaceWindow) -> Self {
        self.window = window;
        self
    }

    /// Updates the display, if it is due and a page is open.
    fn show(&mut self) {
        let began = Instant::now();
        let is_due = self.next_shown.is_none_or(|next| began >= next);
        let Some(dense) = self.dense.as_ref().filter(|_| is_due) else {
            return;
        };
        if !self.window.is_watched() {
            return;
        }
        let mesh = dense.map().mesh(&MeshOptions::default());
        if !mesh.triangles.is_empty() {
            self.window.show(&mesh);
        }
        self.next_shown = Some(began + (began.elapsed() * SHOWN_SHARE).max(SHOWN));
    }

    fn note_memory(&mut self) {
        let bytes = self.dense.as_ref().map_or(0, Dense::bytes);
        self.most_bytes = self.most_bytes.max(bytes);
    }
}

impl Sink for Fusion {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("dense", 1))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let _span = tracing::info_span!("fuse").entered();
        if let Some(dense) = &mut self.dense {
            dense.receive(event);
        }
        self.note_memory();
        self.show();
        Ok(())
    }

    /// Re-integrates all kept frames at their final poses.
    fn settle(&mut self, ended: &mut Ended<'_>) -> Result<(), Failure> {
        let _span = tracing::info_span!("fuse").entered();
        self.note_memory();
        let Some(dense) = self.dense.take() else {
            return Ok(());
        };
        let counts = dense.counts();
        let frames = dense.taken().iter().map(|f| f.0).collect();
        let map = dense.finish(&ended.session.poses.of_each_frame());
        let fused = Fused::of(map, &counts).by(frames, self.most_bytes, ended.up);
        ended.found.extensions.push(fused.extension());
        ended.found.shelf.put(fused);
        Ok(())
    }

    /// Writes mesh and plan into the result folder.
    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        match (&mut ended.folder, ended.found.shelf.get::<Fused>()) {
            (Some(folder), Some(fused)) => fused.write(folder),
            _ => Ok(()),
        }
    }
}
