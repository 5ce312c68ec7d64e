//! Rolling shutter, motion blur, and unchanged images with a global shutter.

use super::*;
use crate::scene::Face;
use crate::texture::tests::ramp;
use stillpoint_geometry::{BrownConrady, Camera, Se3, Vec6};

const READOUT: f64 = 0.02;
/// Turns to the right, rad/s.
const TURN: f64 = 1.0;
const FOCAL: f64 = 535.0;

/// A wall 2 m away, whose left border is on the optical axis.
fn half_a_wall() -> Scene {
    let corner = Vec3::new(0.0, 2.0, 2.0);
    let wall = Face::quad(corner, Vec3::x() * 4.0, Vec3::y() * -4.0);
    Scene::of(vec![wall], ramp())
}

fn turning() -> Path {
    Path::steady(Se3::identity(), Vec6::new(0.0, 0.0, 0.0, 0.0, TURN, 0.0))
}

fn lens(distortion: BrownConrady) -> Lens {
    let mut camera = Camera::pinhole(640, 480, [FOCAL, FOCAL, 319.5, 239.5]);
    camera.distortion = distortion;
    Lens::new(&camera)
}

/// The first column of a row with a face.
fn border(pixels: &Pixels, y: usize) -> f64 {
    let row = &pixels.inverse_depth[640 * y..640 * (y + 1)];
    row.iter().position(|w| *w > 0.0).unwrap() as f64
}

#[test]
fn rotation_shifts_rows_by_their_exposure_time() {
    let (scene, path, lens) = (half_a_wall(), turning(), lens(BrownConrady::default()));
    let sight = Sight {
        scene: &scene,
        path: &path,
        lens: &lens,
    };
    let (rolled, at_once) = (sight.pixels(0.0, READOUT), sight.pixels(0.0, 0.0));
    for y in [0, 60, 200, 240, 300, 479] {
        // Static points move left as the camera turns right, by f w t near the axis.
        let expected = -FOCAL * TURN * READOUT * (y as f64 / 480.0 - 0.5);
        let shift = border(&rolled, y) - border(&at_once, y);
        assert!(
            (shift - expected).abs() <= 1.0,
            "row {y}: {shift} px for {expected}"
        );
    }
    let skew = border(&rolled, 0) - border(&rolled, 479);
    assert!((skew - FOCAL * TURN * READOUT).abs() < 1.5, "{skew} px");
}

#[test]
fn rolling_row_equals_the_same_row_of_an_instant_image() {
    let d = BrownConrady {
        k1: -0.2,
        ..BrownConrady::default()
    };
    for lens in [lens(BrownConrady::default()), lens(d)] {
        let (scene, path) = (half_a_wall(), turning());
        let sight = Sight {
            scene: &scene,
            path: &path,
            lens: &lens,
        };
        let rolled = sight.pixels(0.0, READOUT);
        let colours = sight.exposed(0.0, READOUT, &sight.moments(&[0.0], READOUT));
        for y in [0, 100, 240, 479] {
            let time = sight.row_time(y, 0.0, READOUT);
            let whole = sight.pixels(time, 0.0);
            let row = 640 * y..640 * (y + 1);
            assert_eq!(rolled.inverse_depth[row.clone()], whole.inverse_depth[row]);
            let whole = sight.exposed(time, 0.0, &BTreeMap::new());
            let row = 3 * 640 * y..3 * 640 * (y + 1);
            assert_eq!(colours[row.clone()], whole[row]);
        }
    }
}

#[test]
fn still_camera_shows_no_shutter_effect() {
    let (scene, lens) = (Scene::office(1), lens(BrownConrady::default()));
    let office = Path::xyz(1).world_from_camera(0.0);
    let path = Path::steady(office, Vec6::zeros());
    let sight = Sight {
        scene: &scene,
        path: &path,
        lens: &lens,
    };
    assert_eq!(
        sight.pixels(0.0, READOUT).inverse_depth,
        sight.pixels(0.0, 0.0).inverse_depth
    );
    let all = Shutter {
        readout: READOUT,
        depth_readout: READOUT,
        exposure: 0.01,
    };
    assert_eq!(
        sight.colour(0.0, &all),
        sight.colour(0.0, &Shutter::default())
    );
}

#[test]
fn motion_blur_spans_the_exposure() {
    let (scene, path, lens) = (half_a_wall(), turning(), lens(BrownConrady::default()));
    let sight = Sight {
        scene: &scene,
        path: &path,
        lens: &lens,
    };
    let width = |exposure: f64| {
        let shutter = Shutter {
            exposure,
            ..Shutter::default()
        };
        let image = sight.colour(0.0, &shutter);
        // The second colour of the texture is constant along a row.
        let row: Vec<f32> = (0..640).map(|x| image[3 * (640 * 240 + x) + 1]).collect();
        let bright = row[400];
        assert!(bright > 20.0);
        let share = |low: f32| row.iter().position(|v| *v > low * bright).unwrap() as f64;
        (share(0.9) - share(0.1)) / 0.8
    };
    assert!(width(0.0) < 3.0);
    for exposure in [0.01, 0.02, 0.03] {
        let (found, expected) = (width(exposure), FOCAL * TURN * exposure);
        assert!((found - expected).abs() < 2.6, "{found} px for {expected}");
    }
    // The number of exposures is capped.
    assert_eq!(sight.exposures(0.0, 0.0), 1);
    assert!((3..=6).contains(&sight.exposures(0.0, 0.01)));
    assert_eq!(sight.exposures(0.0, 0.5), MOST_EXPOSURES);
}
