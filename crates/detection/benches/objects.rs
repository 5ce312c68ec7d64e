//! Time of the object tracker: `cargo bench -p stillpoint-detection`. Every frame contains the given number of boxes,
//! all tracked for some frames.

use divan::{Bencher, black_box};
use stillpoint_detection::{
    BoundingBox, ClassId, Detection, Detections, ObjectTracker, ObjectsConfig,
};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{CoarseDepth, DepthImage, FrameId};

fn main() {
    divan::main();
}

/// Adjacent and overlapping boxes of people and things, moving by some pixels per frame.
fn boxes(count: usize, frame: u32) -> Detections {
    let item = |i: usize| {
        let x0 = (i * 37 % 560) as f64 + f64::from(frame % 5);
        let y0 = (i * 53 % 360) as f64;
        Detection {
            class: ClassId((i % 3 * 28) as u8),
            score: 0.5 + (i % 40) as f32 * 0.01,
            bounds: BoundingBox {
                x0,
                y0,
                x1: x0 + 40.0 + (i % 7) as f64 * 5.0,
                y1: y0 + 60.0 + (i % 5) as f64 * 10.0,
            },
        }
    };
    Detections {
        frame: FrameId(frame),
        stamp: f64::from(frame) / 30.0,
        items: (0..count).map(item).collect(),
    }
}

#[divan::bench(args = [10, 100, 300, 1000])]
fn a_frame_of_boxes(bencher: Bencher, count: usize) {
    let camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
    let plane = (0..640 * 480).map(|i| 1.0 + (i % 640) as f32 * 0.004);
    let depth = DepthImage::from_vec(640, 480, plane.collect()).expect("as many as pixels");
    let depth = CoarseDepth::new(&depth, 8);
    let pose = Se3::default();
    let mut known = ObjectTracker::new(ObjectsConfig::default(), camera);
    for frame in 0..10 {
        known.update(&boxes(count, frame), &pose, &depth);
    }
    let next = boxes(count, 10);
    bencher
        .with_inputs(|| known.clone())
        .bench_local_values(|mut tracker| {
            tracker.update(black_box(&next), &pose, &depth);
            tracker.predict(next.stamp, &pose)
        });
}
