//! Time to read and decode one frame of 640 x 480, by kind of file: `cargo bench -p stillpoint-datasets`. Uses real images of `fr1_xyz` if
//! available (see the README on data), else rendered gradients with noise.

use divan::Bencher;
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb};
use std::path::{Path, PathBuf};
use stillpoint_datasets::{read_depth, read_gray};

fn main() {
    divan::main();
}

/// A colour and a depth image with roughly the entropy of real ones.
fn images() -> (DynamicImage, DynamicImage) {
    let data = std::env::var_os("STILLPOINT_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let first = |sub: &str| {
        let mut names: Vec<PathBuf> = std::fs::read_dir(data.join("fr1_xyz").join(sub))
            .ok()?
            .filter_map(|e| Some(e.ok()?.path()))
            .collect();
        names.sort();
        image::open(names.first()?).ok()
    };
    if let (Some(colour), Some(depth)) = (first("rgb"), first("depth")) {
        return (colour, depth);
    }
    let noise = |x: u32, y: u32| (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503)) >> 13 & 7;
    let colour = ImageBuffer::from_fn(640, 480, |x, y| {
        let n = noise(x, y);
        Rgb([
            (x / 3 + n) as u8,
            (y / 2 + n) as u8,
            ((x + y) / 5 + n) as u8,
        ])
    });
    let depth = ImageBuffer::from_fn(640, 480, |x, y| {
        Luma([(5000 + 10 * x + 7 * y + 16 * noise(x, y)) as u16])
    });
    (colour.into(), DynamicImage::ImageLuma16(depth))
}

fn bench_gray(bencher: Bencher<'_, '_>, format: ImageFormat) {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("image");
    let (colour, _) = images();
    colour
        .into_rgb8()
        .save_with_format(&path, format)
        .expect("to write an image");
    bencher.bench(|| read_gray(Path::new(&path)).expect("an image"));
}

#[divan::bench]
fn colour_jpeg(bencher: Bencher<'_, '_>) {
    bench_gray(bencher, ImageFormat::Jpeg);
}

#[divan::bench]
fn colour_png(bencher: Bencher<'_, '_>) {
    bench_gray(bencher, ImageFormat::Png);
}

#[divan::bench]
fn colour_webp(bencher: Bencher<'_, '_>) {
    bench_gray(bencher, ImageFormat::WebP);
}

#[divan::bench]
fn depth_png(bencher: Bencher<'_, '_>) {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("depth.png");
    images().1.save(&path).expect("to write an image");
    bencher.bench(|| read_depth(&path, 5000.0).expect("a depth image"));
}
