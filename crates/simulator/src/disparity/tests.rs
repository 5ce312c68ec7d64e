//! Statistics of a structured-light camera's errors, on walls.

use super::*;
use crate::lens::Lens;
use crate::path::Path;
use crate::scene::{Face, Scene};
use crate::shutter::Sight;
use crate::texture::tests::ramp;
use stillpoint_geometry::{Camera, Se3, Vec3, Vec6};

const FOCAL: f32 = 535.0;

/// Measures a scene from its origin, looking along z.
fn measure(faces: Vec<Face>, index: u64) -> Vec<f32> {
    let focal = f64::from(FOCAL);
    let lens = Lens::new(&Camera::pinhole(640, 480, [focal, focal, 319.5, 239.5]));
    let (scene, path) = (
        Scene::of(faces, ramp()),
        Path::steady(Se3::identity(), Vec6::zeros()),
    );
    let sight = Sight {
        scene: &scene,
        path: &path,
        lens: &lens,
    };
    let pixels = sight.pixels(0.0, 0.0);
    Sensor::new(&lens, 7).match_pattern(&pixels, FOCAL, index)
}

fn wall(z: f64) -> Face {
    let corner = Vec3::new(-2.0 * z, 2.0 * z, z);
    Face::quad(corner, Vec3::x() * 4.0 * z, Vec3::y() * -4.0 * z)
}

/// Disparity errors of a wall at `z`, px, by pixel.
fn errors(depth: &[f32], z: f32) -> Vec<Option<f64>> {
    let disparity = |z: f32| f64::from(FOCAL * BASELINE / z);
    let error = |found: &f32| (*found > 0.0).then(|| disparity(*found) - disparity(z));
    depth.iter().map(error).collect()
}

/// Mean product of the errors of pixels that are `step` apart.
fn covariance(errors: &[Option<f64>], step: usize) -> f64 {
    let pairs = errors.iter().zip(&errors[step..]);
    let products: Vec<f64> = pairs.filter_map(|(a, b)| Some((*a)? * (*b)?)).collect();
    products.iter().sum::<f64>() / products.len() as f64
}

#[test]
fn disparity_errors_follow_the_model_at_any_depth() {
    for z in [0.9_f32, 2.0, 4.0] {
        let depth = measure(vec![wall(f64::from(z))], 1);
        let errors = errors(&depth, z);
        let own = f64::from(OWN * OWN + DISPARITY_STEP * DISPARITY_STEP / 12.0);
        let shared = f64::from(SHARED * SHARED + PATTERN * PATTERN);
        let all = covariance(&errors, 0);
        assert!((all / (own + shared) - 1.0).abs() < 0.3, "{z} m: {all}");
        // Neighbours share errors that averaging does not remove; distant pixels share none.
        let near = covariance(&errors, 1);
        assert!(near > 0.5 * shared, "{z} m: {near} of {shared}");
        assert!(covariance(&errors, 250).abs() < 0.3 * shared);
    }
}

#[test]
fn fixed_pattern_noise_is_common_to_all_images() {
    let of = |index| errors(&measure(vec![wall(2.0)], index), 2.0);
    let (a, b) = (of(1), of(2));
    let same: Vec<f64> = a
        .iter()
        .zip(&b)
        .filter_map(|(a, b)| Some((*a)? * (*b)?))
        .collect();
    let same = same.iter().sum::<f64>() / same.len() as f64;
    let pattern = f64::from(PATTERN * PATTERN);
    assert!(
        (0.4..1.8).contains(&(same / pattern)),
        "{same} of {pattern}"
    );
}

#[test]
fn depth_borders_are_displaced_sideways() {
    // A board at 1 m before a wall at 2 m; its left border is at column 266, its right one at 373.
    let board = Face::quad(Vec3::new(-0.1, 2.0, 1.0), Vec3::x() * 0.2, Vec3::y() * -4.0);
    let depth = measure(vec![wall(2.0), board], 1);
    let (mut wide, mut narrow, mut n) = (0, 0, 0);
    for y in 40..470 {
        let near = |x: usize| (0.5..1.5).contains(&depth[640 * y + x]);
        // The pixels outside and inside of the right border, which has no shadow.
        wide += usize::from(near(373));
        narrow += usize::from(depth[640 * y + 372] > 1.5);
        n += 1;
        // Far from borders there is one depth.
        assert!(!near(390) && (near(320) || depth[640 * y + 320] == 0.0));
        // The projector's shadow is on the left.
        assert!(!(240..262).any(|x| depth[640 * y + x] > 1.5 && x > 255));
    }
    for swapped in [wide, narrow] {
        assert!((10..45).contains(&(100 * swapped / n)), "{swapped} of {n}");
    }
}

#[test]
fn faces_at_grazing_angles_have_no_depth() {
    // Walls along the line of sight, at an angle of 70 and of 84 degrees to it.
    let aslant = |degrees: f64| {
        let (sin, cos) = (
            libm::sin(degrees.to_radians()),
            libm::cos(degrees.to_radians()),
        );
        let right = Vec3::new(cos, 0.0, sin);
        let centre = Vec3::new(0.0, 0.0, 1.2);
        let corner = centre - right * 0.5 + Vec3::y();
        let depth = measure(vec![Face::quad(corner, right, Vec3::y() * -2.0)], 1);
        (100..400).filter(|y| depth[640 * y + 319] > 0.0).count()
    };
    assert!(aslant(60.0) > 250, "{}", aslant(60.0));
    assert!(aslant(86.0) < 10, "{}", aslant(86.0));
}
