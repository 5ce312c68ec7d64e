//! `doctor`, and its findings in `run`.

use crate::common::{check, program, simulate, stderr, stdout};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

/// A command on a data set, with this camera file.
fn with_camera(command: &str, data: &Path, camera: &Path, more: &[&str]) -> Output {
    program()
        .args([command])
        .arg(data)
        .arg("--camera")
        .arg(camera)
        .args(more)
        .output()
        .unwrap()
}

/// Twelve frames: findings about the intrinsics and the depth need no motion.
#[test]
fn doctor_reports_wrong_figures_by_severity() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    simulate(&data, "xyz", 12);
    let right = data.join("camera.toml");
    let well = with_camera("doctor", &data, &right, &[]);
    check(&well, 0, &[]);
    assert!(
        stdout(&well).contains("nothing wrong was found"),
        "{well:?}"
    );

    let text = std::fs::read_to_string(&right).unwrap();
    let wrong = dir.path().join("wrong.toml");
    let changed = text
        .replace("fx = 535.0", "fx = 588.5")
        .replace("depth_scale = 5000.0", "depth_scale = 1000.0");
    assert_ne!(changed, text);
    std::fs::write(&wrong, changed).unwrap();
    let said = stdout(&with_camera("doctor", &data, &wrong, &[]));
    let scale = said.find("1. depth is too large by a factor of about 5");
    let focal = said.find("2. fx");
    assert!(scale.is_some() && focal > scale, "{said}");
    assert!(said.contains("--depth-scale 5000"), "{said}");

    let json = with_camera("doctor", &data, &wrong, &["--json", "--seconds", "1"]);
    check(&json, 1, &[]);
    let json: Value = serde_json::from_str(&stdout(&json)).unwrap();
    assert_eq!(json["findings"][0]["symptom"], "depth_scale");
    assert_eq!(json["findings"][1]["symptom"], "focal_length");

    // `run` prints the short form, unless it is quiet.
    let out = dir.path().join("out");
    let out = ["--out", out.to_str().unwrap()];
    let run = with_camera("run", &data, &wrong, &out);
    let said = stderr(&run);
    assert!(said.contains("warning: depth is too large"), "{said}");
    let quiet = with_camera("run", &data, &wrong, &[&out[..], &["-q"]].concat());
    assert!(!stderr(&quiet).contains("depth is too"), "{quiet:?}");
    let run = with_camera("run", &data, &right, &out);
    assert!(!stderr(&run).contains("warning:"), "{}", stderr(&run));
}

#[test]
fn doctor_refuses_unusable_input() {
    let dir = tempfile::tempdir().unwrap();
    let output = program().arg("doctor").arg(dir.path()).output().unwrap();
    check(&output, 2, &["error: "]);
    let output = program()
        .args(["doctor", "--seconds", "0.1"])
        .arg(dir.path())
        .output()
        .unwrap();
    check(&output, 2, &["expected 0.5 to 30 s"]);
}

/// Three seconds of a camera that turns fast, with an inertial sensor.
#[test]
fn doctor_reports_a_wrong_inertial_mount() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let args = ["-q", "simulate", "--imu", "--jpeg", "--scene", "rpy_60"];
    let output = program()
        .args(args)
        .args(["--frames", "75", "--out"])
        .arg(&data)
        .output()
        .unwrap();
    check(&output, 0, &[]);
    let right = data.join("camera.toml");
    let well = stdout(&with_camera("doctor", &data, &right, &["--json"]));
    let well: Value = serde_json::from_str(&well).unwrap();
    assert_eq!(well["findings"].as_array().unwrap().len(), 0, "{well}");
    let measured = well["measured"].to_string();
    assert!(
        measured.contains("mounted otherwise than stated by"),
        "{measured}"
    );

    let text = std::fs::read_to_string(&right).unwrap();
    let (before, after) = text.split_once("\nrotation = ").unwrap();
    let (_, after) = after.split_once('\n').unwrap();
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // A quarter turn about the optical axis.
    let turned = format!("{before}\nrotation = [0.0, 0.0, {half}, {half}]\n{after}");
    let wrong = dir.path().join("wrong.toml");
    std::fs::write(&wrong, turned).unwrap();
    let named = with_camera("doctor", &data, &wrong, &[]);
    check(&named, 1, &[]);
    let said = stdout(&named);
    assert!(
        said.contains("mounted 90 degrees otherwise than stated"),
        "{said}"
    );
    assert!(said.contains("-> state rotation = ["), "{said}");
}

/// Three seconds of a camera on a base with wheels.
#[test]
fn doctor_reports_inconsistent_odometry() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let line = "-q simulate --odometry --jpeg --scene halfsphere --frames 80 --out";
    let output = program().args(line.split(' ')).arg(&data).output().unwrap();
    check(&output, 0, &[]);
    let right = data.join("camera.toml");
    let well = stdout(&with_camera("doctor", &data, &right, &["--json"]));
    let well: Value = serde_json::from_str(&well).unwrap();
    assert_eq!(well["findings"].as_array().unwrap().len(), 0, "{well}");
    let measured = well["measured"].to_string();
    assert!(measured.contains("odometry: its clock"), "{measured}");

    let text = std::fs::read_to_string(&right).unwrap();
    let named = |camera: &Path, parts: &[&str]| {
        let output = with_camera("doctor", &data, camera, &[]);
        check(&output, 1, &[]);
        let said = stdout(&output);
        assert!(parts.iter().all(|p| said.contains(p)), "{parts:?}: {said}");
    };
    // The camera looks to the base's left, and the clock is late.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let other = |key: &str, value: &str| {
        let (before, after) = text.split_once(&format!("\n{key} = ")).unwrap();
        let (_, after) = after.split_once('\n').unwrap();
        let file = dir.path().join(format!("{key}.toml"));
        std::fs::write(&file, format!("{before}\n{key} = {value}\n{after}")).unwrap();
        file
    };
    let turned = other("rotation", &format!("[-{half}, 0.0, 0.0, {half}]"));
    named(
        &turned,
        &["degrees otherwise on the base", "-> state rotation = ["],
    );
    let late = other("time_offset", "0.1");
    named(&late, &["ms off the camera's", "-> state time_offset = "]);

    // Wheels that stand still.
    let file = data.join("odometry.csv");
    let moving = std::fs::read_to_string(&file).unwrap();
    let still = |line: &str| match line.split_once(',') {
        Some((stamp, _)) if !line.starts_with('#') => format!("{stamp},0,0,0,0,0,0,1\n"),
        _ => format!("{line}\n"),
    };
    std::fs::write(&file, moving.lines().map(still).collect::<String>()).unwrap();
    named(&right, &["odometry stands still while the camera moves"]);
}

/// Images of any size would take the doctor's time and memory: sizes that `run` refuses are refused.
#[test]
fn doctor_refuses_oversized_images() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    simulate(&data, "xyz", 2);
    let (width, height) = (2600, 1700);
    let text = std::fs::read_to_string(data.join("camera.toml")).unwrap();
    let lines = text.lines().map(|line| match line.split(" = ").next() {
        Some("width") => format!("width = {width}\n"),
        Some("height") => format!("height = {height}\n"),
        Some("cx") => "cx = 1299.5\n".to_owned(),
        Some("cy") => "cy = 849.5\n".to_owned(),
        _ => format!("{line}\n"),
    });
    let large: String = lines.collect();
    assert_ne!(large, text);
    let camera = dir.path().join("large.toml");
    std::fs::write(&camera, large).unwrap();
    let two_metres = image::Luma([10_000_u16]);
    let wall: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
        image::ImageBuffer::from_pixel(width, height, two_metres);
    for (folder, image) in [
        ("rgb", image::DynamicImage::new_luma8(width, height)),
        ("depth", wall.into()),
    ] {
        for entry in std::fs::read_dir(data.join(folder)).unwrap() {
            image.save(entry.unwrap().path()).unwrap();
        }
    }
    let refused = with_camera("doctor", &data, &camera, &[]);
    check(
        &refused,
        2,
        &["expected an image of at most", "2600 x 1700"],
    );
}
