//! Time to make frames of raw images: `cargo bench -p stillpoint-recordings`. The difference of the two is the time of registration.

use divan::{Bencher, black_box};
use stillpoint_geometry::{Se3, Vec3, so3};
use stillpoint_imaging::FrameId;
use stillpoint_recordings::{Pair, RawFrames};
use stillpoint_ros_messages::{CameraInfo, Image};

const SIZE: (u32, u32) = (640, 480);

fn main() {
    divan::main();
}

fn info(f: f64) -> CameraInfo<'static> {
    CameraInfo {
        width: SIZE.0,
        height: SIZE.1,
        distortion_model: "plumb_bob".into(),
        k: [f, 0.0, 319.5, 0.0, f, 239.5, 0.0, 0.0, 1.0],
        ..CameraInfo::default()
    }
}

fn image(encoding: &'static str, bytes: u32, data: Vec<u8>) -> Image<'static> {
    Image {
        width: SIZE.0,
        height: SIZE.1,
        encoding: encoding.into(),
        step: SIZE.0 * bytes,
        data: data.into(),
        ..Image::default()
    }
}

/// A room of 1 to 4 m with steps and without holes, seen by `pair`'s cameras.
fn frames(bencher: Bencher<'_, '_>, colour_from_depth: Option<Se3>, d: &[f64], size: f64) {
    let mut pair = Pair {
        name: "bench".to_owned(),
        colour: info(610.0),
        depth: info(610.0 * size),
        colour_from_depth,
        depth_scale: None,
    };
    pair.colour.d = d.to_vec();
    let raw = RawFrames::new(&pair).expect("calibrated cameras");
    let colour = image("rgb8", 3, vec![100; (SIZE.0 * SIZE.1 * 3) as usize]);
    let z = |i: u32| (1000 + (i % SIZE.0) * 3 + (i / 20_000) * 70) as u16;
    let depth = (0..SIZE.0 * SIZE.1).flat_map(|i| z(i).to_le_bytes());
    let depth = image("16UC1", 2, depth.collect());
    bencher.bench_local(|| {
        raw.frame(
            FrameId(0),
            (0.0, 0.0),
            black_box(&colour),
            black_box(&depth),
            false,
        )
    });
}

#[divan::bench]
fn depth_in_the_colour_camera(bencher: Bencher<'_, '_>) {
    frames(bencher, None, &[0.0; 5], 1.0);
}

fn beside() -> Option<Se3> {
    let turned = so3::exp(&Vec3::new(0.003, -0.005, 0.001));
    Some(Se3::new(turned, Vec3::new(0.015, 0.0, 0.0)))
}

/// As on a RealSense D435: different focal lengths, 15 mm baseline.
#[divan::bench]
fn depth_registered(bencher: Bencher<'_, '_>) {
    frames(bencher, beside(), &[0.0; 5], 0.63);
}

#[divan::bench]
fn depth_registered_with_distortion(bencher: Bencher<'_, '_>) {
    frames(bencher, beside(), &[0.1, -0.2, 0.001, 0.0005, 0.05], 0.63);
}
