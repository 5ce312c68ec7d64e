//! Acceptance and rejection of cameras.

use crate::laws::fr1;
use stillpoint_geometry::{BrownConrady, Camera, Vec2};

/// The Freiburg 1 camera with other coefficients.
fn with_lens([k1, k2, p1, p2, k3]: [f64; 5]) -> Camera {
    Camera {
        distortion: BrownConrady { k1, k2, p1, p2, k3 },
        ..fr1()
    }
}

#[test]
fn real_lenses_are_accepted() {
    assert_eq!(fr1().check(), Ok(()));
    assert_eq!(fr1().rectified().check(), Ok(()));
    // A wide webcam, a pincushion and a decentred lens.
    for lens in [
        [-0.35, 0.12, 0.0, 0.0, -0.02],
        [0.3, 0.1, 0.0, 0.0, 0.0],
        [0.05, -0.02, 0.01, -0.01, 0.0],
    ] {
        assert_eq!(with_lens(lens).check(), Ok(()), "{lens:?}");
    }
}

#[test]
fn lens_folding_within_the_image_is_refused() {
    // Freiburg 1 without its last coefficient folds before the corners.
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
    // The same lens with a sensor that sees only its middle is valid.
    let narrow = Camera {
        fx: 1500.0,
        fy: 1500.0,
        ..forgotten
    };
    assert_eq!(narrow.check(), Ok(()));
}

#[test]
fn invalid_camera_parameters_are_refused() {
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
        // `contains` must not panic on such a camera.
        assert!(width > 0 || !camera.contains(Vec2::new(0.0, 0.0)));
    }
}

#[test]
fn implausible_camera_parameters_are_refused_by_name() {
    let fr1 = || fr1().rectified();
    for (camera, parts) in [
        (
            Camera {
                cx: 0.0,
                cy: 0.0,
                ..fr1()
            },
            ["cx = 0.0", "64 to 575 px"],
        ),
        (Camera { cy: 3.0, ..fr1() }, ["cy = 3.0", "48 to 431 px"]),
        (
            Camera { cx: 639.0, ..fr1() },
            ["cx = 639.0", "principal point"],
        ),
        (
            Camera { cx: -1e6, ..fr1() },
            ["cx = -1000000.0", "principal point"],
        ),
        (Camera { fy: 1.0, ..fr1() }, ["fy = 1.0", "factor of 2"]),
        (
            Camera {
                fx: 1600.0,
                ..fr1()
            },
            ["fx = 1600.0", "factor of 2"],
        ),
        (
            Camera {
                fx: 1e-300,
                fy: 1e-300,
                ..fr1()
            },
            ["fx = 1e-300", "from 1 px on"],
        ),
        (
            Camera {
                fx: 60.0,
                fy: 60.0,
                ..fr1()
            },
            ["fx = 60.0", "80 to 6400 px"],
        ),
        (
            Camera {
                fx: 2e4,
                fy: 2e4,
                ..fr1()
            },
            ["fx = 20000.0", "640 x 480 px"],
        ),
    ] {
        let said = camera.check().unwrap_err().to_string();
        assert!(parts.iter().all(|p| said.contains(p)), "{said}");
    }
}

#[test]
fn unusual_cameras_are_accepted() {
    for (size, k) in [
        // A fisheye of 190 degrees on 848 x 800, and one of 220 whose circle is as high as the image.
        ([848, 800], [286.0, 286.0, 424.0, 400.0]),
        ([1280, 720], [187.5, 187.5, 640.0, 360.0]),
        // Cropped images: principal point off by a third of the sides; a strip.
        ([320, 240], [520.0, 520.0, 266.0, 40.0]),
        ([640, 64], [520.0, 520.0, 320.0, 30.0]),
        // One field of an interlaced image; a lens of 12 degrees.
        ([640, 240], [520.0, 260.0, 320.0, 120.0]),
        ([1280, 1024], [6000.0, 6000.0, 640.0, 512.0]),
    ] {
        let camera = Camera::pinhole(size[0], size[1], k);
        assert_eq!(camera.check(), Ok(()), "{size:?} {k:?}");
    }
}
