//! Figures of the dense map: how near its surface is to the true one, how much of people is in it, and what fusing a frame costs.
//!
//! `dense true SCENE [voxel]`: at true poses. `dense merge SCENE [voxel]`: the same of both halves of the recording, the second in other axes and put to the first. `dense run SCENE [on|off|scripted]`: at our own, with the filter on or off, or a scripted detector.
//! `dense dump-sim SCENE DIR` and `dense dump-tum FOLDER DIR`: frames and poses for other programs. `dense time DIR [voxel] [rounds]`: fuses
//! what was dumped. `dense fuse FOLDER FILE`: the surface of a recording at true poses, without what the filter says moves (no detector), as PLY. `dense plan SCENE`: the floor plan at true poses against the true one. `dense points MAP FILE`: what a map says of 10 000
//! points, as lines x y z and 1 (occupied), 0 (free) or -1 (unknown). `dense score SCENE FILE`: of a surface that another program made, as floats x y z of its points.

#![allow(clippy::print_stdout)] // What an example is for.

mod cost;
mod dump;
mod measure;
mod plan;
mod recorded;

use cost::time;
use dump::{dump_recorded, dump_simulated};
use measure::tell;
use plan::{plan, points};
use recorded::fuse;
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use stillpoint::datasets::read_regular;
use stillpoint::dense::{Dense, DenseConfig, DenseMap, FinalPose, Fuser, Mesh, MeshOptions};
use stillpoint::detection::{Detector, ScriptedDetector};
use stillpoint::geometry::{Se3, Vec3, Vec6, align_umeyama};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{DetectionNoise, Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Preset, Stages, Subscriber, System};

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args[..] {
        ["true", scene] => at_true_poses(scene, 0.02),
        ["true", scene, voxel] => at_true_poses(scene, voxel.parse()?),
        ["merge", scene] => merged(scene, 0.02),
        ["merge", scene, voxel] => merged(scene, voxel.parse()?),
        ["run", scene] => at_own_poses(scene, "on"),
        ["run", scene, filter] => at_own_poses(scene, filter),
        ["dump-sim", scene, dir] => dump_simulated(scene, Path::new(dir)),
        ["dump-tum", folder, dir] => dump_recorded(Path::new(folder), Path::new(dir)),
        ["time", dir] => time(Path::new(dir), 0.02, 3),
        ["time", dir, voxel] => time(Path::new(dir), voxel.parse()?, 3),
        ["time", dir, voxel, rounds] => time(Path::new(dir), voxel.parse()?, rounds.parse()?),
        ["plan", scene] => plan(scene),
        ["fuse", folder, file] => fuse(Path::new(folder), Path::new(file)),
        ["points", map, file] => points(Path::new(map), Path::new(file)),
        ["score", scene, file] => score_file(scene, Path::new(file)),
        _ => Err("expected true, merge, run, fuse, dump-sim, dump-tum, time, plan, points or score; see the first lines of the source".into()),
    }
}

fn simulator(scene: &str) -> Outcome<Simulator> {
    Ok(Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        ..SimulatorConfig::default()
    })?)
}

/// Every second frame: 15 Hz, as a run takes them.
fn chosen(sim: &Simulator) -> impl Iterator<Item = usize> + use<> {
    (0..sim.len()).step_by(2)
}

fn at_true_poses(scene: &str, voxel: f64) -> Outcome<()> {
    let sim = simulator(scene)?;
    let map = fused(&sim, chosen(&sim), voxel, &Se3::identity())?;
    tell(scene, &points_of(&map.mesh(&MeshOptions::default())))
}

/// Frames at true poses, in axes in which the world of the simulator lies so.
fn fused(
    sim: &Simulator,
    frames: impl Iterator<Item = usize>,
    voxel: f64,
    map_from_world: &Se3,
) -> Outcome<DenseMap> {
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

/// The first half, the second one, both put together, and all in one run.
fn merged(scene: &str, voxel: f64) -> Outcome<()> {
    let sim = simulator(scene)?;
    let half = sim.len() / 2;
    let turned = Se3::exp(&Vec6::new(1.3, -0.7, 0.4, 0.4, -1.1, 0.6));
    let own = Se3::identity();
    let of = |from: usize, to: usize| chosen(&sim).filter(move |i| (from..to).contains(i));
    let mut map = fused(&sim, of(0, half), voxel, &own)?;
    let second = fused(&sim, of(half, sim.len()), voxel, &turned)?;
    let points = |map: &DenseMap| points_of(&map.mesh(&MeshOptions::default()));
    tell(scene, &points(&map))?;
    let turned_back = points(&second)
        .into_iter()
        .map(|p| turned.inverse().transform(&p));
    tell(scene, &turned_back.collect::<Vec<_>>())?;
    let began = Instant::now();
    map.absorb(&second, &turned.inverse())?;
    let took = began.elapsed().as_secs_f64();
    tell(scene, &points(&map))?;
    println!(
        "{took:.2} s for {} blocks of 8x8x8 voxels, {:.1} MB; {:.1} MB in the end",
        second.blocks(),
        second.bytes() as f64 / 1e6,
        map.bytes() as f64 / 1e6
    );
    at_true_poses(scene, voxel)
}

/// Corners and middles of triangles.
fn points_of(mesh: &Mesh) -> Vec<Vec3> {
    let corners = (0..mesh.positions.len() as u32).map(|i| mesh.position(i));
    let middles = mesh.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| mesh.position(i));
        (a + b + c) / 3.0
    });
    corners.chain(middles).collect()
}

fn at_own_poses(scene: &str, filter: &str) -> Outcome<()> {
    let sim = simulator(scene)?;
    let mut config = Config::default();
    if filter == "off" {
        config.static_filter.preset = Preset::Off;
    }
    let stages = Stages::new(config, *sim.camera(), Simd::detect())?;
    let mut system = System::from(stages);
    if filter == "scripted" {
        system = system.with_detector(scripted(&sim)?);
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
    let truth_from_world = alignment(&sim, &poses)?;
    let mesh = map.mesh(&MeshOptions::default());
    let points = points_of(&mesh).into_iter();
    let points: Vec<Vec3> = points.map(|p| truth_from_world.transform(&p)).collect();
    tell(scene, &points)
}

fn scripted(sim: &Simulator) -> Outcome<Box<dyn Detector>> {
    let mut text = String::new();
    for i in 0..sim.len() {
        for d in sim.detections(i, &DetectionNoise::default()) {
            text += &format!(
                "{},{},{},{},{},{},{}\n",
                d.stamp, d.class, d.score, d.x0, d.y0, d.x1, d.y1
            );
        }
    }
    Ok(Box::new(ScriptedDetector::parse("simulator", &text)?))
}

/// By the positions of the frames.
fn alignment(sim: &Simulator, poses: &[FinalPose]) -> Outcome<Se3> {
    let ours: Vec<Vec3> = poses
        .iter()
        .map(|p| p.world_from_camera.translation)
        .collect();
    let truth: Vec<Vec3> = poses
        .iter()
        .map(|p| sim.world_from_camera(p.stamp).translation)
        .collect();
    let spread = truth
        .iter()
        .map(|t| (t - truth[0]).norm())
        .fold(0.0, f64::max);
    if spread < 0.2 {
        // A camera that stands still tells no rotation by its positions.
        let first = &poses[0];
        return Ok(sim.world_from_camera(first.stamp) * first.world_from_camera.inverse());
    }
    let found = align_umeyama(&ours, &truth, false)?;
    Ok(found.target_from_source)
}

fn score_file(scene: &str, file: &Path) -> Outcome<()> {
    let bytes = read_regular(file, 1 << 31)?;
    let floats: Vec<f64> = bytes
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    let points: Vec<Vec3> = floats
        .chunks_exact(3)
        .map(Vec3::from_column_slice)
        .collect();
    tell(scene, &points)
}
