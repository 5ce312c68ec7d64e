//! Simulates setup faults of a camera, its driver or its calibration, for tests of their detection: a wrong depth scale, unregistered or
//! delayed depth, mirrored images.

use std::collections::VecDeque;
use stillpoint_geometry::{Camera, Vec2, Vec3};
use stillpoint_imaging::{DepthImage, FrameSource, RgbdFrame, SourceError};

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// Depths are multiplied by this.
    DepthScale(f64),
    /// Depth is in the pixels of a separate depth camera, parallel to the colour camera.
    Unregistered {
        /// The colour camera.
        colour: Camera,
        /// The depth camera, of the same size.
        depth: Camera,
        /// Position of the depth camera to the right of the colour camera, m.
        baseline: f64,
    },
    /// Depth stamps are later by this, s, and images are paired anew.
    DepthLate(f64),
    /// Depth images are mirrored horizontally.
    MirroredDepth,
}

/// Number of depth images kept for pairing: 0.5 s at 30 Hz.
const KEPT: usize = 15;

/// A stream with a fault.
#[derive(Debug)]
pub struct Faulty<S> {
    source: S,
    fault: Fault,
    /// Pending frames, and depth images with their stamps.
    waiting: VecDeque<RgbdFrame>,
    depths: VecDeque<(f64, DepthImage)>,
    ended: bool,
}

impl<S: FrameSource> Faulty<S> {
    /// Applies this fault to a source.
    pub fn new(source: S, fault: Fault) -> Self {
        Self {
            source,
            fault,
            waiting: VecDeque::new(),
            depths: VecDeque::new(),
            ended: false,
        }
    }

    /// The next frame with the depth image that is nearest after the delay.
    fn paired_anew(&mut self, late: f64) -> Option<Result<RgbdFrame, SourceError>> {
        while !self.ended && self.waiting.len() < KEPT {
            match self.source.next_frame() {
                None => self.ended = true,
                Some(Err(e)) => return Some(Err(e)),
                Some(Ok(frame)) => {
                    self.depths
                        .push_back((frame.depth_stamp + late, frame.depth.clone()));
                    self.waiting.push_back(frame);
                }
            }
        }
        let mut frame = self.waiting.pop_front()?;
        let distance = |d: &(f64, DepthImage)| (d.0 - frame.stamp).abs();
        let nearest = self
            .depths
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        (frame.depth_stamp, frame.depth) = (nearest.0, nearest.1.clone());
        if self.depths.len() > 2 * KEPT {
            self.depths.pop_front();
        }
        Some(Ok(frame))
    }
}

impl<S: FrameSource> FrameSource for Faulty<S> {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        if let Fault::DepthLate(late) = self.fault {
            return self.paired_anew(late);
        }
        let item = self.source.next_frame()?;
        Some(item.map(|mut frame| {
            apply(&self.fault, &mut frame);
            frame
        }))
    }

    fn remaining(&self) -> Option<usize> {
        self.source.remaining().map(|n| n + self.waiting.len())
    }
}

fn apply(fault: &Fault, frame: &mut RgbdFrame) {
    let (w, h) = (frame.depth.width(), frame.depth.height());
    let image = |data| DepthImage::from_vec(w, h, data).unwrap_or_default();
    match fault {
        Fault::DepthScale(factor) => {
            let scaled = frame.depth.data().iter().map(|z| z * *factor as f32);
            frame.depth = image(scaled.collect());
        }
        Fault::Unregistered {
            colour,
            depth,
            baseline,
        } => frame.depth = image(seen_from(&frame.depth, colour, depth, *baseline)),
        Fault::DepthLate(_) => {}
        Fault::MirroredDepth => {
            let mut data = frame.depth.data().to_vec();
            data.chunks_exact_mut(w.max(1)).for_each(<[f32]>::reverse);
            frame.depth = image(data);
        }
    }
}

/// A registered depth image as seen by its own camera: each measurement covers the pixels around its projection; the nearest wins.
fn seen_from(registered: &DepthImage, colour: &Camera, depth: &Camera, baseline: f64) -> Vec<f32> {
    let (w, h) = (registered.width(), registered.height());
    let mut out = vec![0.0_f32; w * h];
    for y in 0..h {
        for x in 0..w {
            let z = registered.at(x, y);
            if z <= 0.0 {
                continue;
            }
            let pixel = colour.undistort(Vec2::new(x as f64, y as f64));
            let point = colour.backproject(pixel, f64::from(z)) - Vec3::new(baseline, 0.0, 0.0);
            let there = depth.project_distorted(&point);
            let reach = (0.5 * depth.fx / colour.fx).max(0.5);
            let range = |p: f64, size: usize| {
                let first = (p - reach).ceil().max(0.0) as usize;
                first..((p + reach).floor() + 1.0).clamp(0.0, size as f64) as usize
            };
            for v in range(there.y, h) {
                for u in range(there.x, w) {
                    let seen = &mut out[v * w + u];
                    if *seen == 0.0 || z < *seen {
                        *seen = z;
                    }
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::{FrameId, GrayImage};

    /// Frames at 10 Hz whose depth is their number plus one, in a patch at the left.
    struct Numbered(u32);

    impl FrameSource for Numbered {
        fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
            let (id, stamp) = (self.0, f64::from(self.0) / 10.0);
            self.0 += 1;
            let mut depth = vec![0.0; 64 * 4];
            (0..4).for_each(|y| depth[64 * y + 8] = id as f32 + 1.0);
            (id < 40).then(|| {
                Ok(RgbdFrame {
                    id: FrameId(id),
                    stamp,
                    depth_stamp: stamp,
                    gray: GrayImage::new(64, 4),
                    colour: None,
                    depth: DepthImage::from_vec(64, 4, depth).unwrap(),
                })
            })
        }
    }

    fn all(fault: Fault) -> Vec<RgbdFrame> {
        let mut faulty = Faulty::new(Numbered(0), fault);
        std::iter::from_fn(|| faulty.next_frame())
            .map(|frame| frame.unwrap())
            .collect()
    }

    #[test]
    fn late_depth_is_paired_with_an_earlier_frame() {
        for (late, lag) in [(0.12, 1), (-0.21, -2), (0.04, 0)] {
            let frames = all(Fault::DepthLate(late));
            assert_eq!(frames.len(), 40);
            for frame in &frames[3..37] {
                let of = i64::from(frame.id.0) - lag;
                assert_eq!(frame.depth.at(8, 0), of as f32 + 1.0);
                assert!((frame.depth_stamp - of as f64 / 10.0 - late).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn faults_change_depth_scale_and_position() {
        assert_eq!(all(Fault::DepthScale(5.0))[1].depth.at(8, 2), 10.0);
        assert_eq!(all(Fault::MirroredDepth)[0].depth.at(55, 2), 1.0);
        let camera = Camera::pinhole(64, 4, [100.0, 100.0, 31.5, 1.5]);
        let aside = &all(Fault::Unregistered {
            colour: camera,
            depth: camera,
            baseline: -0.05,
        })[0];
        // 100 px times 0.05 m over 1 m.
        assert_eq!([8, 13].map(|x| aside.depth.at(x, 2)), [0.0, 1.0]);
    }
}
