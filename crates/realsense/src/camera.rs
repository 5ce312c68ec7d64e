//! Finds, starts and describes a camera.

use crate::description::{pair, pose};
use crate::error::{RealSenseError, Result};
use crate::find::candidates;
use crate::library::{Api, Connected, Description, Images, News, Running, Setting, Wanted};
use crate::source::Frames;
use std::ffi::CString;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use stillpoint_datasets::CameraModel;
use stillpoint_geometry::ImuModel;
use stillpoint_imaging::FrameSource;
use stillpoint_recordings::{Device, RawFrames, RecordingError};

/// Oldest version with all required functions, in the library's numbering.
const OLDEST: i32 = 25_000;
/// Maximum wait for the first frames, ms each: a camera that was just connected takes seconds.
const FIRST_WAIT: u32 = 5000;

/// Selects a camera and its settings.
#[derive(Clone, Debug)]
pub struct Options {
    /// Its serial number; `None` for the only connected one.
    pub serial: Option<String>,
    /// A recording (`.bag`, `.db3`) that librealsense plays in place of a camera.
    pub playback: Option<PathBuf>,
    /// Width and height of both images, px.
    pub size: (u32, u32),
    /// Frames per second.
    pub rate: u32,
    /// Whether the projector of the depth camera is on; `None` leaves it unchanged.
    pub emitter: Option<bool>,
    /// Exposure of the colour camera, ms; `None` for automatic exposure.
    pub exposure: Option<f64>,
    /// Whether to start its inertial sensor, if present (D435i, D455).
    pub inertial: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            serial: None,
            playback: None,
            size: (640, 480),
            rate: 30,
            emitter: None,
            exposure: None,
            inertial: true,
        }
    }
}

/// A running camera.
#[derive(Debug)]
pub struct RealSense {
    name: String,
    guesses: Vec<String>,
    raw: Arc<RawFrames>,
    /// The running camera, until its frames are requested.
    started: Mutex<Option<Started>>,
}

/// A running camera, and the means to restart it.
pub(crate) struct Started {
    /// The first pair of images, which also described the camera.
    pub(crate) first: Option<Images>,
    pub(crate) api: Arc<Api>,
    pub(crate) running: Running,
    pub(crate) wanted: Wanted,
    pub(crate) settings: Vec<Setting>,
    pub(crate) name: String,
}

impl std::fmt::Debug for Started {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Started")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

impl Started {
    pub(crate) fn start(
        api: Arc<Api>,
        wanted: Wanted,
        settings: Vec<Setting>,
    ) -> std::result::Result<Self, String> {
        let running = api.start(&wanted)?;
        for setting in &settings {
            running.set(setting)?;
        }
        let Connected { mut name, serial } = running.connected();
        if name.is_empty() {
            name.push_str("RealSense");
        }
        let name = if serial.is_empty() {
            name
        } else {
            format!("{name} {serial}")
        };
        Ok(Self {
            first: None,
            api,
            running,
            wanted,
            settings,
            name,
        })
    }
}

impl RealSense {
    /// Finds the library and the camera, and starts it.
    ///
    /// # Errors
    /// No library, no camera or several, or one without images.
    pub fn open(options: &Options) -> Result<Self> {
        let (api, library) = load()?;
        let wanted = wanted(&api, options)?;
        let settings = settings(options);
        let expected = format!(
            "{} x {} px at {} Hz",
            options.size.0, options.size.1, options.rate
        );
        let failed = |device: &str, found: String| RealSenseError::Start {
            device: device.to_owned(),
            expected: expected.clone(),
            found,
            advice: "connect it to USB 3, end other programs that use it, or ask for another size",
        };
        let mut started =
            start(&api, wanted, &settings, options.inertial).map_err(|e| failed("RealSense", e))?;
        let (images, described) = first(&started.running).map_err(|e| failed(&started.name, e))?;
        started.first = Some(images);
        let pair = pair(&started.name, &described).map_err(|e| failed(&started.name, e))?;
        let raw = RawFrames::new(&pair).map_err(|e| failed(&started.name, e))?;
        let mount = described.colour_from_gyro.as_ref();
        let mount = mount.map(|found| {
            let found = found.as_ref().map_err(Clone::clone)?;
            pose(found).ok_or_else(|| format!("a rotation that is none: {:?}", found.rotation))
        });
        let raw = raw.with_imu(
            mount
                .as_ref()
                .and_then(|m| m.as_ref().ok())
                .map(|pose| ImuModel::bmi055().mounted(*pose)),
        );
        let c = &raw.camera().camera;
        let (fx, fy, cx, cy) = (c.fx, c.fy, c.cx, c.cy);
        let beside = pair
            .colour_from_depth
            .map_or(0.0, |p| p.translation.norm() * 1e3);
        let mut guesses = vec![
            format!(
                "camera: {} by {library} (fx {fx:.1}, fy {fy:.1}, cx {cx:.1}, cy {cy:.1} px)",
                started.name
            ),
            format!(
                "depth: {} values per metre, registered to the colour camera, {beside:.1} mm beside",
                raw.camera().depth_scale
            ),
        ];
        guesses.extend(mount.map(|mount| match mount {
            Ok(pose) => format!(
                "inertial sensor: the camera's own, {:.1} mm beside",
                pose.translation.norm() * 1e3
            ),
            Err(found) => format!(
                "inertial sensor: not used, as the camera does not say how it is mounted ({found})"
            ),
        }));
        Ok(Self {
            guesses,
            name: started.name.clone(),
            raw: Arc::new(raw),
            started: Mutex::new(Some(started)),
        })
    }
}

impl Device for RealSense {
    fn kind(&self) -> String {
        "RealSense".to_owned()
    }

    fn camera(&self) -> &CameraModel {
        self.raw.camera()
    }

    fn guesses(&self) -> &[String] {
        &self.guesses
    }

    fn frames(&self, keep_colour: bool) -> stillpoint_recordings::Result<Box<dyn FrameSource>> {
        let mut started = self.started.lock().unwrap_or_else(PoisonError::into_inner);
        let started = started.take().ok_or_else(|| RecordingError::Device {
            device: self.name.clone(),
            expected: "to be asked once for its frames".to_owned(),
            found: "a second time".to_owned(),
        })?;
        Ok(Box::new(Frames::new(
            started,
            Arc::clone(&self.raw),
            keep_colour,
        )))
    }
}

fn load() -> Result<(Arc<Api>, String)> {
    let mut reason = None;
    for file in candidates(&|name| std::env::var_os(name)) {
        let loaded = Api::load(&file).and_then(|api| {
            let version = api.version()?;
            let words = format!(
                "librealsense {}.{}.{}",
                version / 10000,
                version / 100 % 100,
                version % 100
            );
            if version < OLDEST {
                return Err(words);
            }
            Ok((api, words))
        });
        match loaded {
            Ok(found) => return Ok(found),
            Err(found) => {
                reason = reason.or(Some(RealSenseError::Unusable {
                    library: file,
                    found,
                }));
            }
        }
    }
    Err(reason.unwrap_or_else(|| RealSenseError::Library {
        found: "none in ROS's and the system's folders".to_owned(),
    }))
}

fn wanted(api: &Api, options: &Options) -> Result<Wanted> {
    let words = |text: &str| CString::new(text).unwrap_or_default();
    if let Some(file) = &options.playback {
        return Ok(Wanted {
            file: Some(words(&file.to_string_lossy())),
            ..Wanted::default()
        });
    }
    let connected = api.devices().unwrap_or_default();
    let list = |all: &[Connected]| {
        let one = |c: &Connected| format!("{} {}", c.name, c.serial);
        all.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let chosen = match (&options.serial, connected.as_slice()) {
        (Some(serial), all) => all.iter().find(|c| c.serial == *serial),
        (None, [one]) => Some(one),
        (None, _) => None,
    };
    let Some(chosen) = chosen else {
        return Err(RealSenseError::Device {
            expected: options.serial.as_ref().map_or_else(
                || "one RealSense camera".to_owned(),
                |serial| format!("the RealSense camera {serial}"),
            ),
            found: if connected.is_empty() {
                "none connected".to_owned()
            } else {
                list(&connected)
            },
            advice: if connected.is_empty() {
                "connect it, and let this user have its USB device (librealsense's udev rules)"
            } else {
                "name one with --serial"
            },
        });
    };
    let side = |n: u32| i32::try_from(n).unwrap_or(i32::MAX);
    Ok(Wanted {
        serial: Some(words(&chosen.serial)),
        file: None,
        size: [side(options.size.0), side(options.size.1)],
        rate: side(options.rate),
        inertial: false,
    })
}

fn settings(options: &Options) -> Vec<Setting> {
    if options.playback.is_some() {
        return Vec::new();
    }
    // Otherwise frames would come at half their rate in the dark.
    let mut all = vec![Setting {
        sensor: "RGB",
        option: "Auto Exposure Priority",
        value: 0.0,
    }];
    all.extend(options.emitter.map(|on| Setting {
        sensor: "",
        option: "Emitter Enabled",
        value: if on { 1.0 } else { 0.0 },
    }));
    if let Some(ms) = options.exposure {
        all.push(Setting {
            sensor: "RGB",
            option: "Enable Auto Exposure",
            value: 0.0,
        });
        // USB cameras count tenths of milliseconds.
        all.push(Setting {
            sensor: "RGB",
            option: "Exposure",
            value: (ms * 10.0).round() as f32,
        });
    }
    all
}

/// Description of the cameras from the first pair of images.
fn first(running: &Running) -> std::result::Result<(Images, Description), String> {
    let until = Instant::now() + Duration::from_millis(FIRST_WAIT.into());
    let mut left = 10;
    while left > 0 && Instant::now() < until {
        match running.next(FIRST_WAIT, true)? {
            News::Images(mut images) => {
                if let Some(description) = images.description.take() {
                    return Ok((*images, description));
                }
                left -= 1;
            }
            News::Motion(_) => {}
            News::Nothing => left -= 1,
        }
    }
    Err("images of one camera only".to_owned())
}

/// Starts it with its inertial sensor, if it has one.
fn start(
    api: &Arc<Api>,
    wanted: Wanted,
    settings: &[Setting],
    inertial: bool,
) -> std::result::Result<Started, String> {
    if inertial {
        let with = Wanted {
            inertial: true,
            ..wanted.clone()
        };
        let started = Started::start(Arc::clone(api), with, settings.to_vec());
        if started.is_ok() {
            return started;
        }
    }
    Started::start(Arc::clone(api), wanted, settings.to_vec())
}
