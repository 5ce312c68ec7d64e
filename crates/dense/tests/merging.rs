//! Merges two maps of one room, each in its own axes.

use crate::room::{config, simulator};
use stillpoint_dense::{
    DenseConfig, DenseMap, Floor, Fuser, Mesh, MeshOptions, Occupancy, Plan, PlanOptions,
};
use stillpoint_geometry::{Se3, Vec3, Vec6};
use stillpoint_imaging::Simd;
use stillpoint_simulator::{Simulator, Surfaces, share_near};

const FRAMES: usize = 60;

/// Some frames of a room at true poses, in transformed axes.
fn fused(
    room: &Simulator,
    frames: impl Iterator<Item = usize>,
    voxel: f64,
    map_from_truth: &Se3,
) -> DenseMap {
    let config = DenseConfig { voxel, ..config() };
    let mut fuser = Fuser::new(&config, room.camera(), Simd::detect()).unwrap();
    for i in frames {
        let pose = *map_from_truth * room.world_from_camera(room.depth_stamp(i));
        fuser.add(&room.frame_with_colour(i), &[], &pose);
    }
    fuser.map().clone()
}

/// Mean distance of the measured surface to the true one, and the share beyond 10 cm.
fn errors(room: &Simulator, map: &DenseMap) -> [f64; 2] {
    let truth = Surfaces::new(room.static_surfaces());
    let mesh = map.mesh(&MeshOptions::default());
    let points = (0..mesh.positions.len() as u32).map(|i| mesh.position(i));
    let points = points.filter(|p| map.distance(p).is_some());
    let errors: Vec<f64> = points.map(|p| truth.distance(&p)).collect();
    let n = errors.len() as f64;
    let far = errors.iter().filter(|e| **e > 0.1).count() as f64;
    [errors.iter().sum::<f64>() / n, far / n]
}

/// The share of a mesh's vertices that have one of another mesh within a distance, m.
fn covered(mesh: &Mesh, by: &DenseMap, within: f64) -> f64 {
    let corners = |mesh: &Mesh| -> Vec<Vec3> {
        let all = 0..mesh.positions.len() as u32;
        all.map(|i| mesh.position(i)).collect()
    };
    let by = by.mesh(&MeshOptions::default());
    share_near(&corners(mesh), &corners(&by), within)
}

/// For the known cells of a plan: those equal in another one, those occupied here and free there, and the others.
fn compared(one: &Plan, other: &Plan) -> [usize; 3] {
    let mut counts = [0; 3];
    let world_from_level = one.floor.level_from_world().transpose();
    for (i, known) in one.cells.iter().enumerate() {
        let middle = |k: usize, n: usize| one.origin[k] + (n as f64 + 0.5) * one.resolution;
        let p = Vec3::new(middle(0, i % one.width), middle(1, i / one.width), 0.0);
        let kind = match (known, other.at(&(world_from_level * p))) {
            (Occupancy::Unknown, _) => continue,
            (a, b) if *a == b => 0,
            (Occupancy::Occupied, Occupancy::Free) => 1,
            _ => 2,
        };
        counts[kind] += 1;
    }
    counts
}

/// The second part has voxels of the same size, or of another.
#[test]
fn two_parts_of_a_room_merge_accurately() {
    let room = simulator("halfsphere", FRAMES);
    let (truth, half) = (Se3::identity(), FRAMES / 2);
    let turned = Se3::exp(&Vec6::new(1.3, -0.7, 0.4, 0.4, -1.1, 0.6));
    let of = |from: usize, to: usize| (from..to).step_by(2);
    let [first, whole] = [half, FRAMES].map(|to| fused(&room, of(0, to), 0.04, &truth));
    let mesh = whole.mesh(&MeshOptions::default());
    let in_one_run = errors(&room, &whole);
    let floor = Floor::find(&mesh, &Vec3::z()).unwrap();
    let plan = |map: &DenseMap| map.plan(&floor, &PlanOptions::default()).unwrap();
    for voxel in [0.04, 0.03] {
        let second = fused(&room, of(half, FRAMES), voxel, &turned);
        let mut map = first.clone();
        map.absorb(&second, &turned.inverse()).unwrap();
        let both = errors(&room, &map);
        println!("mean error, m, and share beyond 10 cm: {both:?}, in one run {in_one_run:?}");
        assert!(
            both[0] < in_one_run[0] + 0.001 && both[1] < 0.002,
            "{both:?}"
        );
        let [alone, there] = [&first, &map].map(|map| covered(&mesh, map, 0.04));
        println!("of the surface of one run {there} is there, {alone} by the first part");
        assert!(there > 0.94 && alone < 0.6, "{there} {alone}");
        // Control: merged without the transform.
        let mut wrong = first.clone();
        wrong.absorb(&second, &truth).unwrap();
        let wrong = errors(&room, &wrong);
        assert!(wrong[0] > 0.05 && wrong[1] > 0.1, "{wrong:?}");
        let [alike, contrary, lost] = compared(&plan(&whole), &plan(&map));
        println!("plan: {alike} cells alike, {contrary} occupied and called free, {lost} lost");
        assert!(
            alike > 8 * lost && alike > 100 * contrary,
            "{alike} {contrary} {lost}"
        );
    }
}
