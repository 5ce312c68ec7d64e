//! Decoding of images as in data sets: grey from luma, depth in metres.

use crate::arguments::{Depths, Pixels, colour, depth, stamp, value, words};
use crate::camera::Camera;
use crate::detections::detections;
use crate::driver::{Taken, Trouble};
use crate::guard::detached;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use stillpoint::detection::Detection;
use stillpoint::imaging::{ColourImage, DepthImage, GrayImage, SizeError};
use stillpoint::slam::{RefusalReason, RefusedFrame};

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    Rgb,
    Bgr,
}

impl Order {
    /// RGB by default.
    pub(crate) fn of(found: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let said = found.map(|f| words("color_order", f)).transpose()?;
        match said.as_deref().unwrap_or("rgb") {
            "rgb" => Ok(Self::Rgb),
            "bgr" => Ok(Self::Bgr),
            other => Err(value(
                "color_order",
                format!("expected \"rgb\" or \"bgr\", found {other:?}"),
            )),
        }
    }
}

/// Reusable image buffers: allocating them for each frame costs as much as processing it.
#[derive(Default)]
struct Spare(Mutex<(Vec<u8>, Vec<u16>)>);

impl Spare {
    fn take(&self) -> (Vec<u8>, Vec<u16>) {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn give_back(&self, colours: Vec<u8>, depths: Vec<u16>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = (colours, depths);
    }
}

/// Input of frames of one camera.
pub(crate) struct Intake {
    pub(crate) camera: Camera,
    order: Order,
    keep_colour: AtomicBool,
    spare: Spare,
}

/// A decoded frame with the user's detections; `None` if the detector did not run.
pub(crate) type Arrived = (Taken, Option<Vec<Detection>>);

impl Intake {
    pub(crate) fn new(camera: Camera, order: Order, keep_colour: bool) -> Self {
        Self {
            camera,
            order,
            keep_colour: AtomicBool::new(keep_colour),
            spare: Spare::default(),
        }
    }

    /// Keeps the colours of frames from here on.
    pub(crate) fn keep_colour(&self) {
        self.keep_colour.store(true, Ordering::Relaxed);
    }

    /// Checks all arguments, then decodes the frame without the interpreter's lock.
    pub(crate) fn take(&self, py: Python<'_>, handed: &Handed<'_, '_>) -> PyResult<Arrived> {
        let raw = handed.copy(&self.camera, self.order, &self.spare)?;
        let seen = handed.detections.map(|d| detections("detections", d));
        let seen = seen.transpose()?;
        let keep = self.keep_colour.load(Ordering::Relaxed);
        let taken = detached(py, || raw.decode(keep, &self.spare))?;
        Ok((taken.map_err(|e| value("color", e))?, seen))
    }
}

/// The exception for a refused frame, naming the wrong argument.
pub(crate) fn refused(refused: RefusedFrame) -> PyErr {
    match refused.reason {
        RefusalReason::Stamp { .. } => value("stamp", refused),
        _ => value("frame", refused),
    }
}

pub(crate) fn trouble(trouble: Trouble) -> PyErr {
    match trouble {
        Trouble::Refused(frame) => refused(frame),
        Trouble::Over => PyRuntimeError::new_err(
            "expected a run that goes on, found one that finish() ended; begin a new Slam",
        ),
        Trouble::Full => {
            PyRuntimeError::new_err("as many frames as there are numbers for: begin a new Slam")
        }
        Trouble::Broken(why) => PyRuntimeError::new_err(format!(
            "expected the run's threads to be there, found that one ended: {why}; begin a new Slam, and please report this"
        )),
    }
}

/// Arguments for one frame.
pub(crate) struct Handed<'a, 'py> {
    pub(crate) stamp: &'a Bound<'py, PyAny>,
    pub(crate) colour: &'a Bound<'py, PyAny>,
    pub(crate) depth: &'a Bound<'py, PyAny>,
    pub(crate) depth_stamp: Option<&'a Bound<'py, PyAny>>,
    pub(crate) detections: Option<&'a Bound<'py, PyAny>>,
}

/// Checked and copied arguments.
struct Raw {
    stamps: [f64; 2],
    pixels: Pixels,
    depths: Depths,
    size: [usize; 2],
    order: Order,
    depth_scale: f64,
}

impl Handed<'_, '_> {
    /// Python code may change its arrays as soon as the lock is released.
    fn copy(&self, camera: &Camera, order: Order, spare: &Spare) -> PyResult<Raw> {
        let (colours, depths) = spare.take();
        let size = camera.size();
        let time = stamp("stamp", self.stamp)?;
        let depth_time = self
            .depth_stamp
            .map(|s| stamp("depth_stamp", s))
            .transpose()?;
        Ok(Raw {
            stamps: [time, depth_time.unwrap_or(time)],
            pixels: colour(self.colour, size, colours)?,
            depths: depth(self.depth, size, depths)?,
            size,
            order,
            depth_scale: camera.model.depth_scale,
        })
    }
}

impl Raw {
    /// Decodes the frame, with its colours if needed.
    fn decode(self, keep_colour: bool, spare: &Spare) -> Result<Taken, SizeError> {
        let [w, h] = self.size;
        let (mut bytes_left, mut raw_left) = (Vec::new(), Vec::new());
        let (gray, colour) = match self.pixels {
            Pixels::Gray(gray) => {
                let colour = keep_colour.then(|| gray.iter().flat_map(|v| [*v; 3]).collect());
                let colour = colour.map(|rgb| ColourImage::from_vec(w, h, rgb));
                (GrayImage::from_vec(w, h, gray)?, colour.transpose()?)
            }
            Pixels::Colour(mut bytes) => {
                if self.order == Order::Bgr {
                    bytes.chunks_exact_mut(3).for_each(|p| p.swap(0, 2));
                }
                let colour = ColourImage::from_vec(w, h, bytes)?;
                let gray = colour.to_gray();
                if keep_colour {
                    (gray, Some(colour))
                } else {
                    bytes_left = colour.into_vec();
                    (gray, None)
                }
            }
        };
        let depth = match self.depths {
            Depths::Metres(metres) => metres,
            Depths::Raw(raw) => {
                let depth = raw.iter().map(|v| metres(*v, self.depth_scale)).collect();
                raw_left = raw;
                depth
            }
        };
        spare.give_back(bytes_left, raw_left);
        let [stamp, depth_stamp] = self.stamps;
        Ok(Taken {
            stamp,
            depth_stamp,
            gray,
            colour: colour.map(Arc::new),
            depth: DepthImage::from_vec(w, h, depth)?,
        })
    }
}

/// As in the decoder of data sets: one rounding, and 65535 means unmeasured.
fn metres(raw: u16, scale: f64) -> f32 {
    if raw == u16::MAX {
        0.0
    } else {
        (f64::from(raw) / scale) as f32
    }
}
