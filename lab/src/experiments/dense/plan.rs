//! Evaluation of the floor plan, and occupancy of points.

use super::measure::measured;
use super::{Scene, chosen};
use crate::Failure;
use std::path::Path;
use stillpoint::datasets::read_regular;
use stillpoint::dense::{DenseConfig, DenseMap, Floor, Fuser, MeshOptions, Occupancy, PlanOptions};
use stillpoint::geometry::Vec3;
use stillpoint::imaging::Simd;
use stillpoint::map::MapFile;

pub(super) fn plan(scene: &Scene) -> Result<(), Failure> {
    let sim = scene.simulator()?;
    let mut fuser = Fuser::new(&DenseConfig::default(), sim.camera(), Simd::detect())?;
    let mut walked = Vec::new();
    for i in chosen(&sim) {
        let truth = sim.truth(i);
        let moving: Vec<bool> = truth.mask.data().iter().map(|m| *m > 0).collect();
        let pose = sim.world_from_camera(sim.depth_stamp(i));
        fuser.add(&sim.frame_with_colour(i), &moving, &pose);
        let movers = truth.boxes.iter().filter_map(|b| b.motion);
        walked.extend(movers.map(|m| Vec3::from(m.position)));
    }
    let mesh = fuser.map().mesh(&MeshOptions::default());
    let floor = Floor::find(&mesh, &Vec3::z()).ok_or("no floor")?;
    println!(
        "floor: up {:.4?}, height {:.1} mm",
        floor.up.as_slice(),
        1e3 * floor.offset
    );
    let options = PlanOptions::default();
    let plan = fuser.map().plan(&floor, &options).ok_or("no plan")?;
    let side = plan.resolution;
    let band = |p: &Vec3| (options.low..=options.high).contains(&floor.height(p));
    let solid: Vec<Vec3> = measured(scene, 0.02)?.into_iter().filter(band).collect();
    let turn = floor.level_from_world();
    let index = |p: &Vec3| {
        let q = turn * p;
        [q.x - plan.origin[0], q.y - plan.origin[1]].map(|v| (v / side).floor() as i64)
    };
    let taken: std::collections::BTreeSet<[i64; 2]> = solid.iter().map(index).collect();
    let state = |c: [i64; 2]| {
        let inside =
            c[0] >= 0 && c[1] >= 0 && c[0] < plan.width as i64 && c[1] < plan.height as i64;
        if inside {
            plan.cells[c[1] as usize * plan.width + c[0] as usize]
        } else {
            Occupancy::Unknown
        }
    };
    let around = |c: [i64; 2]| (0..9).map(move |k| [c[0] + k % 3 - 1, c[1] + k / 3 - 1]);
    let cells = (0..plan.height as i64).flat_map(|y| (0..plan.width as i64).map(move |x| [x, y]));
    // Among cells without a true surface in or beside them.
    let (mut free, mut wrong, mut false_free, mut all_free) = (0, 0, 0, 0);
    for c in cells {
        let empty = !around(c).any(|n| taken.contains(&n));
        match state(c) {
            Occupancy::Free => {
                all_free += 1;
                false_free += usize::from(taken.contains(&c));
                free += usize::from(empty);
            }
            Occupancy::Occupied => wrong += usize::from(empty),
            Occupancy::Unknown => {}
        }
    }
    let known: Vec<[i64; 2]> = taken
        .iter()
        .filter(|c| around(**c).any(|n| state(n) != Occupancy::Unknown))
        .copied()
        .collect();
    let found = known
        .iter()
        .filter(|c| around(**c).any(|n| state(n) == Occupancy::Occupied))
        .count();
    let on_path = walked
        .iter()
        .map(index)
        .filter(|c| state(*c) == Occupancy::Occupied && !around(*c).any(|n| taken.contains(&n)))
        .count();
    println!(
        "{} x {} cells: of {} empty known cells {:.2} % free; of {all_free} free cells {:.2} % hold something; of {} cells with something {:.2} % occupied within a cell; {on_path} of {} steps of movers occupied",
        plan.width,
        plan.height,
        free + wrong,
        100.0 * free as f64 / (free + wrong).max(1) as f64,
        100.0 * false_free as f64 / all_free.max(1) as f64,
        known.len(),
        100.0 * found as f64 / known.len().max(1) as f64,
        walked.len()
    );
    Ok(())
}

pub(super) fn points(map: &Path, file: &Path) -> Result<(), Failure> {
    let loaded = MapFile::from_bytes(&read_regular(map, 1 << 31)?)?;
    let bytes = loaded
        .extension(DenseMap::EXTENSION)
        .ok_or("a map without a surface")?;
    let map = DenseMap::from_bytes(bytes, Simd::detect())?;
    let mesh = map.mesh(&MeshOptions::default());
    let mut state = 1_u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64
    };
    let mut text = String::new();
    for _ in 0..10_000 {
        // Around the surface, up to half a metre away.
        let i = (random() * mesh.positions.len() as f64) as u32;
        let off = Vec3::from_fn(|_, _| random() - 0.5);
        let p = mesh.position(i) + off * if random() < 0.5 { 0.05 } else { 1.0 };
        let said = match map.occupancy(&p) {
            Occupancy::Occupied => 1,
            Occupancy::Free => 0,
            Occupancy::Unknown => -1,
        };
        text += &format!("{} {} {} {said}\n", p.x, p.y, p.z);
    }
    std::fs::write(file, text)?;
    Ok(())
}
