//! Surface and grids of the static scene: written as files, figures, and a part of a map file.

pub(crate) mod export;
pub(crate) mod merge;

use crate::console::counted;
use crate::failure::Failure;
use crate::output::ResultFolder;
use serde::{Deserialize, Serialize};
use stillpoint::dense::{DenseCounts, DenseMap, Floor, Mesh, MeshOptions, Plan, PlanOptions};
use stillpoint::geometry::Vec3;
use stillpoint::map::Extension;
use stillpoint::slam::Up;

/// For a replay: which frames got their images in time and were fused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Logged {
    /// Voxel size, m.
    pub(crate) voxel: f64,
    pub(crate) frames: Vec<u32>,
}

pub(crate) struct Fused {
    pub(crate) map: DenseMap,
    pub(crate) json: DenseJson,
    pub(crate) logged: Logged,
    pub(crate) mesh: Mesh,
    up: Vec3,
}

impl Fused {
    /// From a finished surface and its counters; up assumes that the camera was first held upright.
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

    /// Adds the fused frames, the peak memory (bytes) and, where known, the up direction of the run.
    pub(crate) fn by(mut self, frames: Vec<u32>, most_bytes: usize, up: Option<Up>) -> Self {
        self.json.memory_bytes = most_bytes.max(self.json.memory_bytes);
        self.logged.frames = frames;
        self.up = up.map_or(self.up, |up| up.vector());
        self
    }

    /// The map file extension that stores it.
    pub(crate) fn extension(&self) -> Extension {
        Extension {
            name: DenseMap::EXTENSION.to_owned(),
            bytes: self.map.to_bytes(),
        }
    }

    fn floor(&self) -> Option<Floor> {
        Floor::find(&self.mesh, &self.up)
    }

    /// Direction away from the floor: from the fitted floor, else from the run.
    pub(crate) fn upward(&self) -> Vec3 {
        self.floor().map_or(self.up, |f| f.up)
    }

    /// The floor plan, if the floor was seen.
    pub(crate) fn plan(&self) -> Option<Plan> {
        self.map.plan(&self.floor()?, &PlanOptions::default())
    }

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

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct DenseJson {
    /// Voxel size, m.
    pub(crate) voxel: f64,
    pub(crate) integrated: usize,
    /// Integrated frames whose depth was dropped to limit memory: they do not follow later corrections.
    pub(crate) given_up: usize,
    /// Frames that were due and whose image came too late.
    pub(crate) without_image: usize,
    /// Number of times that corrections made all kept frames be integrated again during the run.
    pub(crate) rebuilt: usize,
    /// Number of blocks of 8x8x8 voxels.
    pub(crate) blocks: usize,
    pub(crate) triangles: usize,
    /// Area of the mesh, m^2.
    pub(crate) area: f64,
    /// Size of the kept frames, bytes.
    pub(crate) kept_bytes: usize,
    /// Peak memory, bytes.
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

    /// A line for the report; `detailed` adds the memory.
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
