use super::*;
use stillpoint_detection::{DetectError, DetectorInfo, DetectorKind};
use stillpoint_imaging::{DepthImage, GrayImage};

/// A detector that records its frames, and reports them in its remark.
struct Witness(Vec<u32>);

impl Detector for Witness {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        self.0.push(frame.id.0);
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items: Vec::new(),
        })
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo::new(DetectorKind::None, "")
    }

    fn remark(&self) -> Option<String> {
        Some(format!("{:?}", self.0))
    }
}

fn black(i: u32) -> RgbdFrame {
    RgbdFrame {
        id: FrameId(i),
        stamp: f64::from(i),
        depth_stamp: f64::from(i),
        gray: GrayImage::new(64, 48),
        colour: None,
        depth: DepthImage::from_vec(64, 48, vec![0.0; 64 * 48]).unwrap(),
    }
}

/// Runs ten black frames with the ids 7, 10, ..., 34. Returns the frames processed by the detector, and for each frame
/// that received detections their source frame.
fn looked_at(stride: u32, delay: u32) -> (String, Vec<(u32, u32)>) {
    let mut config = Config::default();
    config.detector.stride = stride;
    config.schedule.detector = delay;
    let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
    let system = System::new(config, camera, Simd::Scalar).unwrap();
    let mut system = system.with_detector(Box::new(Witness(Vec::new())));
    let mut came = Vec::new();
    for i in 0..10 {
        let id = FrameId(7 + 3 * i);
        for event in system.step(RgbdFrame { id, ..black(i) }) {
            if let Event::Detected(d) = event {
                came.push((id.0, d.frame.0));
            }
        }
    }
    let seen = system.detector().and_then(Detector::remark);
    (seen.unwrap(), came)
}

/// The same frames, with the caller's detections in every third of them.
#[test]
fn caller_detections_replace_the_detector_with_its_delay() {
    let mut config = Config::default();
    config.schedule.detector = 2;
    let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
    let system = System::new(config, camera, Simd::Scalar).unwrap();
    let mut system = system.with_detector(Box::new(Witness(Vec::new())));
    let mut came = Vec::new();
    for i in 0..7 {
        let frame = black(i);
        let seen = i.is_multiple_of(3).then(Vec::new);
        for event in system.step_with(frame, seen) {
            if let Event::Detected(d) = event {
                came.push((i, d.frame.0));
            }
        }
    }
    assert_eq!(came, [(2, 0), (3, 1), (4, 2), (5, 3), (6, 4)]);
    let asked = system.detector().and_then(Detector::remark);
    assert_eq!(asked.unwrap(), "[1, 2, 4, 5]");
}

#[test]
fn detector_runs_at_its_stride() {
    assert_eq!(looked_at(1, 0).0, "[7, 10, 13, 16, 19, 22, 25, 28, 31, 34]");
    let looks = "[7, 19, 31]".to_owned();
    let at_once = vec![(7, 7), (19, 19), (31, 31)];
    assert_eq!(looked_at(4, 0), (looks.clone(), at_once));
    // The run ends before the last detections are delivered.
    assert_eq!(looked_at(4, 3), (looks, vec![(16, 7), (28, 19)]));
    assert_eq!(looked_at(100, 2), ("[7]".to_owned(), vec![(13, 7)]));
}
