//! `render`: a run as an animation.

use crate::common::{check, copy, stderr, stdout, stillpoint};
use crate::report::{FRAMES, MADE, text};
use image::codecs::webp::WebPDecoder;
use image::{AnimationDecoder, RgbImage};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::LazyLock;

/// Every third frame is shown.
const SHOWN: usize = FRAMES / 3;
/// Width and height of the left half, px.
const VIEW: (u32, u32) = (448, 336);
/// The colour of the first other trajectory.
const OTHER: [u8; 3] = [255, 120, 60];

fn render(result: &Path, out: &Path, more: &[&str]) -> Output {
    stillpoint([&["render", text(result), "-o", text(out)], more].concat())
}

fn at(name: &str) -> PathBuf {
    MADE.dir.path().join(name)
}

static STILL: LazyLock<RgbImage> = LazyLock::new(|| {
    let out = at("still.png");
    check(&render(&MADE.result, &out, &[]), 0, &[]);
    image::open(out).unwrap().to_rgb8()
});

/// Redness of the camera image on people, by the simulator's masks, and elsewhere.
fn redness(picture: &RgbImage) -> [f64; 2] {
    let masks = MADE.dir.path().join("people walk").join("mask");
    let mut names: Vec<PathBuf> = std::fs::read_dir(masks)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    names.sort();
    let mask = image::open(&names[3 * (SHOWN - 1)]).unwrap().to_luma8();
    let mut sums = [(0.0, 0.0); 2];
    for (x, y) in (0..VIEW.0).flat_map(|x| (0..VIEW.1).map(move |y| (x, y))) {
        let [u, v] = [x * mask.width() / VIEW.0, y * mask.height() / VIEW.1];
        let [r, g, b] = picture.get_pixel(x, y).0.map(f64::from);
        let sum = &mut sums[usize::from(mask.get_pixel(u, v).0[0] == 0)];
        *sum = (sum.0 + r - 0.5 * (g + b), sum.1 + 1.0);
    }
    assert!(sums[0].1 > 2000.0, "somebody is there");
    sums.map(|(sum, n)| sum / n)
}

/// Number of pixels of a colour on the right, above the legend.
fn count(picture: &RgbImage, colour: [u8; 3]) -> usize {
    let right = picture
        .enumerate_pixels()
        .filter(|(x, y, _)| *x > VIEW.0 && *y < VIEW.1);
    let near = |p: &image::Rgb<u8>| p.0.iter().zip(colour).all(|(a, b)| a.abs_diff(b) < 8);
    right.filter(|(.., p)| near(p)).count()
}

#[test]
fn run_is_rendered_as_an_animation() {
    let out = at("run.webp");
    let output = render(&MADE.result, &out, &[]);
    check(&output, 0, &[]);
    let said = stdout(&output);
    assert!(
        said.starts_with(&format!("{SHOWN} pictures of 900 x ")),
        "{said}"
    );
    assert!(std::fs::metadata(&out).unwrap().len() < 3_000_000);
    let file = BufReader::new(std::fs::File::open(&out).unwrap());
    let frames = WebPDecoder::new(file).unwrap().into_frames();
    let frames = frames.collect_frames().unwrap();
    assert!(
        (SHOWN..=SHOWN + 1).contains(&frames.len()),
        "{}",
        frames.len()
    );
    let ms: f64 = frames
        .iter()
        .map(|f| f64::from(f.delay().numer_denom_ms().0) / f64::from(f.delay().numer_denom_ms().1))
        .sum();
    assert!((3500.0..=4300.0).contains(&ms), "{ms}");
    // The surface grows: less and less of the dark background remains.
    let dark = |i: usize| {
        let picture = image::DynamicImage::from(frames[i].buffer().clone()).to_rgb8();
        let right = picture
            .enumerate_pixels()
            .filter(|(x, y, _)| *x > VIEW.0 + 4 && *y < VIEW.1);
        right.filter(|(.., p)| p.0.iter().all(|v| *v < 45)).count()
    };
    let (first, last) = (dark(0), dark(SHOWN - 1));
    assert!(last + 500 < first, "{first} {last}");
}

#[test]
fn render_tints_people_and_draws_the_trajectory() {
    let [people, room] = redness(&STILL);
    assert!(count(&STILL, [30, 200, 110]) > 30);
    assert!(count(&STILL, [240, 244, 250]) > 30, "the true one");
    // Without the filter no region is tinted.
    let (data, off) = (at("people walk"), at("off"));
    let set = ["--set", "static_filter.preset=off", "--out", text(&off)];
    let output = stillpoint([&["run", text(&data), "--detector", "none"], &set[..]].concat());
    check(&output, 0, &[]);
    let out = at("off.png");
    check(&render(&off, &out, &[]), 0, &[]);
    let plain = redness(&image::open(out).unwrap().to_rgb8());
    // In this frame a person fills half of the image: regions that the detector missed are judged by their motion.
    assert!(people > plain[0] + 20.0, "{people} {plain:?}");
    assert!((room - plain[1]).abs() < 10.0, "{room} {plain:?}");
}

#[test]
fn render_draws_additional_trajectories() {
    assert_eq!(count(&STILL, OTHER), 0);
    // A trajectory with accelerating drift to the side.
    let ours = std::fs::read_to_string(MADE.result.join("trajectory.txt")).unwrap();
    let lines = ours.lines().filter(|l| !l.starts_with('#')).enumerate();
    let drifting = lines.map(|(i, line)| {
        let mut cells: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let x: f64 = cells[1].parse().unwrap();
        cells[1] = format!("{}", x + 1e-4 * (i * i) as f64);
        cells.join(" ") + "\n"
    });
    let file = at("drifting.txt");
    std::fs::write(&file, drifting.collect::<String>()).unwrap();
    let (out, also) = (at("also.png"), format!("somebody else={}", text(&file)));
    check(&render(&MADE.result, &out, &["--also", &also]), 0, &[]);
    let picture = image::open(&out).unwrap().to_rgb8();
    let found = count(&picture, OTHER);
    assert!(found > 30, "{found}");
    assert!(count(&picture, [30, 200, 110]) > 30);
}

#[test]
fn render_respects_the_size_limit() {
    let (out, bound) = (at("small.gif"), 0.3);
    let output = render(&MADE.result, &out, &["--max-mb", "0.3"]);
    check(&output, 0, &["smaller or fewer pictures keep"]);
    let size = std::fs::metadata(&out).unwrap().len() as f64;
    assert!(size > 1000.0 && size <= bound * 1e6, "{size}");
    assert!(std::fs::read(&out).unwrap().starts_with(b"GIF89a"));
    let out = at("none.png");
    let output = render(&MADE.result, &out, &["--max-mb", "0.0001"]);
    check(&output, 1, &["allow more with --max-mb"]);
    assert!(!out.exists());
}

#[test]
fn unusable_render_input_is_refused() {
    let result = &MADE.result;
    let refused = |result: &Path, out: &Path, more: &[&str], said: &str| {
        let there = std::fs::read(out).ok();
        check(&render(result, out, more), 2, &[said]);
        assert!(std::fs::read(out).ok() == there, "{}", out.display());
    };
    let out = at("refused.webp");
    refused(
        &at("nowhere"),
        &out,
        &[],
        "found nothing; run, live and demo write",
    );
    refused(&result.join("summary.json"), &out, &[], "found a file");
    refused(
        MADE.dir.path(),
        &out,
        &[],
        "run.log: expected the log of a run",
    );
    for wrong in ["refused.mp4", "refused"] {
        refused(result, &at(wrong), &[], "ends in .webp, .gif or .png");
    }
    refused(
        result,
        Path::new("/dev/null"),
        &[],
        "ends in .webp, .gif or .png",
    );
    refused(
        result,
        &at("no such folder").join("a.webp"),
        &[],
        "expected to write it",
    );
    refused(
        result,
        &out,
        &["--input", "gone"],
        "gone: expected the input of the run",
    );
    refused(
        result,
        &out,
        &["--also", "file"],
        "expected a name, = and a file",
    );
    refused(result, &out, &["--also", "A=gone.txt"], "gone.txt");
    let other = at("other.txt");
    std::fs::write(&other, "9e9 0 0 0 0 0 0 1\n9.1e9 0 0 1 0 0 0 1\n").unwrap();
    let also = format!("A={}", text(&other));
    refused(
        result,
        &out,
        &["--also", &also],
        "--also A: expected stamps of the run",
    );
    // No input and no result file is replaced.
    let (mine, track) = (result.join("plot.png"), at("track.png"));
    refused(result, &mine, &[], "a file of the result");
    std::fs::copy(result.join("trajectory.txt"), &track).unwrap();
    let also = format!("A={}", text(&track));
    refused(result, &track, &["--also", &also], "found that of --also");
    let mask = at("people walk").join("depth");
    let image = std::fs::read_dir(mask)
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    refused(result, &image, &[], "outside of the data set for --out");
    // A recording of another scene.
    let strange = at("strange");
    crate::common::simulate(&strange, "xyz", 20);
    let output = render(result, &out, &["--input", text(&strange)]);
    assert_ne!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(!out.exists());
}

#[test]
fn render_accepts_a_moved_input() {
    let moved = at("moved");
    copy(&at("people walk"), &moved);
    let out = at("moved.png");
    let output = render(&MADE.result, &out, &["--input", text(&moved)]);
    check(&output, 0, &[]);
    assert!(image::open(out).unwrap().to_rgb8() == *STILL);
}
