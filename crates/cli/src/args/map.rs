//! Arguments of `map`.

use crate::sinks::up::direction;
use clap::{ArgGroup, Args, Subcommand};
use std::path::PathBuf;

/// Map files: what is in them, whether they are whole, and what other programs can read of them.
///
/// run --save-map FILE writes them.
#[derive(Debug, Subcommand)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint run rgbd_dataset_freiburg1_xyz --save-map desk.spmap
  stillpoint map info desk.spmap
  stillpoint map check desk.spmap
  stillpoint map export desk.spmap --points desk.ply
  stillpoint map mesh desk.spmap --out desk.glb
  stillpoint map grid desk.spmap --out desk.yaml
  stillpoint map objects desk.spmap
  stillpoint map merge monday.spmap tuesday.spmap -o flat.spmap"
)]
pub(crate) enum MapCommand {
    Info(MapInfoArgs),
    Check(MapCheckArgs),
    Export(MapExportArgs),
    Mesh(MapMeshArgs),
    Grid(MapGridArgs),
    Octomap(MapOctomapArgs),
    Objects(MapObjectsArgs),
    Merge(MapMergeArgs),
}

/// Write the surface in a map as triangles: binary PLY, or GLB, as the name ends.
///
/// run --dense --save-map FILE leaves it there. PLY has the map's own axes; GLB is turned so that up is up.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map mesh desk.spmap --out desk.ply
  stillpoint map mesh desk.spmap --out desk.glb --min-area 0.05

Exit code 2 when the map cannot be used, has no surface, or the file cannot be written."
)]
pub(crate) struct MapMeshArgs {
    /// Map file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// File to write.
    #[arg(short, long, value_name = "FILE.ply|FILE.glb")]
    pub(crate) out: PathBuf,
    /// Leave out pieces of less area that hang together with nothing, m^2.
    #[arg(long, value_name = "M2", default_value_t = 0.01)]
    pub(crate) min_area: f64,
    /// Direction away from the floor, roughly [default: as the map knows it, else that of a camera that was held
    /// upright at first].
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
}

/// Write the floor plan in a map as ROS 2's map_server reads it: a YAML file and an image of the same name.
///
/// Occupied is where a surface is between --low and --high above the floor, free where the camera saw through. What moved
/// is not in it. Beside it, images of 16 bits in the same places: NAME_crossed.pgm, in how many frames something that moves was
/// in each cell, and NAME_distance.pgm, how far each cell is from the nearest occupied one, mm.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map grid flat.spmap --out flat.yaml
  stillpoint map grid flat.spmap --out flat.yaml --low 0.05 --high 0.6

Exit code 1 when no floor is seen; 2 when the map cannot be used, has no surface, or a file cannot be written."
)]
pub(crate) struct MapGridArgs {
    /// Map file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// File to write; the images lie beside it.
    #[arg(short, long, value_name = "FILE.yaml")]
    pub(crate) out: PathBuf,
    /// Height above the floor from which things are in the way, m.
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    pub(crate) low: f64,
    /// Height up to which they are, m.
    #[arg(long, value_name = "M", default_value_t = 1.5)]
    pub(crate) high: f64,
    /// Direction away from the floor, roughly [default: as the map knows it, else that of a camera that was held
    /// upright at first].
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
}

/// Write the cells in a map that are occupied or free as an octree of OctoMap (.bt).
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map octomap flat.spmap --out flat.bt

Exit code 2 when the map cannot be used, has no surface, or the file cannot be written."
)]
pub(crate) struct MapOctomapArgs {
    /// Map file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// File to write.
    #[arg(short, long, value_name = "FILE.bt")]
    pub(crate) out: PathBuf,
}

/// List the things in a map: what stands where, how large it is, and when it was seen last.
///
/// run --things --save-map FILE leaves them there. Positions are in the map's own axes, m; sizes along the thing's own, of which the third is up.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map objects flat.spmap
  stillpoint map objects flat.spmap --json

Exit code 2 when the map cannot be used, or no run has looked for things in it."
)]
pub(crate) struct MapObjectsArgs {
    /// Map file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Make one map of two, where places of the second are recognised in the first.
///
/// The result is in the first map's frame of reference. Submaps that are not recognised stay submaps of their own.
/// Things and surfaces (run --things, --dense) of both maps are put together, surfaces in the voxels of the first; a
/// warning says what of a surface is left out, and how far off it may be where keyframes were adjusted.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map merge monday.spmap tuesday.spmap -o flat.spmap
  stillpoint map mesh flat.spmap --out flat.ply

Exit code 1 when no place was recognised, and nothing was written; 2 when a file cannot be used."
)]
pub(crate) struct MapMergeArgs {
    /// Map file whose frame of reference stays.
    #[arg(value_name = "A")]
    pub(crate) first: PathBuf,
    /// Map file that is put into it.
    #[arg(value_name = "B")]
    pub(crate) second: PathBuf,
    /// File to write. It may be one of the two.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: PathBuf,
}

/// Show what a map file holds.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map info desk.spmap
  stillpoint map info desk.spmap --json

Exit code 2 when the file cannot be used."
)]
pub(crate) struct MapInfoArgs {
    /// Map file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Print JSON (metres, seconds, bytes) instead of a table.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Say whether a map file is whole, and if not, what is wrong with it.
///
/// Looks at everything: all checksums, every value, and whether keyframes and landmarks agree.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map check desk.spmap
  stillpoint -q map check desk.spmap && cp desk.spmap backup/

Exit code 1 when it is damaged, no map file, or of a later version; 2 when it cannot be read."
)]
pub(crate) struct MapCheckArgs {
    /// Map file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
}

/// Write parts of a map in formats that other programs read.
///
/// Of a map in submaps, of which it is not known how they lie to each other, one is written: the largest, or that of --submap.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    group = ArgGroup::new("what").required(true).multiple(true),
    after_help = "Examples:
  stillpoint map export desk.spmap --points desk.ply
  stillpoint map export desk.spmap --trajectory desk.txt --graph desk.g2o
  stillpoint map export desk.spmap --points kitchen.ply --submap 412
  stillpoint eval groundtruth.txt desk.txt

Exit code 2 when the map cannot be used or a file cannot be written."
)]
pub(crate) struct MapExportArgs {
    /// Map file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Write the landmarks as a point cloud (binary), PLY or PCD as the name ends: x y z, nx ny nz towards the cameras that saw them,
    /// observers (how many keyframes see it), depth_observers (of these, with depth), found (in how many frames), keyframe (that
    /// made it).
    #[arg(
        long,
        value_name = "FILE.ply|FILE.pcd",
        group = "what",
        verbatim_doc_comment
    )]
    pub(crate) points: Option<PathBuf>,
    /// Write the poses of the keyframes in the TUM format (timestamp tx ty tz qx qy qz qw), in the order of time.
    #[arg(long, value_name = "FILE.txt", group = "what")]
    pub(crate) trajectory: Option<PathBuf>,
    /// Write the keyframes as a pose graph (g2o: VERTEX_SE3:QUAT, EDGE_SE3:QUAT). Edges are measured, with what is known of them as
    /// information: between parents and covisible pairs by the points that both see, between the ends of loops when they were closed.
    #[arg(long, value_name = "FILE.g2o", group = "what", verbatim_doc_comment)]
    pub(crate) graph: Option<PathBuf>,
    /// The submap to write, as map info names it [default: that with most keyframes].
    #[arg(long, value_name = "ID")]
    pub(crate) submap: Option<u32>,
}
