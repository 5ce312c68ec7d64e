//! Safe wrappers of the used part of librealsense's C interface (rs.h, rs_pipeline.h, rs_config.h, rs_frame.h, rs_sensor.h of version 2).
//! Numbers of options differ between versions, so options are found by name.
//!
//! `unsafe` is allowed here and nowhere else in the crate: symbols of a library that is loaded at run time have no types that a compiler
//! could check.
#![allow(unsafe_code)]

mod functions;
mod running;

pub(crate) use functions::{Extrinsics, Intrinsics};
pub(crate) use running::Running;

use functions::{Fault, Functions, Object};
use libloading::Library;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::mem::ManuallyDrop;
use std::path::Path;
use std::ptr::{NonNull, null_mut};
use std::sync::Arc;

/// Values of `rs2_stream`, `rs2_format` and `rs2_camera_info` that are the same in all versions.
const DEPTH: c_int = 1;
const COLOUR: c_int = 2;
const GYRO: c_int = 5;
const ACCEL: c_int = 6;
const Z16: c_int = 1;
const RGB8: c_int = 5;
const MOTION_XYZ32F: c_int = 16;
/// `RS2_EXTENSION_MOTION_FRAME`.
const MOTION_FRAME: c_int = 9;
const NAME: c_int = 0;
const SERIAL: c_int = 1;
/// `RS2_PLAYBACK_STATUS_STOPPED`.
const STOPPED: c_int = 3;
/// Option numbers are below this.
const MOST_OPTIONS: c_int = 512;
/// Maximum number of waiting image pairs: one second of them.
const WAITING: c_int = 30;
/// Maximum number of waiting image pairs and inertial samples: one second of them, with samples of up to 400 and 250 Hz.
const WAITING_INERTIAL: c_int = 700;

pub(crate) struct Api {
    functions: Functions,
    // Never closed: it may have threads.
    _library: ManuallyDrop<Library>,
}

/// An object of the library, released on drop.
struct Handle {
    object: NonNull<c_void>,
    free: unsafe extern "C" fn(Object),
}

// SAFETY: objects of librealsense may be used from any thread, one at a time; a handle is not shared.
unsafe impl Send for Handle {}

impl Handle {
    fn get(&self) -> Object {
        self.object.as_ptr()
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the object came from the library together with its release function, and has no other owner.
        unsafe { (self.free)(self.object.as_ptr()) }
    }
}

/// A text of the library; empty for null.
fn text(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return String::new();
    }
    // SAFETY: texts of the library are zero-terminated, and live at least until the next call.
    let said = unsafe { CStr::from_ptr(pointer) }.to_string_lossy();
    said.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The system's error under that of libloading, without the file's name, with which messages begin.
fn reason(error: &libloading::Error, file: &Path) -> String {
    let said = std::error::Error::source(error).map(ToString::to_string);
    let said = said.unwrap_or_else(|| error.to_string());
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    let name = format!("{}: ", file.display());
    said.strip_prefix(&name).unwrap_or(&said).to_owned()
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Wanted {
    pub(crate) serial: Option<CString>,
    /// A recording that is played in place of a camera.
    pub(crate) file: Option<CString>,
    /// Width and height, px, and frames per second; zero leaves the choice to a recording.
    pub(crate) size: [i32; 2],
    pub(crate) rate: i32,
    /// Whether to start gyroscope and accelerometer too.
    pub(crate) inertial: bool,
}

/// A sample of the gyroscope or the accelerometer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    pub(crate) is_rate: bool,
    /// By the device's clock, microseconds.
    pub(crate) stamp_us: i64,
    /// rad/s or m/s^2.
    pub(crate) value: [f32; 3],
}

pub(crate) enum News {
    Images(Box<Images>),
    Motion(Motion),
    Nothing,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Connected {
    pub(crate) name: String,
    pub(crate) serial: String,
}

/// An option of a device: sensor, name and value.
#[derive(Clone, Debug)]
pub(crate) struct Setting {
    /// Part of the sensor's name; empty for any sensor.
    pub(crate) sensor: &'static str,
    pub(crate) option: &'static str,
    pub(crate) value: f32,
}

#[derive(Clone, Debug)]
pub(crate) struct Image {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Row stride, bytes.
    pub(crate) stride: u32,
    pub(crate) data: Vec<u8>,
    /// Exposure time by the device's clock, microseconds: the resolution of recordings.
    pub(crate) stamp_us: i64,
}

#[derive(Clone, Debug)]
pub(crate) struct Description {
    pub(crate) colour: (Intrinsics, String),
    pub(crate) depth: (Intrinsics, String),
    pub(crate) colour_from_depth: Extrinsics,
    /// Pose of the gyroscope, if started, or the reason why it is unknown.
    pub(crate) colour_from_gyro: Option<Result<Extrinsics, String>>,
    /// Metres per depth value.
    pub(crate) unit: f64,
}

/// A synchronous pair of images.
pub(crate) struct Images {
    pub(crate) colour: Image,
    pub(crate) depth: Image,
    /// If requested.
    pub(crate) description: Option<Description>,
}

impl Api {
    /// Loads the library in a file.
    ///
    /// # Errors
    /// The file is not a library.
    pub(crate) fn load(file: &Path) -> Result<Arc<Self>, String> {
        // Opening a pipe would block.
        if !file.is_file() {
            return Err("no such file".to_owned());
        }
        // SAFETY: runs the library's initialisers, which are trusted as its other code is: the user has installed the file or named it.
        let library = unsafe { Library::new(file) };
        let library = ManuallyDrop::new(library.map_err(|e| reason(&e, file))?);
        let functions = Functions::find(&library)
            .map_err(|name| format!("no function {name}: it is another library, or too old"))?;
        Ok(Arc::new(Self {
            functions,
            _library: library,
        }))
    }

    /// Calls a function that reports errors through its last argument.
    fn call<T>(&self, function: impl FnOnce(Fault) -> T) -> Result<T, String> {
        let mut error = null_mut();
        let value = function(&mut error);
        if error.is_null() {
            return Ok(value);
        }
        // SAFETY: the error came from the library and is freed once.
        let said = unsafe {
            let said = text((self.functions.get_error_message)(error));
            (self.functions.free_error)(error);
            said
        };
        Err(said)
    }

    /// Likewise for a function that creates an object.
    fn make(
        &self,
        free: unsafe extern "C" fn(Object),
        function: impl FnOnce(Fault) -> Object,
    ) -> Result<Handle, String> {
        let object = NonNull::new(self.call(function)?);
        let object = object.ok_or_else(|| "the library gave nothing".to_owned())?;
        Ok(Handle { object, free })
    }

    /// The version, as 20540 for 2.54.0.
    pub(crate) fn version(&self) -> Result<i32, String> {
        // SAFETY: takes only the error output.
        self.call(|e| unsafe { (self.functions.get_api_version)(e) })
    }

    fn context(&self) -> Result<Handle, String> {
        let (f, version) = (&self.functions, self.version()?);
        // SAFETY: the version is the library's own.
        self.make(f.delete_context, |e| unsafe {
            (f.create_context)(version, e)
        })
    }

    fn device_info(&self, device: &Handle, info: c_int) -> String {
        let f = &self.functions;
        // SAFETY: a device of this library, and numbers that all versions have.
        let supported = self.call(|e| unsafe { (f.supports_device_info)(device.get(), info, e) });
        if supported != Ok(1) {
            return String::new();
        }
        // SAFETY: as before.
        let said = self.call(|e| unsafe { (f.get_device_info)(device.get(), info, e) });
        said.map(text).unwrap_or_default()
    }

    fn connected(&self, device: &Handle) -> Connected {
        Connected {
            name: self.device_info(device, NAME),
            serial: self.device_info(device, SERIAL),
        }
    }

    pub(crate) fn devices(&self) -> Result<Vec<Connected>, String> {
        let f = &self.functions;
        let context = self.context()?;
        // SAFETY: a context, and a list with its stated number of devices.
        unsafe {
            let list = self.make(f.delete_device_list, |e| {
                (f.query_devices)(context.get(), e)
            })?;
            let count = self.call(|e| (f.get_device_count)(list.get(), e))?;
            let device = |i| self.make(f.delete_device, |e| (f.create_device)(list.get(), i, e));
            (0..count)
                .map(|i| Ok(self.connected(&device(i)?)))
                .collect()
        }
    }

    pub(crate) fn start(self: &Arc<Self>, wanted: &Wanted) -> Result<Running, String> {
        let f = &self.functions;
        let context = self.context()?;
        let [width, height] = wanted.size.map(c_int::from);
        // SAFETY: all objects are those of this library, made just before; texts are zero-terminated; the queue outlives the pipeline that
        // fills it.
        unsafe {
            let config = self.make(f.delete_config, |e| (f.create_config)(e))?;
            if let Some(file) = &wanted.file {
                self.call(|e| {
                    (f.config_enable_device_from_file_repeat_option)(
                        config.get(),
                        file.as_ptr(),
                        0,
                        e,
                    )
                })?;
            }
            if let Some(serial) = &wanted.serial {
                self.call(|e| (f.config_enable_device)(config.get(), serial.as_ptr(), e))?;
            }
            for (stream, format) in [(DEPTH, Z16), (COLOUR, RGB8)] {
                self.call(|e| {
                    (f.config_enable_stream)(
                        config.get(),
                        stream,
                        -1,
                        width,
                        height,
                        format,
                        wanted.rate,
                        e,
                    )
                })?;
            }
            if wanted.inertial {
                for stream in [GYRO, ACCEL] {
                    self.call(|e| {
                        (f.config_enable_stream)(
                            config.get(),
                            stream,
                            -1,
                            0,
                            0,
                            MOTION_XYZ32F,
                            0,
                            e,
                        )
                    })?;
                }
            }
            let waiting = if wanted.inertial {
                WAITING_INERTIAL
            } else {
                WAITING
            };
            let queue = self.make(f.delete_frame_queue, |e| (f.create_frame_queue)(waiting, e))?;
            let pipeline =
                self.make(f.delete_pipeline, |e| (f.create_pipeline)(context.get(), e))?;
            let profile = self.make(f.delete_pipeline_profile, |e| {
                (f.pipeline_start_with_config_and_callback)(
                    pipeline.get(),
                    config.get(),
                    f.enqueue_frame,
                    queue.get(),
                    e,
                )
            })?;
            let device = self.make(f.delete_device, |e| {
                (f.pipeline_profile_get_device)(profile.get(), e)
            });
            let running = Running {
                api: Arc::clone(self),
                is_file: wanted.file.is_some(),
                device: device.ok(),
                profile,
                pipeline,
                queue,
                _config: config,
                _context: context,
            };
            Ok(running)
        }
    }
}
