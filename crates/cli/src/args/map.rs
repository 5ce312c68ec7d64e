//! Arguments of `map`.

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
  stillpoint map merge monday.spmap tuesday.spmap -o flat.spmap"
)]
pub(crate) enum MapCommand {
    Info(MapInfoArgs),
    Check(MapCheckArgs),
    Export(MapExportArgs),
    Merge(MapMergeArgs),
}

/// Make one map of two, where places of the second are recognised in the first.
///
/// The result is in the first map's frame of reference. Submaps that are not recognised stay submaps of their own.
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint map merge monday.spmap tuesday.spmap -o flat.spmap

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
