//! Images as they came, decoded as the files of a data set are: grey by the luma, depth in metres.

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

/// In which order the bytes of a pixel are.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    Rgb,
    Bgr,
}

impl Order {
    /// As the user says; RGB where nothing is said.
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

/// Memory for images on their way, to be used again: what is got from the system anew for each frame costs as much as the work on it.
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

/// How the frames of one camera come in: what every object that takes frames keeps for it.
pub(crate) struct Intake {
    pub(crate) camera: Camera,
    order: Order,
    /// Whether anybody looks at the colours.
    keep_colour: AtomicBool,
    spare: Spare,
}

/// A frame that came in, and what a detector of the user's said of it; none where nobody looked.
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

    /// From now on somebody looks at the colours.
    pub(crate) fn keep_colour(&self) {
        self.keep_colour.store(true, Ordering::Relaxed);
    }

    /// Checks all that is handed over, then decodes the frame without the interpreter's lock.
    pub(crate) fn take(&self, py: Python<'_>, handed: &Handed<'_, '_>) -> PyResult<Arrived> {
        let raw = handed.copy(&self.camera, self.order, &self.spare)?;
        let seen = handed.detections.map(|d| detections("detections", d));
        let seen = seen.transpose()?;
        let keep = self.keep_colour.load(Ordering::Relaxed);
        let taken = detached(py, || raw.decode(keep, &self.spare))?;
        Ok((taken.map_err(|e| value("color", e))?, seen))
    }
}

/// A frame that does not follow the one before, by the argument that is to blame.
pub(crate) fn refused(refused: RefusedFrame) -> PyErr {
    match refused.reason {
        RefusalReason::Stamp { .. } => value("stamp", refused),
        _ => value("frame", refused),
    }
}

/// Why there is no answer to a frame, as an exception.
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

/// What a user hands over for one frame, with its stamps and what a detector saw in it.
pub(crate) struct Handed<'a, 'py> {
    pub(crate) stamp: &'a Bound<'py, PyAny>,
    pub(crate) colour: &'a Bound<'py, PyAny>,
    pub(crate) depth: &'a Bound<'py, PyAny>,
    pub(crate) depth_stamp: Option<&'a Bound<'py, PyAny>>,
    pub(crate) detections: Option<&'a Bound<'py, PyAny>>,
}

/// The same, checked and copied.
struct Raw {
    stamps: [f64; 2],
    pixels: Pixels,
    depths: Depths,
    size: [usize; 2],
    order: Order,
    depth_scale: f64,
}

impl Handed<'_, '_> {
    /// Checks everything, and copies it: Python may change its arrays as soon as its lock is free.
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
    /// The frame; with its colours where they are wanted.
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

/// As the decoder of data sets has it: one rounding, and 65535 stands for no measurement.
fn metres(raw: u16, scale: f64) -> f32 {
    if raw == u16::MAX {
        0.0
    } else {
        (f64::from(raw) / scale) as f32
    }
}
