//! Unreadable images.

use super::world::{Frames, Session, config, losses, room};
use std::path::Path;
use stillpoint_datasets::{ColourFormat, Dataset, FrameOptions, OpenOptions, Recorder};
use stillpoint_imaging::{FrameSource, RgbdFrame, SourceError};

/// Plays a source like a driver: recoverable errors are skipped. Returns their number.
fn play(session: &mut Session, source: &mut dyn FrameSource) -> usize {
    let mut skipped = 0;
    while let Some(item) = source.next_frame() {
        match item {
            Ok(frame) => drop(session.feed(vec![frame])),
            Err(e) if e.recoverable => skipped += 1,
            Err(e) => panic!("{e}"),
        }
    }
    skipped
}

fn corrupt(frame: &RgbdFrame) -> SourceError {
    SourceError {
        message: format!("frame {}: expected a PNG, found noise", frame.id),
        recoverable: true,
    }
}

#[test]
fn corrupt_images_lose_only_their_frames() {
    let spoiled = [13, 57, 91];
    let item = |f: RgbdFrame| {
        let is_spoiled = spoiled.contains(&f.id.0);
        if is_spoiled { Err(corrupt(&f)) } else { Ok(f) }
    };
    let frames = room().play(0..130).into_iter().map(item);
    let mut session = Session::new(room(), config());
    assert_eq!(play(&mut session, &mut Frames(frames.collect())), 3);
    let reports = session.reports();
    assert_eq!(reports.len(), 127);
    assert!(losses(&reports).is_empty());
    session.hold("three corrupt frames", room(), &reports);
}

/// Records frames of the room as a data set.
pub(crate) fn record(folder: &Path, frames: std::ops::Range<usize>) {
    let format = ColourFormat::default();
    let mut recorder = Recorder::create(folder, &room().camera, "small", format).unwrap();
    for frame in &room().frames[frames] {
        recorder.add(frame, None).unwrap();
    }
    recorder.finish().unwrap();
}

#[test]
fn truncated_files_lose_only_their_frames() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("room");
    record(&folder, 0..40);
    let dataset = Dataset::open(&folder, &OpenOptions::default()).unwrap();
    let mut files: Vec<_> = ["rgb", "depth"]
        .map(|sub| std::fs::read_dir(folder.join(sub)).unwrap())
        .into_iter()
        .flat_map(|entries| entries.map(|e| e.unwrap().path()))
        .collect();
    files.sort();
    assert_eq!(files.len(), 80);
    // Depth files sort first: the depth of frame 12 is truncated, the colour of frame 20 empty.
    for (file, share) in [(&files[12], 0.5), (&files[60], 0.0)] {
        let bytes = std::fs::read(file).unwrap();
        let end = (share * bytes.len() as f64) as usize;
        std::fs::write(file, &bytes[..end]).unwrap();
    }
    let mut session = Session::new(room(), config());
    let mut source = dataset.frames(&FrameOptions::default()).unwrap();
    assert_eq!(play(&mut session, &mut source), 2);
    let reports = session.reports();
    let missing = |k: &u32| reports.iter().all(|r| r.frame.0 != *k);
    assert_eq!((0..40).filter(missing).collect::<Vec<_>>(), [12, 20]);
    assert!(losses(&reports).is_empty());
    session.hold("truncated files", room(), &reports);
}
