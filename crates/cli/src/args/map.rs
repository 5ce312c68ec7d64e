//! Arguments of `map`.

use crate::sinks::up::direction;
use clap::{ArgGroup, Args, Subcommand};
use std::path::PathBuf;

/// Inspect, check, merge and export map files.
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

/// Export the surface of a map as triangles: binary PLY or GLB, by the file extension.
///
/// The map must come from run --dense --save-map FILE. PLY keeps the map's axes; GLB is rotated so that y is up.
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
    /// Drop disconnected pieces with less area than this, m^2.
    #[arg(long, value_name = "M2", default_value_t = 0.01)]
    pub(crate) min_area: f64,
    /// Approximate direction away from the floor [default: as stored in the map, else assuming that the camera was first held upright].
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
}

/// Export the floor plan of a map for ROS 2's map_server: a YAML file and an image of the same name.
///
/// A cell is occupied where a surface lies between --low and --high above the floor, and free where the camera saw through it. Moving
/// objects are left out. Two 16-bit images of the same size are written beside it: NAME_crossed.pgm, the number of frames in which
/// something moving was in each cell, and NAME_distance.pgm, the distance from each cell to the nearest occupied one, mm.
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
    /// YAML file to write; the images are written beside it.
    #[arg(short, long, value_name = "FILE.yaml")]
    pub(crate) out: PathBuf,
    /// Lower end of the height range that counts as an obstacle, above the floor, m.
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    pub(crate) low: f64,
    /// Upper end of that height range, m.
    #[arg(long, value_name = "M", default_value_t = 1.5)]
    pub(crate) high: f64,
    /// Approximate direction away from the floor [default: as stored in the map, else assuming that the camera was first held upright].
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
}

/// Export the occupied and free cells of a map as an OctoMap octree (.bt).
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

/// List the objects in a map: class, position, size, and when each was last seen.
///
/// The map must come from run --things --save-map FILE. Positions are in the map frame, m; sizes are along the object's own axes, of which
/// the third is up.
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

/// Merge two maps where places of the second are recognised in the first.
///
/// The result is in the first map's frame of reference. Submaps that are not recognised stay separate submaps. Objects and surfaces (run
/// --things, --dense) of both maps are merged, surfaces at the voxel size of the first; a warning states which part of a surface is left
/// out, and how far off it may be where keyframes were adjusted.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map merge monday.spmap tuesday.spmap -o flat.spmap
  stillpoint map mesh flat.spmap --out flat.ply

Exit code 1 when no place was recognised, and nothing was written; 2 when a file cannot be used."
)]
pub(crate) struct MapMergeArgs {
    /// Map file whose frame of reference is kept.
    #[arg(value_name = "A")]
    pub(crate) first: PathBuf,
    /// Map file that is merged into it.
    #[arg(value_name = "B")]
    pub(crate) second: PathBuf,
    /// File to write; may be one of the two.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: PathBuf,
}

/// Show the contents of a map file.
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

/// Check that a map file is intact, and describe any damage.
///
/// Checks everything: all checksums, every value, and the consistency of keyframes and landmarks.
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

/// Export parts of a map in formats of other programs.
///
/// Where a map has several submaps whose relative poses are unknown, one of them is written: the largest, or that of --submap.
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
    /// Write the landmarks as a binary point cloud, PLY or PCD by the file extension: x y z, nx ny nz towards the cameras that saw them,
    /// observers (number of keyframes that see it), depth_observers (those with depth), found (number of frames), keyframe (that created
    /// it).
    #[arg(
        long,
        value_name = "FILE.ply|FILE.pcd",
        group = "what",
        verbatim_doc_comment
    )]
    pub(crate) points: Option<PathBuf>,
    /// Write the keyframe poses in the TUM format (timestamp tx ty tz qx qy qz qw), ordered by time.
    #[arg(long, value_name = "FILE.txt", group = "what")]
    pub(crate) trajectory: Option<PathBuf>,
    /// Write the keyframes as a pose graph (g2o: VERTEX_SE3:QUAT, EDGE_SE3:QUAT). Edges are measurements with their information matrices:
    /// between parents and covisible pairs from their shared points, between the ends of loops from loop closing.
    #[arg(long, value_name = "FILE.g2o", group = "what", verbatim_doc_comment)]
    pub(crate) graph: Option<PathBuf>,
    /// Submap to write, as named by map info [default: that with most keyframes].
    #[arg(long, value_name = "ID")]
    pub(crate) submap: Option<u32>,
}
