//! Masks of moving pixels.

use stillpoint_detection::{MotionWeights, Object};
use stillpoint_imaging::RgbdFrame;
use stillpoint_slam::{MOVER, Segments};

/// The pixels of moving regions, dilated by one cell: at their borders a camera mixes foreground and background.
pub(crate) fn spread(segments: &Segments, frame: &RgbdFrame, moving: &mut Vec<bool>) {
    moving.clear();
    let (w, h, side) = (segments.width, segments.height, segments.cell_px);
    if side == 0 || w == 0 || h == 0 || segments.labels.iter().all(|l| *l == 0) {
        return;
    }
    let labelled = |x: usize, y: usize| segments.labels.get(y * w + x).is_some_and(|l| *l > 0);
    let around = |v: usize, end: usize| v.saturating_sub(1)..(v + 2).min(end);
    let near: Vec<bool> = (0..w * h)
        .map(|i| around(i / w, h).any(|y| around(i % w, w).any(|x| labelled(x, y))))
        .collect();
    let (width, height) = (frame.depth.width(), frame.depth.height());
    // Pixels beyond the last whole cell belong to it.
    moving.extend((0..width * height).map(|i| {
        let (x, y) = ((i % width / side).min(w - 1), (i / width / side).min(h - 1));
        near[y * w + x]
    }));
}

/// Uncertainty of box borders, px.
const BORDER: f64 = 8.0;
/// Depth margin around the observed depths of a body, m.
const BODY: f32 = 0.1;

/// Adds the pixels of objects that move by themselves, parked or not: a seated person will get up.
pub(crate) fn add_people(
    objects: &[Object],
    weights: &MotionWeights,
    frame: &RgbdFrame,
    moving: &mut Vec<bool>,
) {
    let (width, height) = (frame.depth.width(), frame.depth.height());
    let visible = |o: &&Object| o.bounds.area() > 0.0 && weights.get(o.class) >= MOVER;
    for object in objects.iter().filter(visible) {
        moving.resize(width * height, false);
        let b = &object.bounds;
        let range = |from: f64, to: f64, end: usize| {
            let low = (from - BORDER).max(0.0) as usize;
            low.min(end)..((to + BORDER).max(0.0) as usize).min(end)
        };
        let depths = object.depth_range.map(|r| r.map(|z| z as f32));
        let [near, far] = depths.map_or([0.0, f32::INFINITY], |[a, b]| [a - BODY, b + BODY]);
        for y in range(b.y0, b.y1, height) {
            for x in range(b.x0, b.x1, width) {
                moving[y * width + x] |= (near..=far).contains(&frame.depth.at(x, y));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_detection::{BoundingBox, ClassId, Motion, ObjectId, ObjectState};
    use stillpoint_imaging::{DepthImage, FrameId, GrayImage};

    fn object(class: &str, motion: Motion) -> Object {
        Object {
            id: ObjectId(1),
            class: ClassId::from_name(class).unwrap(),
            score: 0.9,
            state: ObjectState::Confirmed,
            bounds: BoundingBox {
                x0: 16.0,
                y0: 16.0,
                x1: 40.0,
                y1: 40.0,
            },
            bounds_sigma: [1.0; 2],
            depth_range: Some([1.0, 1.4]),
            position: None,
            velocity: None,
            covariance: None,
            size: None,
            last_seen: 0.0,
            motion,
        }
    }

    #[test]
    fn people_are_masked_even_if_parked_and_chairs_are_not() {
        let mut depth = vec![3.0; 64 * 48];
        depth[28 * 64 + 20..28 * 64 + 36].fill(1.2);
        let frame = RgbdFrame {
            id: FrameId(0),
            stamp: 0.0,
            depth_stamp: 0.0,
            gray: GrayImage::new(64, 48),
            colour: None,
            depth: DepthImage::from_vec(64, 48, depth).unwrap(),
        };
        let count = |class: &str, motion: Motion| {
            let mut moving = Vec::new();
            let weights = MotionWeights::default();
            add_people(&[object(class, motion)], &weights, &frame, &mut moving);
            moving.iter().filter(|m| **m).count()
        };
        // The wall behind stays.
        assert_eq!(count("person", Motion::Parked), 16);
        assert_eq!(count("person", Motion::Moving), 16);
        assert_eq!(count("chair", Motion::Parked), 0);
        assert_eq!(count("chair", Motion::Moving), 0);
    }
}
