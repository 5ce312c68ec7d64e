//! Every kind of bad input gives a message with location, expectation and finding.

use crate::common::{Folder, H, W, depth, fails, gray};
use image::{DynamicImage, ImageFormat};
use stillpoint_datasets::{
    CameraChoice, Dataset, DatasetSource, FrameOptions, Layout, OpenOptions,
};
use stillpoint_imaging::FrameSource;

#[test]
fn missing_empty_or_non_folder_input_is_reported() {
    let f = Folder::empty("x");
    f.fails(&["x", "empty folder"]);
    fails(
        &f.path.join("no"),
        &OpenOptions::default(),
        &["x/no", "folder", "found nothing"],
    );
    f.text("file", "");
    fails(
        &f.path.join("file"),
        &OpenOptions::default(),
        &["found a file"],
    );
}

#[test]
fn missing_depth_is_reported() {
    let f = Folder::tum("x", 3);
    f.text("depth.txt", "# nothing\n");
    f.fails(&["depth.txt", "found none", "RGB-D"]);
    f.remove("depth.txt");
    f.fails(&["depth.txt beside rgb.txt", "rgb.txt only"]);
    let f = Folder::empty("icl");
    f.image("rgb/0.png", &gray(1));
    f.fails(&["a folder depth beside rgb"]);
    let f = Folder::empty("7");
    f.image("frame-000000.color.png", &gray(1));
    f.fails(&["1 colour images and no depth image"]);
}

#[test]
fn unknown_layout_reports_content_and_suggests_a_folder() {
    let f = Folder::empty("x");
    f.text("notes.md", "");
    f.fails(&["rgb.txt and depth.txt", "found notes.md", "one sequence"]);
    f.text("seq-01/rgb.txt", "");
    f.fails(&["did you mean", "seq-01"]);
    let f = Folder::empty("y");
    f.text("notes.md", "");
    let asked = OpenOptions {
        layout: Some(Layout::Tum),
        ..OpenOptions::default()
    };
    fails(&f.path, &asked, &["rgb.txt and depth.txt"]);
    let asked = OpenOptions {
        layout: Some(Layout::SevenScenes),
        ..OpenOptions::default()
    };
    fails(&f.path, &asked, &["no depth image"]);
}

#[test]
fn unknown_camera_lists_the_choices() {
    let f = Folder::tum("x", 3);
    f.remove("camera.txt");
    f.fails(&["tum_fr1, tum_fr2, tum_fr3, bonn", "camera.toml"]);
    let asked = OpenOptions {
        camera: Some(CameraChoice::from_argument("fr8")),
        ..OpenOptions::default()
    };
    fails(&f.path, &asked, &["fr8", "neither a preset nor a file"]);
    f.text("camera.toml", "fx = 1.0\nfy = oops\n");
    f.fails(&["camera.toml:2:"]);
    f.text("camera.txt", "1 2 3\n");
    f.remove("camera.toml");
    f.fails(&["camera.txt:1:", "3 columns"]);
}

#[test]
fn malformed_lists_and_stamps_are_reported() {
    let f = Folder::tum("x", 3);
    f.text("rgb.txt", "# c\n0.0 rgb/0.png\n0.1\n");
    f.fails(&["rgb.txt:3:", "a timestamp and a file name", "\"0.1\""]);
    f.text("rgb.txt", "0.2 rgb/2.png\n0.1 rgb/1.png\n0.1 rgb/0.png\n");
    let sorted = f.open();
    let stamps: Vec<f64> = sorted.entries().iter().map(|e| e.stamp).collect();
    assert_eq!(stamps, [0.1, 0.2]);
    assert!(sorted.entries()[0].colour.ends_with("1.png"));
    let said = sorted.warnings().join("; ");
    assert!(said.contains("out of order by their stamps: 1"), "{said}");
    assert!(
        said.contains("repeat a stamp and are left out: 1"),
        "{said}"
    );
    f.text("rgb.txt", "100 rgb/0.png\n");
    f.fails(&["within 0.02 s", "100.000 to 100.000", "same clock"]);
    f.bytes("rgb.txt", b"\xff\xfe\x00garbage");
    f.fails(&["rgb.txt:1:"]);
    f.text("rgb.txt", "");
    f.fails(&["rgb.txt", "found none"]);
    f.remove("rgb.txt");
    f.text("associations.txt", "0.0 rgb/0.png 0.005\n");
    f.fails(&["associations.txt:1:", "3 columns"]);
}

#[test]
fn malformed_ground_truth_is_reported_with_its_line() {
    let f = Folder::tum("x", 3);
    assert_eq!(f.open().ground_truth().unwrap(), None);
    f.text("groundtruth.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0\n");
    let e = f.open().ground_truth().unwrap_err();
    assert_eq!(e.line(), Some(2));
    assert!(e.path().ends_with("groundtruth.txt"));
}

/// The result of each frame: `ok` or the message.
fn outcomes(f: &Folder, strict: bool) -> Vec<String> {
    let options = OpenOptions {
        strict,
        ..OpenOptions::default()
    };
    let dataset = Dataset::open(&f.path, &options).unwrap();
    let mut source: DatasetSource = dataset.frames(&FrameOptions::default()).unwrap();
    let mut all = Vec::new();
    while let Some(item) = source.next_frame() {
        all.push(item.map_or_else(
            |e| {
                assert_eq!(e.recoverable, !strict);
                e.message
            },
            |f| format!("ok {}", f.id),
        ));
    }
    all
}

/// Truncates a colour image in another format.
fn truncate(f: &Folder, format: ImageFormat) {
    let noise = image::RgbImage::from_fn(W, H, |x, y| {
        image::Rgb([
            (x * 91 + y * 57) as u8,
            (x * y * 13) as u8,
            (x + 31 * y) as u8,
        ])
    });
    f.image_as("rgb/1.png", &noise.into(), format);
    let bytes = std::fs::read(f.path.join("rgb/1.png")).unwrap();
    f.bytes("rgb/1.png", &bytes[..bytes.len() * 4 / 5]);
}

#[test]
fn first_image_of_another_size_does_not_set_the_size() {
    let f = Folder::tum("x", 5);
    f.image(
        "rgb/0.png",
        &gray(0).resize_exact(16, 24, image::imageops::Nearest),
    );
    let camera = f.open().camera().camera;
    assert_eq!((camera.width, camera.height), (W, H));
    assert!(outcomes(&f, false)[0].contains("32 x 24 px"));
}

#[test]
fn one_unreadable_frame_is_skipped_unless_strict() {
    type Spoil = fn(&Folder);
    let cases: [(Spoil, [&str; 2]); 9] = [
        (|f| f.remove("rgb/1.png"), ["rgb/1.png", "no such file"]),
        (|f| f.bytes("rgb/1.png", b""), ["rgb/1.png", "0 bytes"]),
        (
            |f| {
                let bytes = std::fs::read(f.path.join("depth/1.png")).unwrap();
                f.bytes("depth/1.png", &bytes[..bytes.len() / 2]);
            },
            ["depth/1.png", "truncated"],
        ),
        (
            |f| truncate(f, ImageFormat::Jpeg),
            ["rgb/1.png", "truncated"],
        ),
        (
            |f| truncate(f, ImageFormat::WebP),
            ["rgb/1.png", "truncated"],
        ),
        (
            |f| {
                f.image(
                    "rgb/1.png",
                    &gray(0).resize_exact(16, 24, image::imageops::Nearest),
                );
            },
            ["32 x 24 px", "found 16 x 24 px"],
        ),
        (
            |f| f.image("depth/1.png", &gray(9)),
            ["16-bit grey PNG", "an 8-bit grey PNG"],
        ),
        (
            |f| f.bytes("depth/1.png", b"\x76\x2f\x31\x01...."),
            ["16-bit grey PNG", "float"],
        ),
        (
            |f| f.bytes("rgb/1.png", b"what is this"),
            ["PNG, JPEG or WebP", "unknown format"],
        ),
    ];
    for (spoil, parts) in cases {
        let f = Folder::tum("x", 3);
        spoil(&f);
        let lenient = outcomes(&f, false);
        assert_eq!(lenient.len(), 3, "{lenient:?}");
        assert_eq!((&*lenient[0], &*lenient[2]), ("ok 0", "ok 2"));
        for part in parts {
            assert!(lenient[1].contains(part), "{} lacks {part}", lenient[1]);
        }
        assert!(lenient[1].starts_with("frame 1 (0.100000 s): "));
        let strict = outcomes(&f, true);
        assert_eq!(strict.len(), 2, "{strict:?}");
        assert_eq!(strict[1], lenient[1]);
    }
}

#[test]
fn problems_of_every_frame_are_reported_on_opening() {
    let f = Folder::tum("x", 3);
    for i in 0..3 {
        f.image(&format!("depth/{i}.png"), &gray(9));
    }
    f.fails(&["depth/0.png", "an 8-bit grey PNG", "5000 per metre"]);
    for i in 0..3 {
        let rgb = DynamicImage::ImageRgb8(depth(9).into_rgb8());
        f.image(&format!("depth/{i}.png"), &rgb);
    }
    f.fails(&["an 8-bit colour PNG"]);
    for i in 0..3 {
        f.image_as(
            &format!("depth/{i}.png"),
            &DynamicImage::ImageRgb8(depth(9).into_rgb8()),
            ImageFormat::Jpeg,
        );
    }
    f.fails(&["16-bit grey PNG", "Jpeg"]);
    f.remove("rgb");
    f.fails(&["rgb/0.png", "no such file"]);
    let f = Folder::tum("fr1_small", 3);
    f.remove("camera.txt");
    f.fails(&["640 x 480 px, the size of the camera tum_fr1", "32 x 24 px"]);
}

#[test]
fn all_zero_depth_is_refused() {
    let f = Folder::tum("x", 3);
    for i in 0..3 {
        f.image(&format!("depth/{i}.png"), &depth(0));
    }
    f.fails(&[
        "depth/0.png",
        "3 depth images that are zero everywhere",
        "export",
    ]);
    f.image("depth/1.png", &depth(10_000));
    assert!(f.open().warnings().is_empty());
}

#[test]
fn wrong_depth_scale_gives_a_warning() {
    let f = Folder::tum("x", 3);
    assert!(f.open().warnings().is_empty());
    // Depth in millimetres would be 2000; here 10000 values for 2 m.
    f.text("camera.txt", "30 30 16 12 150000\n");
    let warnings = f.open().warnings().join("\n");
    assert!(
        warnings.contains("0.067 m") && warnings.contains("likely factor is 5000"),
        "{warnings}"
    );
    f.text("camera.txt", "30 30 16 12 100\n");
    assert!(f.open().warnings()[0].contains("100.000 m"));
}

#[test]
fn start_beyond_the_end_is_refused() {
    let d = Folder::tum("x", 3).open();
    let options = FrameOptions {
        start: 3,
        ..FrameOptions::default()
    };
    let e = d.frames(&options).unwrap_err().to_string();
    assert!(e.contains("the number of frames, 3"), "{e}");
}

/// Devices, which have no end, and pipes without a writer are not read.
#[test]
#[cfg(unix)]
fn devices_and_pipes_are_not_read() {
    use std::os::unix::fs::symlink;
    let f = Folder::tum("x", 3);
    let zero = |name: &str| {
        f.remove(name);
        symlink("/dev/zero", f.path.join(name)).unwrap();
    };
    zero("rgb/1.png");
    let made = std::process::Command::new("mkfifo")
        .arg(f.path.join("depth/2.fifo"))
        .status();
    if made.is_ok_and(|s| s.success()) {
        f.remove("depth/2.png");
        std::fs::rename(f.path.join("depth/2.fifo"), f.path.join("depth/2.png")).unwrap();
    }
    let mut frames = f.open().frames(&FrameOptions::default()).unwrap();
    assert!(frames.next_frame().unwrap().is_ok());
    let e = frames.next_frame().unwrap().unwrap_err();
    assert!(
        e.recoverable && e.message.contains("found a device"),
        "{}",
        e.message
    );
    let e = frames.next_frame().unwrap().unwrap_err();
    assert!(
        e.recoverable && e.message.contains("found a pipe"),
        "{}",
        e.message
    );
    for name in ["rgb.txt", "camera.txt"] {
        let f = Folder::tum("y", 3);
        f.remove(name);
        symlink("/dev/zero", f.path.join(name)).unwrap();
        let e = Dataset::open(&f.path, &OpenOptions::default()).unwrap_err();
        assert!(e.to_string().contains(name) || name == "camera.txt", "{e}");
    }
}

/// A lens that folds within the images is reported when the folder is opened.
#[test]
fn folding_lens_is_reported_before_the_first_frame() {
    let f = Folder::tum("x", 3);
    f.remove("camera.txt");
    f.text(
        "camera.toml",
        "fx = 26.0\nfy = 26.0\ncx = 16.0\ncy = 12.0\ndepth_scale = 5000.0\ndistortion = [0.2624, -0.9531, -0.0054, 0.0026, 0.0]\n",
    );
    f.fails(&[
        "camera.toml with one",
        "k2 = -0.9531",
        "k3 is 0: was it left out?",
    ]);
}
