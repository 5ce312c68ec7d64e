use super::*;
use proptest::prelude::*;

#[test]
fn presets_parse_and_match_published_values() {
    for name in CameraModel::preset_names() {
        let m = CameraModel::preset(name).unwrap();
        assert_eq!(m.name, name);
        let size = (m.camera.width, m.camera.height);
        assert!(
            size == (640, 480) || (size == (1280, 720) && m.nominal),
            "{name}"
        );
    }
    let fr1 = CameraModel::preset("freiburg1").unwrap();
    assert_eq!(fr1.camera.distortion.k3, 1.163314);
    assert_eq!(CameraModel::preset("fr2").unwrap().depth_scale, 5208.0);
    assert_eq!(
        CameraModel::preset("seven_scenes").unwrap().depth_scale,
        1000.0
    );
    assert_eq!(
        CameraModel::preset("bonn_calibrated").unwrap().depth_scale,
        4720.0
    );
    assert!(!fr1.nominal);
    // From its field of view; the device of a recording has 613.2 px.
    let d435 = CameraModel::preset("d435").unwrap();
    assert!(d435.nominal && (d435.camera.fx / 613.2 - 1.0).abs() < 0.03);
}

#[test]
fn unknown_presets_list_the_choices() {
    let e = CameraModel::choose(&CameraChoice::from_argument("fr9"))
        .unwrap_err()
        .to_string();
    assert!(
        e.contains("fr9") && e.contains("tum_fr1, tum_fr2") && e.contains("seven_scenes"),
        "{e}"
    );
}

#[test]
fn malformed_camera_files_report_line_and_reason() {
    let toml = |t: &str| {
        CameraModel::parse_toml(t, Path::new("camera.toml"))
            .unwrap_err()
            .to_string()
    };
    let text = |t: &str| {
        CameraModel::parse_text(t, Path::new("camera.txt"))
            .unwrap_err()
            .to_string()
    };
    let good = "fx = 500.0\nfy = 500.0\ncx = 320.0\ncy = 240.0\ndepth_scale = 5000.0\n";
    assert!(toml(&format!("{good}fz = 1.0\n")).contains("camera.toml:6:"));
    assert!(toml("fx = 500.0\n").contains("fy"));
    assert!(toml(&good.replace("5000.0", "0.0")).contains("depth_scale above 0"));
    assert!(toml(&good.replacen("500.0", "-1.0", 1)).contains("focal lengths"));
    assert!(toml(&format!("width = 640\n{good}")).contains("both width and height"));
    // Freiburg 1 without k3, with values after it, and with a power too many.
    let lens = |values: &str| format!("width = 640\nheight = 480\n{good}distortion = {values}\n");
    let folded = toml(&lens("[0.2624, -0.9531, -0.0054, 0.0026, 0.0]"));
    assert!(folded.contains("k3 is 0: was it left out?"), "{folded}");
    for (values, part) in [
        ("[0.26, -0.95, 0.0, 0.0]", "4 values; add k3"),
        ("[0.26, -0.95, 0.0, 0.0, 1.16, 0.1]", "6 values; calibrate"),
        ("[0.26, -0.95, 0.0, 0.0, 1.16, 0.0, 0.0]", "7 values"),
        ("[]", "0 values"),
        ("[1e100, 0.0, 0.0, 0.0, 0.0]", "k1 = 1e100"),
        ("[inf, 0.0, 0.0, 0.0, 0.0]", "finite distortion"),
    ] {
        let e = toml(&lens(values));
        assert!(e.contains(part), "{e}");
    }
    assert!(toml(&lens("[1.0]")).contains("camera.toml:8:"));
    assert!(text("# only a comment\n").contains("no such line"));
    assert!(text("# c\n500 500 320 240\n").contains("camera.txt:2:"));
    assert!(text("500 500 320 240 5000\n1 2 3 4 5\n").contains("a second line"));
    assert!(text("500 500 320 240 -5\n").contains("depth_scale"));
    let ok =
        CameraModel::parse_text("# c\n585 585 320 240 5000\n", Path::new("camera.txt")).unwrap();
    assert_eq!((ok.camera.fx, ok.depth_scale), (585.0, 5000.0));
}

proptest! {
    #[test]
    fn camera_model_round_trips_through_toml(f in 1.0..2000.0f64, c in -10.0..1000.0f64, k in -2.0..2.0f64, s in 1.0..1e5f64, name in "\\PC{0,20}") {
        // Without a size, since not every lens is invertible in every image.
        let m = CameraModel {
            name,
            camera: Camera { distortion: BrownConrady { k1: k, k2: -k, p1: 1e-300 * k, p2: 0.0, k3: k * k },
                ..Camera::pinhole(0, 0, [f, f + 1.0, c, c]) },
            depth_scale: s,
            nominal: s > 5e4,
            imu: None,
            odometry: None,
        };
        let back = CameraModel::parse_toml(&m.to_toml(), Path::new("c.toml")).unwrap();
        prop_assert_eq!(back.camera, m.camera);
        prop_assert_eq!(back.depth_scale, m.depth_scale);
        prop_assert_eq!(back.nominal, m.nominal);
    }

    #[test]
    fn random_text_never_panics(text in "\\PC{0,100}", tail in proptest::collection::vec(any::<u8>(), 0..50)) {
        let text = text + &String::from_utf8_lossy(&tail);
        let _ = CameraModel::parse_toml(&text, Path::new("c"));
        let _ = CameraModel::parse_text(&text, Path::new("c"));
    }
}
