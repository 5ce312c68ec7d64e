//! Tests of internals.

use super::*;
use crate::raster::View;
use stillpoint_geometry::Vec3;

/// Ideal bytes and inverse depths of a view from any pose.
fn look(sim: &Simulator, pose: &Se3) -> (Vec<u8>, Vec<f32>) {
    let (w, h) = (sim.camera.width as usize, sim.camera.height as usize);
    let view = View::new(sim.scene.fixed().iter(), &sim.lens.rendered, pose, 2);
    let mut ideal = vec![0.0_f32; 3 * w * h];
    for (y, row) in ideal.chunks_exact_mut(3 * w).enumerate() {
        view.shade_row(&sim.scene, &sim.lens, y, row);
    }
    let depth = View::new(sim.scene.fixed().iter(), &sim.lens.rendered, pose, 1);
    (
        ideal.iter().map(|v| (v + 0.5) as u8).collect(),
        depth.inverse_depth,
    )
}

/// Views from the first room equal those from the same place of the second, except for rounding at edges. Only the corridor's ends differ,
/// and are invisible from the rooms.
#[test]
fn equal_rooms_render_identically() {
    let sim = Simulator::new(&SimulatorConfig {
        scene: "equal_rooms".to_owned(),
        seed: 3,
        ..SimulatorConfig::default()
    })
    .unwrap();
    let other_from_one = Se3::new(
        Default::default(),
        Vec3::new(Scene::EQUAL_ROOMS_SHIFT, 0.0, 0.0),
    );
    for t in [0.0, 2.0, 4.0, 6.0, 8.0, 10.0] {
        let pose = sim.world_from_camera(t);
        assert!(pose.translation.y > 0.2 && pose.translation.x < 2.0);
        let (bytes, depth) = look(&sim, &pose);
        let (other, other_depth) = look(&sim, &(other_from_one * pose));
        let far = bytes
            .iter()
            .zip(&other)
            .filter(|(a, b)| a.abs_diff(**b) > 2);
        let far_depth = depth
            .iter()
            .zip(&other_depth)
            .filter(|(a, b)| (**a - **b).abs() > 1e-4);
        let (far, far_depth) = (far.count(), far_depth.count());
        assert!(far < 300, "at {t} s: {far} of 921600 bytes");
        assert!(far_depth < 30, "at {t} s: {far_depth} of 307200 depths");
        // There is enough texture to compare.
        let mean = bytes.iter().map(|v| f64::from(*v)).sum::<f64>() / bytes.len() as f64;
        assert!(bytes.iter().filter(|v| f64::from(**v) > 1.3 * mean).count() > 50_000);
    }
}

/// A pixel whose four colour samples see one mover (or none) has that mover in the mask, except for slivers thinner than half a pixel.
#[test]
fn masks_agree_with_the_colour_image() {
    let sim = Simulator::new(&SimulatorConfig {
        scene: "walking_rpy".to_owned(),
        ..SimulatorConfig::default()
    })
    .unwrap();
    for index in [40, 100, 260] {
        let (mut fine, truth) = (sim.sight().faces(sim.stamp(index), 2), sim.truth(index));
        fine.draw(0..480);
        let mover = |x: usize, y: usize| {
            let number = fine.face[y * fine.width + x] as usize;
            fine.faces.get(number).map_or(0, |f| f.mover)
        };
        let (mut unmixed, mut other) = (0, 0);
        for y in 0..480 {
            for x in 0..640 {
                let (u, v) = (2 * x, 2 * y);
                let seen = mover(u, v);
                let rest = [mover(u + 1, v), mover(u, v + 1), mover(u + 1, v + 1)];
                if rest.iter().all(|m| *m == seen) {
                    unmixed += 1;
                    other += usize::from(truth.mask.at(x, y) != seen);
                }
            }
        }
        assert!(unmixed > 295_000, "{unmixed}");
        assert!(other < 10, "{other} of {unmixed}");
    }
}
