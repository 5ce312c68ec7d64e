//! Which cameras can be computed with.

use crate::laws::fr1;
use stillpoint_geometry::{BrownConrady, Camera, Vec2};

/// The camera of Freiburg 1 with the five numbers given.
fn with_lens([k1, k2, p1, p2, k3]: [f64; 5]) -> Camera {
    Camera {
        distortion: BrownConrady { k1, k2, p1, p2, k3 },
        ..fr1()
    }
}

#[test]
fn real_lenses_can_be_inverted() {
    assert_eq!(fr1().check(), Ok(()));
    assert_eq!(fr1().rectified().check(), Ok(()));
    // A wide webcam, a pincushion, and a lens that is decentred.
    for lens in [
        [-0.35, 0.12, 0.0, 0.0, -0.02],
        [0.3, 0.1, 0.0, 0.0, 0.0],
        [0.05, -0.02, 0.01, -0.01, 0.0],
    ] {
        assert_eq!(with_lens(lens).check(), Ok(()), "{lens:?}");
    }
}

#[test]
fn a_lens_that_folds_within_the_image_is_refused() {
    // That of Freiburg 1 without its last coefficient bends back before the corners.
    let forgotten = with_lens([0.2624, -0.9531, -0.0054, 0.0026, 0.0]);
    let said = forgotten.check().unwrap_err().to_string();
    for part in ["k2 = -0.9531", "k3 is 0: was it left out?", "pixel (0, 0)"] {
        assert!(said.contains(part), "{said}");
    }
    for lens in [
        [-1.5, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 2.0, 0.0, 0.1],
        [1e100, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, -1e300],
        [-1e8, 1e8, -1e8, 1e8, -1e8],
    ] {
        let said = with_lens(lens).check().unwrap_err().to_string();
        assert!(
            said.contains("can be inverted within the image"),
            "{lens:?}: {said}"
        );
    }
    // The same lens before a sensor that sees only its middle is well.
    let narrow = Camera {
        fx: 1500.0,
        fy: 1500.0,
        ..forgotten
    };
    assert_eq!(narrow.check(), Ok(()));
}

#[test]
fn figures_that_are_no_camera_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e100] {
        for camera in [Camera { fx: bad, ..fr1() }, Camera { fy: bad, ..fr1() }] {
            let said = camera.check().unwrap_err().to_string();
            assert!(said.contains("focal lengths"), "{said}");
        }
    }
    assert!(Camera { cx: 1e100, ..fr1() }.check().is_err());
    assert!(with_lens([0.0, f64::NAN, 0.0, 0.0, 0.0]).check().is_err());
    for (width, height) in [(0, 480), (640, 0), (1 << 16, 480), (u32::MAX, u32::MAX)] {
        let camera = Camera {
            width,
            height,
            ..fr1()
        };
        let said = camera.check().unwrap_err().to_string();
        assert!(said.contains("px per side"), "{said}");
        // Asked all the same, it says something and does not fail.
        assert!(width > 0 || !camera.contains(Vec2::new(0.0, 0.0)));
    }
}
