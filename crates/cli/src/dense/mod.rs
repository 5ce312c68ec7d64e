//! `--dense`: surface and grids of what stands still, fused while a run goes on.

pub(crate) mod export;
pub(crate) mod merge;

use crate::console::counted;
use crate::failure::Failure;
use crate::output::ResultFolder;
use crate::page;
use crate::run::session::listeners::Writer;
use crate::run::view::SurfaceView;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};
use stillpoint::dense::{
    Dense, DenseConfig, DenseCounts, DenseMap, FinalPose, Floor, Mesh, MeshOptions, Plan,
    PlanOptions,
};
use stillpoint::detection::MotionWeights;
use stillpoint::geometry::{Camera, Vec3};
use stillpoint::imaging::{FrameId, Simd};
use stillpoint::map::Extension;
use stillpoint::slam::{Event, Subscriber, Up};

/// Between two looks at the surface of a run that goes on, at least ...
const SHOWN: Duration = Duration::from_secs(3);
/// ... and so many times as long as one takes: 5 % of a core at most.
const SHOWN_SHARE: u32 = 20;

/// What is asked for.
#[derive(Default)]
pub(crate) struct Wish {
    /// m.
    pub(crate) voxel: Option<f64>,
    /// What was fused before, from the map that the run begins with.
    pub(crate) known: Option<DenseMap>,
    /// Which classes of objects move by themselves.
    pub(crate) weights: MotionWeights,
    /// Ids that the map had before.
    pub(crate) keyframes: usize,
    /// What a run fused that is repeated.
    pub(crate) logged: Option<Logged>,
}

/// What a repetition has to know: which frames found their images in time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Logged {
    /// m.
    pub(crate) voxel: f64,
    /// Numbers of frames.
    pub(crate) frames: Vec<u32>,
}

/// Fuses while frames go by.
pub(crate) struct Fusion {
    dense: Dense,
    /// Largest amount of memory held, bytes.
    most_bytes: usize,
    /// Who shows it while the run goes on.
    page: Option<SurfaceView>,
    /// When it may be shown again.
    next_shown: Option<Instant>,
}

impl Fusion {
    /// Before the first frame of a camera.
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
            dense,
            most_bytes: 0,
            page: None,
            next_shown: None,
        })
    }

    /// All that is kept at the final poses. `up` is the direction away from the floor, where it is known.
    pub(crate) fn finish(mut self, poses: &[FinalPose], up: Option<Up>) -> Fused {
        let _span = tracing::info_span!("fuse").entered();
        self.note_memory();
        let counts = self.dense.counts();
        let frames = self.dense.taken().iter().map(|f| f.0).collect();
        let mut fused = Fused::of(self.dense.finish(poses), &counts);
        fused.json.memory_bytes = self.most_bytes.max(fused.json.memory_bytes);
        fused.logged.frames = frames;
        fused.up = up.map_or(fused.up, |up| up.vector());
        fused
    }

    /// Has a live page show the surface as it grows.
    pub(crate) fn show_on(&mut self, page: SurfaceView) {
        self.page = Some(page);
    }

    /// Shows the surface, where it is time to and somebody looks.
    fn show(&mut self) {
        let began = Instant::now();
        let Some(page) = self.page.as_ref().filter(|p| p.is_watched()) else {
            return;
        };
        if self.next_shown.is_some_and(|next| began < next) {
            return;
        }
        let mesh = self.dense.map().mesh(&MeshOptions::default());
        if !mesh.triangles.is_empty() {
            page.show(page::data::surface(&mesh));
        }
        self.next_shown = Some(began + (began.elapsed() * SHOWN_SHARE).max(SHOWN));
    }

    fn note_memory(&mut self) {
        self.most_bytes = self.most_bytes.max(self.dense.bytes());
    }
}

impl Writer for Fusion {
    fn write(&mut self, event: &Event) -> Result<(), Failure> {
        let _span = tracing::info_span!("fuse").entered();
        self.dense.receive(event);
        self.note_memory();
        self.show();
        Ok(())
    }
}

/// What was fused.
pub(crate) struct Fused {
    pub(crate) map: DenseMap,
    pub(crate) json: DenseJson,
    pub(crate) logged: Logged,
    pub(crate) mesh: Mesh,
    up: Vec3,
}

impl Fused {
    /// A finished surface, and what was done for it; up is that of a camera that was held upright at first.
    pub(crate) fn of(map: DenseMap, counts: &DenseCounts) -> Self {
        let mesh = map.mesh(&MeshOptions::default());
        Self {
            json: DenseJson::new(counts, &map, &mesh, map.bytes()),
            logged: Logged {
                voxel: map.voxel(),
                frames: Vec::new(),
            },
            up: -Vec3::y(),
            map,
            mesh,
        }
    }

    /// What a map file keeps of it.
    pub(crate) fn extension(&self) -> Extension {
        Extension {
            name: DenseMap::EXTENSION.to_owned(),
            bytes: self.map.to_bytes(),
        }
    }

    fn floor(&self) -> Option<Floor> {
        Floor::find(&self.mesh, &self.up)
    }

    /// Away from the floor, as it was seen or else as is known.
    pub(crate) fn upward(&self) -> Vec3 {
        self.floor().map_or(self.up, |f| f.up)
    }

    /// The floor plan, where the floor was seen.
    pub(crate) fn plan(&self) -> Option<Plan> {
        self.map.plan(&self.floor()?, &PlanOptions::default())
    }

    /// Writes mesh and plan into a result folder.
    pub(crate) fn write(&self, folder: &mut ResultFolder) -> Result<(), Failure> {
        let up = self.upward();
        let bytes = |write: &dyn Fn(&mut Vec<u8>) -> std::io::Result<()>| {
            let mut bytes = Vec::new();
            write(&mut bytes).map_err(Failure::input)?;
            Ok::<_, Failure>(bytes)
        };
        folder.write("mesh.ply", &bytes(&|to| self.mesh.write_ply(to))?)?;
        folder.write(
            "mesh.glb",
            &bytes(&|to| self.mesh.write_glb(to, Some(&up)))?,
        )?;
        if let Some(plan) = self.plan() {
            folder.write("grid.pgm", &bytes(&|to| plan.write_pgm(to))?)?;
            folder.write("grid.yaml", plan.yaml("grid.pgm").as_bytes())?;
            folder.write("grid_crossed.pgm", &bytes(&|to| plan.write_crossed(to))?)?;
        }
        Ok(())
    }
}

/// What was fused, in numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct DenseJson {
    /// Distance between voxels, m.
    pub(crate) voxel: f64,
    /// Frames that were integrated.
    pub(crate) integrated: usize,
    /// Of these, frames that gave up their depth to keep to the memory that they may take: they stayed where they were then.
    pub(crate) given_up: usize,
    /// Frames whose turn it was and whose image came too late.
    pub(crate) without_image: usize,
    /// How often corrections had all kept frames integrated again while the run went on.
    pub(crate) rebuilt: usize,
    /// Blocks of 8x8x8 voxels.
    pub(crate) blocks: usize,
    /// Triangles of the mesh.
    pub(crate) triangles: usize,
    /// Area of the mesh, m^2.
    pub(crate) area: f64,
    /// Bytes of the frames that are kept.
    pub(crate) kept_bytes: usize,
    /// Largest amount of memory held, bytes.
    pub(crate) memory_bytes: usize,
}

impl DenseJson {
    fn new(counts: &DenseCounts, map: &DenseMap, mesh: &Mesh, memory_bytes: usize) -> Self {
        Self {
            voxel: map.voxel(),
            integrated: counts.integrated,
            given_up: counts.given_up,
            without_image: counts.without_image,
            rebuilt: counts.rebuilt,
            blocks: map.blocks(),
            triangles: mesh.triangles.len(),
            area: mesh.area(),
            kept_bytes: counts.kept_bytes,
            memory_bytes,
        }
    }

    /// A line for the report. `detailed` adds what it takes of the memory of the run.
    pub(crate) fn text(&self, detailed: bool) -> String {
        let mut text = format!(
            "surface: {} in voxels of {:.1} cm, {}, {:.1} m2",
            counted(self.integrated, "frame"),
            100.0 * self.voxel,
            counted(self.triangles, "triangle"),
            self.area
        );
        if detailed {
            text += &format!(", {:.0} MB of the memory", self.memory_bytes as f64 / 1e6);
        }
        if self.given_up > 0 {
            let frames = counted(self.given_up, "frame");
            text += &format!("; {frames} stayed where they were");
        }
        text + "\n"
    }
}
