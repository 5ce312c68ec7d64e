//! Layouts, cameras, frames and ground truth of small data sets; recording.

use crate::common::{Folder, H, W, depth, gray};
use image::{DynamicImage, ImageFormat};
use std::sync::Arc;
use stillpoint_datasets::{
    CameraChoice, ColourFormat, Dataset, FrameOptions, Layout, OpenOptions, Recorder, read_depth,
};
use stillpoint_geometry::{Camera, Se3, Vec3, so3};
use stillpoint_imaging::{ColourImage, DepthImage, FrameId, FrameSource, GrayImage, RgbdFrame};

fn frames(dataset: &Dataset, options: &FrameOptions) -> Vec<RgbdFrame> {
    let mut source = dataset.frames(options).unwrap();
    let mut all = Vec::new();
    while let Some(f) = source.next_frame() {
        all.push(f.unwrap());
    }
    all
}

#[test]
fn tum_layout_is_read() {
    let f = Folder::tum("x", 5);
    f.text("depth.txt", "0.005 depth/0.png\n0.105 depth/1.png\n0.305 depth/3.png\n0.35 depth/4.png\n0.405 depth/4.png\n");
    let d = f.open();
    assert_eq!(d.layout(), Layout::Tum);
    let c = d.counts();
    assert_eq!(
        (
            c.colour,
            c.depth,
            c.frames,
            c.unmatched_colour,
            c.unmatched_depth
        ),
        (5, 5, 4, 1, 1)
    );
    assert_eq!((d.camera().camera.width, d.camera().camera.height), (W, H));
    assert!(d.guesses()[0].starts_with("layout: TUM (rgb.txt"));
    assert!(d.guesses()[1].contains("4 of 5 colour images"));
    assert!(d.guesses()[2].contains("camera.txt (in the folder)"));
    let all = frames(&d, &FrameOptions::default());
    assert_eq!(
        all.iter().map(|f| f.gray.at(0, 0)).collect::<Vec<_>>(),
        [0, 1, 3, 4]
    );
    assert_eq!(all.iter().map(|f| f.id.0).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert_eq!((all[2].stamp, all[2].depth_stamp), (0.3, 0.305));
    assert!(
        all.iter()
            .all(|f| f.depth.at(5, 5) == 2.0 && f.colour.is_none())
    );
    let part = FrameOptions {
        start: 1,
        max_frames: Some(2),
        keep_colour: true,
    };
    let part = frames(&d, &part);
    assert_eq!(
        part.iter().map(|f| (f.id.0, f.stamp)).collect::<Vec<_>>(),
        [(0, 0.1), (1, 0.3)]
    );
    assert_eq!(part[1].colour.as_ref().unwrap().at(0, 0), [3, 3, 3]);
}

#[test]
fn associations_with_jpeg_and_webp_are_read() {
    let f = Folder::tum("rgbd_bonn_x", 3);
    f.remove("rgb.txt");
    f.image_as("rgb/0.png", &gray(100), ImageFormat::Jpeg);
    f.image_as(
        "rgb/1.png",
        &DynamicImage::ImageRgb8(gray(100).into_rgb8()),
        ImageFormat::WebP,
    );
    f.text(
        "associations.txt",
        "0.0 rgb/0.png 0.005 depth/0.png\n0.1 rgb/1.png 0.105 depth/1.png\n",
    );
    let d = f.open();
    assert_eq!(d.layout(), Layout::Bonn);
    let all = frames(&d, &FrameOptions::default());
    assert_eq!(all.len(), 2);
    assert!(all.iter().all(|f| f.gray.at(3, 3).abs_diff(100) <= 1));
}

#[test]
fn depth_first_with_seconds_is_not_icl_nuim() {
    let f = Folder::tum("x", 3);
    // Without depth.txt the associations are used.
    f.remove("depth.txt");
    f.text("associations.txt", "0.005 depth/0.png 0.0 rgb/0.png\n");
    let d = f.open();
    assert_eq!((d.layout(), d.counts().frames), (Layout::Tum, 1));
    assert!(d.guesses()[0].contains("associations.txt"));
    assert_eq!(
        (d.entries()[0].stamp, d.entries()[0].depth_stamp),
        (0.0, 0.005)
    );
}

#[test]
fn chosen_camera_overrides_guesses() {
    let f = Folder::tum("fr2_x", 2);
    f.text("my.toml", "name = \"mine\"\nfx = 31.0\nfy = 32.0\ncx = 15.0\ncy = 12.0\ndepth_scale = 5000.0\ndistortion = [0.1, 0.02, 0.003, 0.004, 0.005]\n");
    let options = OpenOptions {
        camera: Some(CameraChoice::File(f.path.join("my.toml"))),
        ..OpenOptions::default()
    };
    let d = Dataset::open(&f.path, &options).unwrap();
    assert_eq!(d.camera().name, "mine");
    assert_eq!(d.camera().camera.distortion.p1, 0.003);
    assert!(!d.guesses().iter().any(|g| g.starts_with("camera")));
    // A camera.toml in the folder overrides camera.txt.
    std::fs::copy(f.path.join("my.toml"), f.path.join("camera.toml")).unwrap();
    assert_eq!(f.open().camera().name, "mine");
}

#[test]
fn icl_nuim_layout_is_recognised_by_its_associations() {
    let f = Folder::empty("traj0_frei_png");
    let big = |image: DynamicImage| image.resize_exact(640, 480, image::imageops::Nearest);
    for i in 1..4 {
        f.image(&format!("rgb/{i}.png"), &big(gray(i)));
        f.image(
            &format!("depth/{i}.png"),
            &DynamicImage::ImageLuma16(image::ImageBuffer::from_pixel(
                640,
                480,
                image::Luma([5000u16]),
            )),
        );
    }
    f.text(
        "associations.txt",
        "1 depth/1.png 1 rgb/1.png\n2 depth/2.png 2 rgb/2.png\n3 depth/3.png 3 rgb/3.png\n",
    );
    f.text(
        "livingRoom0.gt.freiburg",
        "1 0 0 0 0 0 0 1\n2 1 2 3 0.1 0.2 0.3 0.9\n",
    );
    let d = f.open();
    assert_eq!(
        (d.layout(), d.camera().name.as_str()),
        (Layout::IclNuim, "icl_nuim")
    );
    let all = frames(&d, &FrameOptions::default());
    assert_eq!(all.len(), 3);
    assert!((all[1].stamp - 2.0 / 30.0).abs() < 1e-12);
    let gt = d.ground_truth().unwrap().unwrap();
    assert!((gt[1].stamp - all[1].stamp).abs() < 1e-12);
    assert_eq!(
        gt[1].world_from_camera.translation,
        Vec3::new(1.0, -2.0, 3.0)
    );
    // Without the list, the file numbers determine the pairs.
    f.remove("associations.txt");
    f.remove("depth/2.png");
    let c = f.open().counts();
    assert_eq!((c.frames, c.unmatched_colour), (2, 1));
}

/// Numbered images alone do not imply a camera.
#[test]
fn numbered_images_need_a_camera() {
    let f = Folder::tum("mine", 3);
    for name in ["rgb.txt", "depth.txt", "camera.txt"] {
        f.remove(name);
    }
    f.fails(&["no camera.toml or camera.txt", "icl_nuim"]);
    f.text("camera.txt", "30 30 16 12 1000\n");
    f.text("groundtruth.txt", "0.0 1 2 3 0 0 0 1\n");
    let d = f.open();
    assert_eq!((d.layout(), d.counts().frames), (Layout::Numbered, 3));
    let all = frames(&d, &FrameOptions::default());
    assert!((all[1].stamp - 1.0 / 30.0).abs() < 1e-12);
    assert_eq!(all[1].depth.at(3, 3), 10.0);
    // Nothing is mirrored.
    let truth = d.ground_truth().unwrap().unwrap();
    assert_eq!(
        truth[0].world_from_camera.translation,
        Vec3::new(1.0, 2.0, 3.0)
    );
    // The user's choice is rejected for the size of the images.
    let named = OpenOptions {
        camera: Some(CameraChoice::from_argument("icl_nuim")),
        ..OpenOptions::default()
    };
    let refused = Dataset::open(&f.path, &named).unwrap_err().to_string();
    assert!(
        refused.contains("the size of the camera icl_nuim"),
        "{refused}"
    );
}

/// As from phones: nothing in a folder states that the view is the same.
#[test]
fn smaller_depth_images_are_refused_with_advice() {
    let f = Folder::tum("phone", 2);
    for (size, part) in [
        ([16, 12], "mogrify -sample '32x24!'"),
        ([16, 16], "register depth"),
    ] {
        let of = image::ImageBuffer::from_pixel(size[0], size[1], image::Luma([5000_u16]));
        let small = DynamicImage::ImageLuma16(of);
        for i in 0..2 {
            f.image(&format!("depth/{i}.png"), &small);
        }
        f.fails(&["32 x 24 px", &format!("16 x {} px", size[1]), part]);
    }
}

#[test]
fn implausible_camera_is_refused_once_the_size_is_known() {
    let f = Folder::tum("x", 2);
    for (camera, part) in [
        ("30 30 0 0 5000", "cx = 0.0"),
        ("30 30 16 1 5000", "cy = 1.0"),
        ("2 2 16 12 5000", "fx = 2.0"),
        ("900 900 16 12 5000", "fx = 900.0"),
    ] {
        f.text("camera.txt", camera);
        f.fails(&[part, "an image of 32 x 24 px", "camera.txt"]);
    }
    f.text("camera.txt", "30 1e-300 16 12 5000");
    f.fails(&["fy = 1e-300"]);
}

#[test]
fn seven_scenes_layout_is_read() {
    let f = Folder::empty("seq-01");
    for i in 0..3 {
        f.image(
            &format!("frame-{i:06}.color.png"),
            &gray(i).resize_exact(640, 480, image::imageops::Nearest),
        );
        let mut d = image::ImageBuffer::from_pixel(640, 480, image::Luma([1500u16]));
        d.put_pixel(7, 7, image::Luma([65535]));
        f.image(
            &format!("frame-{i:06}.depth.png"),
            &DynamicImage::ImageLuma16(d),
        );
        f.text(
            &format!("frame-{i:06}.pose.txt"),
            &format!("1 0 0 {i}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"),
        );
    }
    let d = f.open();
    assert_eq!(
        (d.layout(), d.camera().name.as_str()),
        (Layout::SevenScenes, "seven_scenes")
    );
    let all = frames(&d, &FrameOptions::default());
    assert_eq!((all[2].depth.at(0, 0), all[2].depth.at(7, 7)), (1.5, 0.0));
    let other = f.path.with_file_name("scan");
    std::fs::rename(&f.path, &other).unwrap();
    let refused = Dataset::open(&other, &OpenOptions::default()).unwrap_err();
    assert!(refused.to_string().contains("seven_scenes"), "{refused}");
    std::fs::rename(&other, &f.path).unwrap();
    let gt = d.ground_truth().unwrap().unwrap();
    assert_eq!(gt.len(), 3);
    assert_eq!(
        (gt[2].stamp, gt[2].world_from_camera.translation.x),
        (all[2].stamp, 2.0)
    );
}

pub(crate) fn frame(i: u32, colour: bool) -> RgbdFrame {
    let (w, h) = (16, 12);
    let gray = GrayImage::from_vec(
        w,
        h,
        (0..w * h)
            .map(|k| (k as u8).wrapping_add(i as u8))
            .collect(),
    )
    .unwrap();
    let rgb = gray.data().iter().flat_map(|&g| [g, g, g]).collect();
    RgbdFrame {
        id: FrameId(i),
        stamp: 10.0 + f64::from(i) / 30.0,
        depth_stamp: 10.0 + f64::from(i) / 30.0 - 0.004,
        colour: colour.then(|| Arc::new(ColourImage::from_vec(w, h, rgb).unwrap())),
        gray,
        depth: DepthImage::from_vec(w, h, (0..w * h).map(|k| k as f32 * 0.08).collect()).unwrap(),
    }
}

#[test]
fn recorded_data_set_round_trips() {
    for (format, colour) in [
        (ColourFormat::Png, true),
        (ColourFormat::Png, false),
        (ColourFormat::Jpeg, true),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("new/set");
        let camera = Camera::pinhole(16, 12, [20.0, 21.0, 8.0, 6.0]);
        let mut r = Recorder::create(&path, &camera, "toy \"room\"", format).unwrap();
        let pose = |i: u32| {
            Se3::new(
                so3::exp(&Vec3::new(0.0, 0.1, 0.0)),
                Vec3::new(f64::from(i), 0.0, 0.0),
            )
        };
        for i in 0..3 {
            r.add(&frame(i, colour), Some(&pose(i))).unwrap();
        }
        let e = r.add(&frame(2, colour), None).unwrap_err().to_string();
        assert!(e.contains("rgb.txt:6:") && e.contains("repeats"), "{e}");
        r.finish().unwrap();
        let d = Dataset::open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(
            (d.camera().name.as_str(), d.camera().camera),
            ("toy \"room\"", camera)
        );
        let all = frames(&d, &FrameOptions::default());
        assert_eq!(all.len(), 3);
        for (i, found) in all.iter().enumerate() {
            let expected = frame(i as u32, colour);
            assert!((found.stamp - expected.stamp).abs() < 1e-6);
            assert!((found.depth_stamp - expected.depth_stamp).abs() < 1e-6);
            let worst = found
                .gray
                .data()
                .iter()
                .zip(expected.gray.data())
                .map(|(a, b)| a.abs_diff(*b))
                .max();
            assert!(worst.unwrap() <= if format == ColourFormat::Png { 0 } else { 12 });
            for (a, b) in found.depth.data().iter().zip(expected.depth.data()) {
                // Depths beyond 13.1 m are dropped.
                let b = if *b > 13.1068 { 0.0 } else { *b };
                assert!((a - b).abs() <= 1.01e-4, "{a} {b}");
            }
        }
        let gt = d.ground_truth().unwrap().unwrap();
        assert!((gt[2].world_from_camera.inverse() * pose(2)).log().norm() < 1e-8);
        // An existing folder is not changed.
        let e = Recorder::create(&path, &camera, "x", format).unwrap_err();
        assert!(e.to_string().contains("new or empty folder"), "{e}");
    }
}

#[test]
fn saturated_depth_is_invalid() {
    let f = Folder::empty("x");
    f.image("d.png", &depth(65535));
    assert_eq!(
        read_depth(&f.path.join("d.png"), 1000.0).unwrap().at(0, 0),
        0.0
    );
}
