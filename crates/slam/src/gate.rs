//! Admission of frames: refuses repeated, out-of-order and badly stamped frames and those of a wrong size.
//!
//! Drivers check a frame here first, so that a refused one changes nothing.

use stillpoint_geometry::Camera;
use stillpoint_imaging::{FrameId, RgbdFrame};

/// Why a frame was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum RefusalReason {
    /// Its number does not exceed that of the frame before: repeated, out of order, or the source does not count.
    Number {
        /// The greatest admitted number.
        newest: FrameId,
    },
    /// Its stamp is not later than that of the frame before: repeated, out of order, or the clock was set back.
    Stamp {
        /// The stamp of the frame before, s.
        newest: f64,
    },
    /// Its colour or depth stamp is not a number.
    NoStamp,
    /// Its grey or depth image does not have the camera's size.
    Size {
        /// Width and height of the camera, px.
        expected: [usize; 2],
        /// Of the grey image.
        gray: [usize; 2],
        /// Of the depth image.
        depth: [usize; 2],
    },
}

/// A refused frame. It has no effect on the system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefusedFrame {
    /// Frame number.
    pub frame: FrameId,
    /// Colour stamp, s.
    pub stamp: f64,
    /// Reason.
    pub reason: RefusalReason,
}

impl std::fmt::Display for RefusedFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            frame,
            stamp,
            reason,
        } = self;
        write!(f, "frame {frame} ({stamp:.6} s) was not looked at: ")?;
        match reason {
            RefusalReason::Number { newest } => write!(
                f,
                "expected a number greater than {newest}, found {frame}; number frames in the order in which they are taken"
            ),
            RefusalReason::Stamp { newest } => write!(
                f,
                "expected a stamp later than {newest:.6} s, found {stamp:.6} s; if the clock was set back, the next frame is looked at"
            ),
            RefusalReason::NoStamp => write!(
                f,
                "expected a colour and a depth stamp in seconds, found one that is no number"
            ),
            RefusalReason::Size {
                expected: [w, h],
                gray,
                depth,
            } => write!(
                f,
                "expected images of {w} x {h} px, the size of the camera, found {} x {} px and depth of {} x {} px",
                gray[0], gray[1], depth[0], depth[1]
            ),
        }
    }
}

impl std::error::Error for RefusedFrame {}

/// Admits frames in order of number and time.
///
/// A frame whose stamp is not later than the last one is refused. If the next frame is later than the refused one but
/// still not later than the last, the clock was set back, and frames follow the new time.
#[derive(Clone, Debug)]
pub struct FrameGate {
    size: [usize; 2],
    newest: Option<(FrameId, f64)>,
    /// Stamp of the frame before, if it was refused for its stamp.
    behind: Option<f64>,
}

impl FrameGate {
    /// A gate for frames of one camera.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        Self {
            size: [camera.width as usize, camera.height as usize],
            newest: None,
            behind: None,
        }
    }

    /// Admits or refuses the next frame.
    ///
    /// # Errors
    /// [`RefusedFrame`] for a frame that is out of order, has no stamps, or does not have the camera's size.
    pub fn admit(&mut self, frame: &RgbdFrame) -> Result<(), RefusedFrame> {
        self.check(frame).map_err(|reason| RefusedFrame {
            frame: frame.id,
            stamp: frame.stamp,
            reason,
        })
    }

    fn check(&mut self, frame: &RgbdFrame) -> Result<(), RefusalReason> {
        let gray = [frame.gray.width(), frame.gray.height()];
        let depth = [frame.depth.width(), frame.depth.height()];
        if gray != self.size || depth != self.size {
            return Err(RefusalReason::Size {
                expected: self.size,
                gray,
                depth,
            });
        }
        if !(frame.stamp.is_finite() && frame.depth_stamp.is_finite()) {
            return Err(RefusalReason::NoStamp);
        }
        if let Some((id, stamp)) = self.newest {
            if frame.id <= id {
                return Err(RefusalReason::Number { newest: id });
            }
            let set_back = self.behind.is_some_and(|before| frame.stamp > before);
            if frame.stamp <= stamp && !set_back {
                self.behind = Some(frame.stamp);
                return Err(RefusalReason::Stamp { newest: stamp });
            }
        }
        self.newest = Some((frame.id, frame.stamp));
        self.behind = None;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::{DepthImage, GrayImage};

    fn camera() -> Camera {
        Camera::pinhole(8, 6, [5.0, 5.0, 3.5, 2.5])
    }

    fn frame(id: u32, stamp: f64) -> RgbdFrame {
        RgbdFrame {
            id: FrameId(id),
            stamp,
            depth_stamp: stamp,
            gray: GrayImage::new(8, 6),
            colour: None,
            depth: DepthImage::from_vec(8, 6, vec![0.0; 48]).unwrap(),
        }
    }

    fn admitted(frames: &[(u32, f64)]) -> Vec<u32> {
        let mut gate = FrameGate::new(&camera());
        let fits = |(id, stamp): &&(u32, f64)| gate.admit(&frame(*id, *stamp)).is_ok();
        frames.iter().filter(fits).map(|f| f.0).collect()
    }

    #[test]
    fn repeated_and_late_frames_are_refused() {
        // A repeated frame, and a repeated image with a new number.
        assert_eq!(admitted(&[(0, 0.0), (0, 0.0), (1, 0.1)]), [0, 1]);
        assert_eq!(admitted(&[(0, 0.0), (1, 0.0), (2, 0.1), (3, 0.1)]), [0, 2]);
        // Late with its own number, late with a new one, and several in reverse order.
        assert_eq!(
            admitted(&[(0, 0.0), (2, 0.2), (1, 0.1), (3, 0.3)]),
            [0, 2, 3]
        );
        assert_eq!(
            admitted(&[(0, 0.0), (1, 0.2), (2, 0.1), (3, 0.3)]),
            [0, 1, 3]
        );
        assert_eq!(
            admitted(&[(0, 0.0), (1, 0.4), (2, 0.3), (3, 0.2), (4, 0.1), (5, 0.5)]),
            [0, 1, 5]
        );
        // All frames have the same number.
        assert_eq!(admitted(&[(7, 0.0), (7, 0.1), (7, 0.2)]), [7]);
    }

    #[test]
    fn clock_set_back_loses_only_one_frame() {
        for back in [3600.0, 0.05] {
            let mut frames: Vec<(u32, f64)> =
                (0..10).map(|i| (i, 100.0 + 0.1 * f64::from(i))).collect();
            frames[5..].iter_mut().for_each(|f| f.1 -= back + 0.1);
            let expected: Vec<u32> = (0..10).filter(|i| *i != 5).collect();
            assert_eq!(admitted(&frames), expected, "{back}");
        }
        // A jump forward loses nothing; numbers must still increase.
        assert_eq!(admitted(&[(0, 0.0), (1, 9e9), (2, 9e9 + 1.0)]), [0, 1, 2]);
        assert_eq!(admitted(&[(8, 1.0), (0, 2.0), (1, 3.0)]), [8]);
    }

    #[test]
    fn refusals_report_their_reason() {
        let mut gate = FrameGate::new(&camera());
        assert_eq!(gate.admit(&frame(4, 1.0)), Ok(()));
        let mut refused = |change: fn(&mut RgbdFrame), text: &str| {
            let mut frame = frame(5, 1.5);
            change(&mut frame);
            let e = gate.admit(&frame).unwrap_err();
            assert!(e.to_string().contains(text), "{e}");
        };
        refused(
            |f| f.id = FrameId(4),
            "frame 4 (1.500000 s) was not looked at",
        );
        refused(|f| f.id = FrameId(3), "a number greater than 4, found 3");
        refused(|f| f.stamp = 0.5, "later than 1.000000 s, found 0.500000 s");
        refused(|f| f.stamp = f64::NAN, "no number");
        refused(|f| f.depth_stamp = f64::INFINITY, "no number");
        refused(
            |f| f.gray = GrayImage::new(6, 8),
            "8 x 6 px, the size of the camera, found 6 x 8 px and depth of 8 x 6 px",
        );
        refused(|f| f.depth = DepthImage::default(), "depth of 0 x 0 px");
        assert_eq!(gate.admit(&frame(5, 1.5)), Ok(()));
    }
}
