//! People who fill the image.

use super::world::{Recording, Session, assert_kept, at_home, config, losses, small};
use stillpoint_detection::{BoundingBox, ClassId, Detection, Detections, Detector, DetectorInfo};
use stillpoint_detection::{DetectError, DetectorKind};
use stillpoint_imaging::{DepthImage, GrayImage, RgbdFrame};
use stillpoint_map::SubmapId;
use stillpoint_slam::FrameReport;

/// A person in a checked shirt passes so near that only a strip of `free` px at the left border remains visible.
fn covered_by_shirt(mut frame: RgbdFrame, step: usize, free: usize) -> RgbdFrame {
    let (w, h) = (frame.gray.width(), frame.gray.height());
    let (mut gray, mut depth) = (frame.gray.data().to_vec(), frame.depth.data().to_vec());
    for y in 0..h {
        for x in free..w {
            // Patches of 6 px with random levels, moving to the right by 3 px per frame.
            let (i, j) = ((x + 3000 - 3 * step) / 6, y / 6);
            let mut z = (i * 7919 + j * 104_729) as u64;
            z = (z ^ (z >> 7)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            gray[y * w + x] = 40 + ((z >> 40) % 160) as u8;
            depth[y * w + x] = 0.8 + 0.0005 * (x as f32 - 160.0).abs();
        }
    }
    frame.gray = GrayImage::from_vec(w, h, gray).unwrap();
    frame.depth = DepthImage::from_vec(w, h, depth).unwrap();
    frame
}

/// Detects a person from a column on, in a range of frames.
struct SeesOne(std::ops::Range<u32>, f64);

impl Detector for SeesOne {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        let person = Detection {
            class: ClassId::PERSON,
            score: 0.9,
            bounds: BoundingBox {
                x0: self.1,
                y0: -0.5,
                x1: 319.5,
                y1: 239.5,
            },
        };
        let seen = self.0.contains(&frame.id.0);
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items: Vec::from_iter(seen.then_some(person)),
        })
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo::new(DetectorKind::None, "")
    }
}

/// Whether the camera stays in the map once relocalised.
fn home_again(reports: &[FrameReport]) -> bool {
    let home = |r: &FrameReport| r.submap == Some(SubmapId(0));
    let first = reports.iter().position(home).unwrap_or(reports.len());
    reports[first..].iter().all(home)
}

#[test]
fn person_filling_the_image_does_not_move_the_map() {
    let room = super::world::room();
    // (detected, free px of the image)
    for (detected, free) in [(false, 24), (true, 24), (false, 0), (true, 0)] {
        let mut session = Session::new(room, config());
        if detected {
            session = session.with_detector(Box::new(SeesOne(30..90, free as f64)));
        }
        session.feed(room.play(0..30));
        let before = session.view();
        let shirt = room.play(30..90).into_iter().enumerate();
        let bad = session.feed(shirt.map(|(i, f)| covered_by_shirt(f, i, free)).collect());
        // Afterwards the initial view is shown again.
        let after = session.go_on(
            room.play(0..30)
                .into_iter()
                .rev()
                .chain(room.play(0..30))
                .collect(),
            0.0,
        );
        let moving = bad
            .iter()
            .map(|r| f64::from(r.counts.dynamic) / f64::from(r.counts.keypoints.max(1)));
        println!(
            "{free} px free, detected {detected}: {} of 60 frames lost, {:.2} of the keypoints move; then {} without a pose in the map; {} submaps",
            losses(&bad).len(),
            moving.sum::<f64>() / 60.0,
            after.len() - at_home(&after),
            session.view().submaps().len()
        );
        // No pose in the map was wrong, and a submap started on the shirt was left within a second.
        let what = format!("a shirt but for {free} px with detector {detected}");
        session.hold(&what, room, &bad);
        session.hold(&format!("after {what}"), room, &after);
        assert!(
            at_home(&after) >= 28 && home_again(&after),
            "{}",
            at_home(&after)
        );
        assert_kept(&before, &session.view());
    }
}

#[test]
fn crowd_filling_the_image_gives_no_false_pose() {
    let recording = Recording::new("walking_xyz", 30..100, small(450.0));
    let mut session = Session::new(&recording, config()).with_detector(recording.detector());
    let reports = session.feed(recording.play(0..70));
    let lost = losses(&reports).len();
    println!("{lost} of 70 lost, {} in the map", at_home(&reports));
    // For a second they cover too much of the room for tracking.
    assert!((10..40).contains(&lost), "{lost}");
    session.hold("a crowd that fills the image", &recording, &reports);
}
