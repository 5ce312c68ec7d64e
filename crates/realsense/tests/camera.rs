//! Recordings of RealSense cameras, played by librealsense and read by this project. They need `STILLPOINT_REALSENSE`; the library of
//! PyPI's `pyrealsense2` loads only if libpython was loaded before (`LD_PRELOAD`).

use std::path::PathBuf;
use stillpoint_imaging::{FrameSource, ImuSample, RgbdFrame};
use stillpoint_realsense::{Options, RealSense, VARIABLE};
use stillpoint_recordings::{Device, FrameOptions, OpenOptions, open};

/// A recording, and the same as a camera played by librealsense.
fn played(path: PathBuf) -> Option<(RealSense, PathBuf)> {
    if std::env::var_os(VARIABLE).is_none() {
        stillpoint_testdata::skipped("STILLPOINT_REALSENSE names no librealsense");
        return None;
    }
    let options = Options {
        playback: Some(path.clone()),
        ..Options::default()
    };
    let camera = RealSense::open(&options).unwrap_or_else(|e| panic!("{e}"));
    Some((camera, path))
}

fn all(mut source: impl FrameSource) -> Vec<RgbdFrame> {
    std::iter::from_fn(|| source.next_frame())
        .map(Result::unwrap)
        .collect()
}

struct Boxed(Box<dyn FrameSource>);

impl FrameSource for Boxed {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, stillpoint_imaging::SourceError>> {
        self.0.next_frame()
    }
}

/// With `STILLPOINT_REALSENSE_INERTIAL`, a recording that `tools/recordings/software_realsense.py` made of `stillpoint simulate --imu`.
#[test]
fn inertial_samples_come_between_the_frames() {
    let Some(path) = std::env::var_os("STILLPOINT_REALSENSE_INERTIAL") else {
        stillpoint_testdata::skipped(
            "STILLPOINT_REALSENSE_INERTIAL names no recording with an inertial sensor",
        );
        return;
    };
    let Some((camera, _)) = played(path.into()) else {
        return;
    };
    let said = camera.guesses().join("; ");
    assert!(said.contains("inertial sensor: "), "{said}");
    let mut frames = camera.frames(false).unwrap();
    let (mut count, mut samples) = (0, Vec::new());
    while let Some(frame) = frames.next_frame() {
        let stamp = frame.unwrap().stamp;
        count += 1;
        samples.extend(frames.take_inertial());
        let newest = samples.last().map_or(0.0, |s: &ImuSample| s.stamp);
        assert!((stamp - newest).abs() < 0.1, "{stamp} {newest}");
    }
    assert!(
        count > 10 && samples.len() > 5 * (count - 1),
        "{count} {}",
        samples.len()
    );
    assert!(samples.is_sorted_by(|a, b| a.stamp < b.stamp));
    for s in &samples {
        let force = s.specific_force.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!((7.0..13.0).contains(&force), "{s:?}");
    }
    assert!(samples.iter().any(|s| s.angular_rate[1].abs() > 0.1));
    // Images are the same as without it.
    let plain = Options {
        playback: std::env::var_os("STILLPOINT_REALSENSE_INERTIAL").map(PathBuf::from),
        inertial: false,
        ..Options::default()
    };
    let plain = RealSense::open(&plain).unwrap();
    assert!(!plain.guesses().join("; ").contains("inertial"));
    assert!(plain.frames(false).unwrap().take_inertial().is_empty());
}

#[test]
fn recorded_camera_gives_the_file_content() {
    let Some(path) = stillpoint_testdata::beside("data/recordings/d435_640x480.bag") else {
        return;
    };
    let Some((camera, path)) = played(path) else {
        return;
    };
    assert!(
        camera.guesses()[0].contains("D435"),
        "{:?}",
        camera.guesses()
    );
    assert_eq!(camera.camera().depth_scale, 1000.0);
    let found = all(Boxed(camera.frames(true).unwrap()));
    assert!(camera.frames(true).is_err(), "its frames are given once");
    // The first colour image is farther from its depth image than a data set's frame may be.
    let options = OpenOptions {
        max_dt: 0.2,
        ..OpenOptions::default()
    };
    let input = open(&path, &options).unwrap();
    let colours = FrameOptions {
        keep_colour: true,
        ..FrameOptions::default()
    };
    let expected = all(input.frames(&colours).unwrap());
    let (a, b) = (camera.camera().camera, input.camera().camera);
    assert!(
        (a.fx - b.fx).abs() < 1e-4 && (a.cy - b.cy).abs() < 1e-4,
        "{a:?} {b:?}"
    );
    // It contains one pair of images: the colour image, and the second depth image, registered to the colour camera by `rs.align`.
    let [frame] = found.as_slice() else {
        panic!("{} frames", found.len());
    };
    assert_eq!(frame.stamp, expected[0].stamp);
    assert_eq!(frame.gray.data(), expected[0].gray.data());
    assert_eq!(
        frame.colour.as_ref().unwrap().data(),
        expected[0].colour.as_ref().unwrap().data()
    );
    let aligned = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../recordings/tests/golden/d435_aligned.png"
    );
    let aligned = image::open(aligned).unwrap().into_luma16();
    let (mut both, mut near, mut either) = (0, 0, 0);
    for (ours, theirs) in frame.depth.data().iter().zip(aligned.pixels()) {
        let theirs = f32::from(theirs.0[0]) / 1000.0;
        either += i32::from(*ours > 0.0 || theirs > 0.0);
        both += i32::from(*ours > 0.0 && theirs > 0.0);
        // Its depths are along the depth camera's axis, which differs by some mm.
        near += i32::from(*ours > 0.0 && (ours - theirs).abs() < 0.01 * theirs);
    }
    assert!(
        both * 100 > either * 98 && near * 100 > both * 98,
        "{near} {both} {either}"
    );
}
