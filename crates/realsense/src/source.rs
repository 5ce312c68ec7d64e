//! The frames of a running camera, which may be unplugged and reconnected.

use crate::camera::Started;
use crate::inertial::Joined;
use crate::library::{Image, Images, News};
use std::sync::Arc;
use std::time::{Duration, Instant};
use stillpoint_imaging::{FrameId, FrameSource, ImuSample, RgbdFrame, SourceError};
use stillpoint_recordings::RawFrames;
use stillpoint_ros_messages as ros;

/// A camera without images for this time is lost, ms.
const WAIT: u32 = 1000;
/// Maximum time between a reused depth image and the colour image, microseconds: half a frame at 25 Hz.
const FARTHEST_US: i64 = 20_000;
/// Added to the stamp of a reused depth image, microseconds: no two images of a recording have the same stamp.
const TWICE_US: i64 = 10;
/// Interval of attempts to find a lost camera.
const LOOK: Duration = Duration::from_millis(500);
/// Number of attempts to find a missing camera before the next error reports it. The program handles a request to stop between errors.
const LOOKS: usize = 6;

pub(crate) struct Frames {
    started: Option<Started>,
    again: Option<Again>,
    raw: Arc<RawFrames>,
    keep_colour: bool,
    next_id: u32,
    /// Stamps of the last pair, microseconds.
    last: Option<(i64, i64)>,
    inertial: Joined,
}

struct Again {
    start: Box<dyn Fn() -> Result<Started, String> + Send>,
    name: String,
}

impl Again {
    /// Waits for it for a limited time.
    fn wait(&self) -> Result<Started, SourceError> {
        for _ in 0..LOOKS {
            if let Ok(started) = (self.start)() {
                return Ok(started);
            }
            std::thread::sleep(LOOK);
        }
        Err(SourceError {
            message: format!("{}: still not there", self.name),
            recoverable: true,
        })
    }
}

impl Frames {
    pub(crate) fn new(started: Started, raw: Arc<RawFrames>, keep_colour: bool) -> Self {
        Self {
            started: Some(started),
            again: None,
            raw,
            keep_colour,
            next_id: 0,
            last: None,
            inertial: Joined::default(),
        }
    }

    /// Stops a camera without images, and reports that once.
    fn lose(&mut self, started: Started, reason: &str) -> SourceError {
        let Started {
            api,
            running,
            wanted,
            settings,
            name,
            ..
        } = started;
        drop(running);
        let message = format!(
            "{name}: no image for {:.0} s ({reason}): waiting for it to come back",
            f64::from(WAIT) / 1e3
        );
        self.again = Some(Again {
            start: Box::new(move || {
                Started::start(Arc::clone(&api), wanted.clone(), settings.clone())
            }),
            name,
        });
        SourceError {
            message,
            recoverable: true,
        }
    }

    /// The next new pair of images, if one comes within `wait`, ms; samples of the inertial sensor are collected.
    fn images(&mut self, started: &Started, wait: u32) -> Result<Option<Box<Images>>, String> {
        let until = Instant::now() + Duration::from_millis(wait.into());
        loop {
            match started.running.next(wait, false)? {
                News::Images(images) => return Ok(Some(images).filter(|i| self.is_news(i))),
                News::Motion(motion) => self.inertial.take(motion),
                News::Nothing => return Ok(None),
            }
            // A camera that sends only inertial samples is lost.
            if wait == WAIT && Instant::now() > until {
                return Err("samples of the inertial sensor only".to_owned());
            }
        }
    }

    fn is_news(&self, images: &Images) -> bool {
        is_news(self.last, (images.colour.stamp_us, images.depth.stamp_us))
    }

    fn frame(&mut self, images: &Images) -> Result<RgbdFrame, SourceError> {
        let id = self.next_id;
        self.next_id += 1;
        let (colour, depth) = (&images.colour, &images.depth);
        let stamps = (colour.stamp_us, depth.stamp_us);
        let serves_twice = self.last.is_some_and(|last| stamps.1 == last.1);
        let depth_stamp = stamps.1 + if serves_twice { TWICE_US } else { 0 };
        self.last = Some(stamps);
        let frame = self.raw.frame(
            FrameId(id),
            (seconds(stamps.0), seconds(depth_stamp)),
            &message(colour, "rgb8"),
            &message(depth, "16UC1"),
            self.keep_colour,
        );
        frame.map_err(|e| SourceError {
            message: format!("frame {id} ({:.6} s): {e}", seconds(stamps.0)),
            recoverable: true,
        })
    }
}

/// Whether the colour image of a pair is new, by stamps: if one of the two is late, librealsense pairs the other twice. A depth image may
/// be reused if near enough.
fn is_news(last: Option<(i64, i64)>, (colour, depth): (i64, i64)) -> bool {
    last.is_none_or(|last| {
        colour != last.0 && (depth != last.1 || (colour - depth).abs() <= FARTHEST_US)
    })
}

/// Microseconds as seconds, rounded as in recordings: a recording of the run has the same stamps.
pub(crate) fn seconds(us: i64) -> f64 {
    let (whole, rest) = (us.div_euclid(1_000_000), us.rem_euclid(1_000_000));
    whole as f64 + (rest * 1000) as f64 / 1e9
}

fn message<'a>(image: &'a Image, encoding: &'static str) -> ros::Image<'a> {
    ros::Image {
        height: image.height,
        width: image.width,
        encoding: encoding.into(),
        is_bigendian: 0,
        step: image.stride,
        data: image.data.as_slice().into(),
        ..ros::Image::default()
    }
}

impl FrameSource for Frames {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        loop {
            let Some(mut started) = self.started.take() else {
                match self.again.as_ref()?.wait() {
                    Ok(started) => self.started = Some(started),
                    Err(e) => return Some(Err(e)),
                }
                continue;
            };
            if let Some(images) = started.first.take() {
                self.started = Some(started);
                return Some(self.frame(&images));
            }
            let has_ended = started.running.has_ended();
            // At the end of a recording, waiting frames are still read.
            let wait = if has_ended { 1 } else { WAIT };
            match self.images(&started, wait) {
                Ok(Some(images)) => {
                    self.started = Some(started);
                    return Some(self.frame(&images));
                }
                Ok(None) => self.started = Some(started),
                Err(_) if has_ended || started.running.has_ended() => return None,
                Err(reason) => return Some(Err(self.lose(started, &reason))),
            }
        }
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        self.inertial.joined()
    }

    fn is_live(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_images_are_not_new_frames() {
        let last = Some((100_000, 104_000));
        assert!(is_news(None, (100_000, 104_000)));
        assert!(is_news(last, (133_333, 137_000)));
        // The previous depth image is near, or a frame old.
        assert!(is_news(last, (120_000, 104_000)));
        assert!(!is_news(last, (133_333, 104_000)));
        assert!(!is_news(last, (100_000, 137_000)));
    }

    #[test]
    fn stamps_equal_those_of_a_recording() {
        assert_eq!(seconds(1_533_333), 1.0 + 533_333_000.0 / 1e9);
        assert_eq!(seconds(-500_000), -0.5);
    }
}
