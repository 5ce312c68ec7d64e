//! Broken files give errors, never panics.

use crate::common::{Folder, depth, gray};
use image::ImageFormat;
use proptest::prelude::*;
use stillpoint_datasets::{Dataset, OpenOptions, read_colour, read_depth, read_gray};

proptest! {
    #[test]
    fn mutated_images_never_panic(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(), kind in 0usize..4
    ) {
        let f = Folder::empty("x");
        let name = match kind {
            0 => "a.png",
            1 => "a.jpg",
            2 => "a.webp",
            _ => "depth.png",
        };
        f.image(name, &if kind == 3 { depth(7000) } else { gray(90) });
        let path = f.path.join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if cut.index(4) == 0 {
            bytes.truncate(cut.index(bytes.len()));
        }
        f.bytes(name, &bytes);
        let _ = (read_gray(&path), read_colour(&path), read_depth(&path, 5000.0));
    }

    /// Any contents of a text file give a data set, or an error that names the file or its folder and, where it concerns a line, a line of
    /// that file.
    #[test]
    fn mutated_folders_never_panic_and_give_located_errors(
        file in prop::sample::select(vec![
            "rgb.txt", "depth.txt", "camera.txt", "groundtruth.txt", "camera.toml", "associations.txt",
        ]),
        at in any::<prop::sample::Index>(), cut in 0..8_usize,
        bytes in prop_oneof![
            proptest::collection::vec(any::<u8>(), 0..8),
            "[-0-9.e# \\n=a-z\"\\[]{0,8}".prop_map(String::into_bytes),
        ]
    ) {
        let f = Folder::tum("x", 2);
        f.text("groundtruth.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n");
        if file == "camera.toml" {
            f.remove("camera.txt");
            f.text(file, &camera_toml());
        }
        if file == "associations.txt" {
            f.remove("rgb.txt");
            f.remove("depth.txt");
            f.text(file, "0.0 rgb/0.png 0.005 depth/0.png\n0.1 rgb/1.png 0.105 depth/1.png\n");
        }
        prop_assert!(Dataset::open(&f.path, &OpenOptions::default()).is_ok());
        let mut text = std::fs::read(f.path.join(file)).unwrap();
        let at = at.index(text.len());
        let end = text.len().min(at + cut);
        text.splice(at..end, bytes);
        let lines = String::from_utf8_lossy(&text).lines().count();
        f.bytes(file, &text);
        let truth = |d: Dataset| d.ground_truth().map(|_| ());
        if let Err(e) = Dataset::open(&f.path, &OpenOptions::default()).and_then(truth) {
            prop_assert!(e.path().starts_with(&f.path), "{e}");
            if let Some(line) = e.line() {
                prop_assert!(e.path().ends_with(file), "{e}");
                // A missing line at the end is reported after the last one.
                prop_assert!((1..=lines + 1).contains(&line), "{e}: line {line} of {lines}");
                let place = format!("{file}:{line}");
                prop_assert!(e.to_string().contains(&place), "{e}");
            }
        }
    }
}

/// The small data set's `camera.txt` as a TOML camera file.
fn camera_toml() -> String {
    "width = 32\nheight = 24\nfx = 30.0\nfy = 30.0\ncx = 16.0\ncy = 12.0\ndepth_scale = 5000.0\n"
        .to_owned()
}

#[test]
fn formats_are_recognised_by_content_not_by_name() {
    let f = Folder::empty("x");
    std::fs::create_dir_all(&f.path).unwrap();
    f.image_as("a.png", &gray(50), ImageFormat::Jpeg);
    let g = read_gray(&f.path.join("a.png")).unwrap();
    assert!(g.at(0, 0).abs_diff(50) <= 1);
}
