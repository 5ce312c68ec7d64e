//! Determines when each part of the surface was first seen.

use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_imaging::DepthImage;

/// Maximum depth difference of a visible surface point, m: two voxels.
const NEAR: f64 = 0.04;
/// Additional difference as a share of the depth, for depth noise.
const NEAR_SHARE: f64 = 0.02;
/// Number of rounds in which unseen points take the value of their neighbours: they lie between pixels, or at an edge.
const ROUNDS: usize = 3;
const NEVER: u32 = u32::MAX;

/// A view of the surface.
#[derive(Clone, Debug)]
pub struct Look {
    /// Image number in time order, from 0.
    pub number: u32,
    /// The final pose.
    pub world_from_camera: Se3,
    /// Depth, m, at any resolution.
    pub depth: DepthImage,
}

/// The first view that saw each point; the last view for unseen points.
#[must_use]
pub fn first_seen(
    camera: &Camera,
    looks: &[Look],
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> Vec<u32> {
    let mut since = vec![NEVER; positions.len()];
    let mut open: Vec<u32> = (0..positions.len() as u32).collect();
    for look in looks {
        let camera_from_world = look.world_from_camera.inverse();
        open.retain(|i| {
            let p = Vec3::from(positions[*i as usize].map(f64::from));
            let sees = sees(camera, look, &camera_from_world.transform(&p));
            if sees {
                since[*i as usize] = look.number;
            }
            !sees
        });
    }
    for _ in 0..ROUNDS {
        let before = since.clone();
        for t in triangles {
            let first = t.iter().map(|i| before[*i as usize]).min();
            for i in t.iter().map(|i| *i as usize) {
                if before[i] == NEVER {
                    since[i] = since[i].min(first.unwrap_or(NEVER));
                }
            }
        }
    }
    let last = looks.last().map_or(0, |l| l.number);
    since.iter().map(|s| (*s).min(last)).collect()
}

fn sees(camera: &Camera, look: &Look, p: &Vec3) -> bool {
    // Nearer than any camera measures.
    if p.z < 0.1 {
        return false;
    }
    let px = camera.project_distorted(p);
    if !camera.contains(px) {
        return false;
    }
    let (w, h) = (look.depth.width(), look.depth.height());
    let at = |c: f64, of: u32, to: usize| ((c + 0.5) * to as f64 / f64::from(of)).floor() as usize;
    let (x, y) = (at(px.x, camera.width, w), at(px.y, camera.height, h));
    if x >= w || y >= h {
        return false;
    }
    let depth = f64::from(look.depth.at(x, y));
    depth > 0.0 && (depth - p.z).abs() < NEAR + NEAR_SHARE * p.z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surface_points_appear_when_first_visible() {
        let camera = Camera::pinhole(64, 48, [60.0, 60.0, 31.5, 23.5]);
        let wall = |z: f32| DepthImage::from_vec(16, 12, vec![z; 16 * 12]).unwrap();
        let looks: Vec<Look> = [1.0, 2.0, 1.0]
            .iter()
            .zip(0..)
            .map(|(z, number)| Look {
                number,
                world_from_camera: Se3::identity(),
                depth: wall(*z),
            })
            .collect();
        let points = [
            [0.0, 0.0, 1.01],
            [0.1, 0.0, 2.0],
            [0.0, 0.0, -1.0],
            [0.12, 0.0, 2.0],
            [9.0, 0.0, 2.0],
        ];
        let since = first_seen(&camera, &looks, &points, &[[1, 3, 4]]);
        assert_eq!(since, [0, 1, 2, 1, 1]);
        assert_eq!(first_seen(&camera, &[], &points, &[]), [0; 5]);
    }
}
