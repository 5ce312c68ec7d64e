//! Evaluation of the dense map: accuracy, remains of people, cost of fusing a frame.

mod cost;
mod dump;
mod measure;
mod plan;
mod recorded;

use crate::Failure;
use crate::experiments::shared::{scene, script, scripted, world_from_map};
use measure::Judge;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use stillpoint::datasets::read_regular;
use stillpoint::dense::{Dense, DenseConfig, DenseMap, FinalPose, Fuser, Mesh, MeshOptions};
use stillpoint::geometry::{Se3, Vec3, Vec6};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{DetectionNoise, Simulator};
use stillpoint::slam::{Config, Preset, Subscriber, System};

/// Evaluates surfaces: accuracy, remains of people, cost of fusing a frame
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// At true poses
    True {
        #[command(flatten)]
        scene: Scene,
        #[command(flatten)]
        size: Size,
    },
    /// Both halves of a scene at true poses, the second in another frame and merged into the first
    Merge {
        #[command(flatten)]
        scene: Scene,
        #[command(flatten)]
        size: Size,
    },
    /// At estimated poses
    Run {
        #[command(flatten)]
        scene: Scene,
        #[arg(value_enum, default_value_t = Filter::On)]
        filter: Filter,
    },
    /// The floor plan at true poses, compared with the true one
    Plan {
        #[command(flatten)]
        scene: Scene,
    },
    /// The surface of a recording at true poses, without moving regions found by the filter (no detector), as PLY
    Fuse { folder: PathBuf, file: PathBuf },
    /// Export of frames and poses of a scene for other programs
    DumpSim {
        #[command(flatten)]
        scene: Scene,
        folder: PathBuf,
    },
    /// Export of frames and poses of a recording for other programs
    DumpTum { recording: PathBuf, folder: PathBuf },
    /// CPU time per frame of fusing an export
    Time {
        folder: PathBuf,
        #[command(flatten)]
        size: Size,
        #[arg(long, default_value_t = 3)]
        rounds: usize,
    },
    /// Occupancy of 10 000 points of a map: lines x y z and 1 (occupied), 0 (free) or -1 (unknown)
    Points { map: PathBuf, file: PathBuf },
    /// A surface of a scene made by another program: floats x y z of its points
    Score {
        #[command(flatten)]
        scene: Scene,
        file: PathBuf,
    },
}

#[derive(clap::Args)]
struct Scene {
    /// Simulated scene
    #[arg(id = "scene", value_name = "SCENE")]
    name: String,
    /// Frames, at 30 per second [default: the whole scene]
    #[arg(long)]
    frames: Option<usize>,
}

impl Scene {
    fn simulator(&self) -> Result<Simulator, Failure> {
        scene(&self.name, 0, self.frames)
    }
}

#[derive(clap::Args)]
struct Size {
    /// Voxel size, m
    #[arg(long, default_value_t = 0.02)]
    voxel: f64,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Filter {
    On,
    Off,
    /// With a detector that misses 30 %
    Scripted,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    match &arguments.what {
        What::True { scene, size } => at_true_poses(scene, size.voxel),
        What::Merge { scene, size } => merged(scene, size.voxel),
        What::Run { scene, filter } => at_own_poses(scene, *filter),
        What::Plan { scene } => plan::plan(scene),
        What::Fuse { folder, file } => recorded::fuse(folder, file),
        What::DumpSim { scene, folder } => dump::dump_simulated(scene, folder),
        What::DumpTum { recording, folder } => dump::dump_recorded(recording, folder),
        What::Time {
            folder,
            size,
            rounds,
        } => cost::time(folder, size.voxel, *rounds),
        What::Points { map, file } => plan::points(map, file),
        What::Score { scene, file } => score_file(scene, file),
    }?;
    Ok(ExitCode::SUCCESS)
}

/// 15 Hz, the rate at which a run fuses frames.
fn chosen(sim: &Simulator) -> impl Iterator<Item = usize> + use<> {
    (0..sim.len()).step_by(2)
}

fn at_true_poses(scene: &Scene, voxel: f64) -> Result<(), Failure> {
    let sim = scene.simulator()?;
    let map = fused(&sim, chosen(&sim), voxel, &Se3::identity())?;
    let points = points_of(&map.mesh(&MeshOptions::default()));
    judged(scene, "at true poses", &points)
}

fn judged(scene: &Scene, surface: &str, points: &[Vec3]) -> Result<(), Failure> {
    let mut judge = Judge::new(scene)?;
    judge.add(surface, points);
    judge.print();
    Ok(())
}

/// Fuses frames at true poses into a map with the given frame.
fn fused(
    sim: &Simulator,
    frames: impl Iterator<Item = usize>,
    voxel: f64,
    map_from_world: &Se3,
) -> Result<DenseMap, Failure> {
    let config = DenseConfig {
        voxel,
        ..DenseConfig::default()
    };
    let mut fuser = Fuser::new(&config, sim.camera(), Simd::detect())?;
    for i in frames {
        let moving: Vec<bool> = sim.truth(i).mask.data().iter().map(|m| *m > 0).collect();
        let pose = *map_from_world * sim.world_from_camera(sim.depth_stamp(i));
        fuser.add(&sim.frame_with_colour(i), &moving, &pose);
    }
    Ok(fuser.map().clone())
}

/// Evaluates both halves, their merger, and all frames in one run.
fn merged(scene: &Scene, voxel: f64) -> Result<(), Failure> {
    let sim = scene.simulator()?;
    let half = sim.len() / 2;
    let turned = Se3::exp(&Vec6::new(1.3, -0.7, 0.4, 0.4, -1.1, 0.6));
    let own = Se3::identity();
    let of = |from: usize, to: usize| chosen(&sim).filter(move |i| (from..to).contains(i));
    let mut map = fused(&sim, of(0, half), voxel, &own)?;
    let second = fused(&sim, of(half, sim.len()), voxel, &turned)?;
    let points = |map: &DenseMap| points_of(&map.mesh(&MeshOptions::default()));
    let mut judge = Judge::new(scene)?;
    judge.add("first half", &points(&map));
    let turned_back = points(&second)
        .into_iter()
        .map(|p| turned.inverse().transform(&p));
    judge.add("second half", &turned_back.collect::<Vec<_>>());
    let began = Instant::now();
    map.absorb(&second, &turned.inverse())?;
    let took = began.elapsed().as_secs_f64();
    judge.add("both, merged", &points(&map));
    let whole = fused(&sim, chosen(&sim), voxel, &own)?;
    judge.add("in one run", &points(&whole));
    judge.print();
    println!(
        "{took:.2} s for {} blocks of 8x8x8 voxels, {:.1} MB; {:.1} MB in the end",
        second.blocks(),
        second.bytes() as f64 / 1e6,
        map.bytes() as f64 / 1e6
    );
    Ok(())
}

fn points_of(mesh: &Mesh) -> Vec<Vec3> {
    let corners = (0..mesh.positions.len() as u32).map(|i| mesh.position(i));
    let middles = mesh.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| mesh.position(i));
        (a + b + c) / 3.0
    });
    corners.chain(middles).collect()
}

fn at_own_poses(scene: &Scene, filter: Filter) -> Result<(), Failure> {
    let sim = scene.simulator()?;
    let mut config = Config::default();
    if filter == Filter::Off {
        config.static_filter.preset = Preset::Off;
    }
    let mut system = System::new(config, *sim.camera(), Simd::detect())?;
    if filter == Filter::Scripted {
        let script = script(&sim, &DetectionNoise::default())?;
        system = system.with_detector(scripted(&script)?);
    }
    let mut dense = Dense::new(&DenseConfig::default(), sim.camera(), Simd::detect())?;
    for i in 0..sim.len() {
        let frame = sim.frame_with_colour(i);
        dense.receive_all(&system.step(frame));
    }
    dense.receive_all(&system.finish());
    let poses: Vec<FinalPose> = system
        .corrected_trajectory()
        .into_iter()
        .map(|(entry, world_from_camera)| FinalPose {
            frame: entry.frame,
            stamp: entry.stamp,
            world_from_camera,
        })
        .collect();
    println!("{:?}; {} MB", dense.counts(), dense.bytes() / 1_000_000);
    let map = dense.finish(&poses);
    let known: Vec<(f64, Se3)> = poses
        .iter()
        .map(|p| (p.stamp, p.world_from_camera))
        .collect();
    let truth_from_world = world_from_map(&sim, &known);
    let mesh = map.mesh(&MeshOptions::default());
    let points = points_of(&mesh).into_iter();
    let points: Vec<Vec3> = points.map(|p| truth_from_world.transform(&p)).collect();
    judged(scene, "at estimated poses", &points)
}

fn score_file(scene: &Scene, file: &Path) -> Result<(), Failure> {
    let bytes = read_regular(file, 1 << 31)?;
    let floats: Vec<f64> = bytes
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    let points: Vec<Vec3> = floats
        .chunks_exact(3)
        .map(Vec3::from_column_slice)
        .collect();
    judged(scene, "of the file", &points)
}
