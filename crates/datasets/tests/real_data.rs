//! Real sequences, if available.

use stillpoint_datasets::{Dataset, FrameOptions, Layout, OpenOptions, ReadAhead};
use stillpoint_imaging::FrameSource;

fn open(name: &str) -> Option<Dataset> {
    let path = stillpoint_testdata::recording(name)?;
    Some(Dataset::open(&path, &OpenOptions::default()).unwrap())
}

#[test]
fn fr1_xyz_opens_completely() {
    let Some(d) = open("fr1_xyz") else { return };
    assert_eq!((d.layout(), d.counts().frames), (Layout::Tum, 300));
    assert_eq!(d.camera().name, "tum_fr1");
    assert!(d.warnings().is_empty(), "{:?}", d.warnings());
    let gt = d.ground_truth().unwrap().unwrap();
    assert!(gt.len() > 1000);
    let options = FrameOptions {
        max_frames: Some(30),
        ..FrameOptions::default()
    };
    let mut source = ReadAhead::new(d.frames(&options).unwrap());
    let mut n = 0;
    while let Some(frame) = source.next_frame() {
        let frame = frame.unwrap();
        assert_eq!((frame.gray.width(), frame.depth.height()), (640, 480));
        assert!((frame.stamp - frame.depth_stamp).abs() < 0.02);
        n += 1;
    }
    assert_eq!(n, 30);
}

#[test]
fn other_recordings_open_without_warnings() {
    for (name, frames) in [
        ("fr1_xyz_walkers", 300),
        ("kitchen", 334),
        ("corridor_fixed", 180),
    ] {
        let Some(d) = open(name) else { continue };
        assert_eq!(d.counts().frames, frames, "{name}");
        assert!(d.warnings().is_empty(), "{:?}", d.warnings());
        assert!(d.ground_truth().unwrap().is_some());
    }
}
