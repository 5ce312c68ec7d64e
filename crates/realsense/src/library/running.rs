//! A running device: its options and its images.

use super::functions::{Extrinsics, Fault, Intrinsics, Object};
use super::{
    ACCEL, Api, COLOUR, Connected, DEPTH, Description, GYRO, Handle, Image, Images, MOST_OPTIONS,
    MOTION_FRAME, Motion, NAME, News, STOPPED, Setting, text,
};
use std::ffi::c_int;
use std::sync::Arc;

/// A running device. Fields are dropped in order: the pipeline before the queue that it fills.
pub(crate) struct Running {
    pub(super) api: Arc<Api>,
    pub(super) is_file: bool,
    pub(super) device: Option<Handle>,
    pub(super) profile: Handle,
    pub(super) pipeline: Handle,
    pub(super) queue: Handle,
    pub(super) _config: Handle,
    pub(super) _context: Handle,
}

impl Drop for Running {
    fn drop(&mut self) {
        // SAFETY: the pipeline runs, and is dropped after this. Stopping an unplugged device fails, which is harmless.
        let _ = self
            .api
            .call(|e| unsafe { (self.api.functions.pipeline_stop)(self.pipeline.get(), e) });
    }
}

impl Running {
    pub(crate) fn connected(&self) -> Connected {
        let device = self.device.as_ref().map(|d| self.api.connected(d));
        device.unwrap_or(Connected {
            name: String::new(),
            serial: String::new(),
        })
    }

    pub(crate) fn has_ended(&self) -> bool {
        let f = &self.api.functions;
        let Some(device) = self.device.as_ref().filter(|_| self.is_file) else {
            return false;
        };
        // SAFETY: the device of a file is one for playback.
        let status = self
            .api
            .call(|e| unsafe { (f.playback_device_get_current_status)(device.get(), e) });
        status == Ok(STOPPED)
    }

    /// Sets an option if a sensor has it; returns whether one has.
    ///
    /// # Errors
    /// The range, if the value is outside; errors of the device.
    pub(crate) fn set(&self, setting: &Setting) -> Result<bool, String> {
        let f = &self.api.functions;
        let Some(device) = &self.device else {
            return Ok(false);
        };
        // SAFETY: takes any number.
        let named = |i: &c_int| text(unsafe { (f.option_to_string)(*i) }) == setting.option;
        let Some(option) = (0..MOST_OPTIONS).find(named) else {
            return Ok(false);
        };
        let mut is_set = false;
        // SAFETY: sensors of this device, within the list's stated number; a sensor has options.
        unsafe {
            let list = self
                .api
                .make(f.delete_sensor_list, |e| (f.query_sensors)(device.get(), e))?;
            for i in 0..self.api.call(|e| (f.get_sensors_count)(list.get(), e))? {
                let sensor = self
                    .api
                    .make(f.delete_sensor, |e| (f.create_sensor)(list.get(), i, e))?;
                let name = self
                    .api
                    .call(|e| (f.get_sensor_info)(sensor.get(), NAME, e));
                let name = name.map(text).unwrap_or_default();
                let has = self
                    .api
                    .call(|e| (f.supports_option)(sensor.get(), option, e));
                if !name.contains(setting.sensor) || has != Ok(1) {
                    continue;
                }
                let (mut low, mut high, mut step, mut usual) = (0.0, 0.0, 0.0, 0.0);
                self.api.call(|e| {
                    (f.get_option_range)(
                        sensor.get(),
                        option,
                        &mut low,
                        &mut high,
                        &mut step,
                        &mut usual,
                        e,
                    );
                })?;
                if !(low..=high).contains(&setting.value) {
                    return Err(format!(
                        "{} of {name}: expected {low} to {high}, found {}",
                        setting.option, setting.value
                    ));
                }
                self.api
                    .call(|e| (f.set_option)(sensor.get(), option, setting.value, e))?;
                is_set = true;
            }
        }
        Ok(is_set)
    }

    /// Waits for a pair of images or a sample of the inertial sensor.
    ///
    /// # Errors
    /// None came in time, or an error of the device.
    pub(crate) fn next(&self, wait_ms: u32, describe: bool) -> Result<News, String> {
        let f = &self.api.functions;
        // SAFETY: frames are released by their handles; profiles live as long as their frames.
        unsafe {
            let all = self.api.make(f.release_frame, |e| {
                (f.wait_for_frame)(self.queue.get(), wait_ms, e)
            })?;
            let is_motion = self
                .api
                .call(|e| (f.is_frame_extendable_to)(all.get(), MOTION_FRAME, e))?;
            if is_motion != 0 {
                let stream = self.stream(self.profile(&all)?)?;
                return Ok(self
                    .motion(&all, stream)?
                    .map_or(News::Nothing, News::Motion));
            }
            let count = self.api.call(|e| (f.embedded_frames_count)(all.get(), e))?;
            let (mut colour, mut depth) = (None, None);
            for i in 0..count {
                let frame = self
                    .api
                    .make(f.release_frame, |e| (f.extract_frame)(all.get(), i, e))?;
                let profile = self.profile(&frame)?;
                match self.stream(profile)? {
                    COLOUR => colour = Some((frame, profile)),
                    DEPTH => depth = Some((frame, profile)),
                    _ => {}
                }
            }
            let (Some((colour, colour_profile)), Some((depth, depth_profile))) = (colour, depth)
            else {
                return Ok(News::Nothing);
            };
            let description = if describe {
                Some(Description {
                    colour: self.intrinsics(colour_profile)?,
                    depth: self.intrinsics(depth_profile)?,
                    colour_from_depth: self.pose(depth_profile, colour_profile)?,
                    colour_from_gyro: self.gyro_pose(colour_profile)?,
                    unit: f64::from(
                        self.api
                            .call(|e| (f.depth_frame_get_units)(depth.get(), e))?,
                    ),
                })
            } else {
                None
            };
            Ok(News::Images(Box::new(Images {
                colour: self.image(&colour)?,
                depth: self.image(&depth)?,
                description,
            })))
        }
    }

    /// The profile of a frame; it lives as long as the frame.
    fn profile(&self, frame: &Handle) -> Result<Object, String> {
        // SAFETY: the frame is alive.
        self.api
            .call(|e| unsafe { (self.api.functions.get_frame_stream_profile)(frame.get(), e) })
    }

    /// The stream kind of a live profile.
    fn stream(&self, profile: Object) -> Result<c_int, String> {
        let (mut stream, mut format, mut index, mut number, mut rate) = (0, 0, 0, 0, 0);
        // SAFETY: the callers' profiles are those of frames or of a device that are alive.
        self.api.call(|e| unsafe {
            (self.api.functions.get_stream_profile_data)(
                profile,
                &mut stream,
                &mut format,
                &mut index,
                &mut number,
                &mut rate,
                e,
            );
        })?;
        Ok(stream)
    }

    fn pose(&self, of: Object, to: Object) -> Result<Extrinsics, String> {
        let mut pose = Extrinsics::default();
        // SAFETY: as for `stream`.
        self.api
            .call(|e| unsafe { (self.api.functions.get_extrinsics)(of, to, &mut pose, e) })?;
        Ok(pose)
    }

    /// Pose of the gyroscope relative to the colour camera, or the reason why it is unknown; `None` without a gyroscope.
    fn gyro_pose(
        &self,
        colour_profile: Object,
    ) -> Result<Option<Result<Extrinsics, String>>, String> {
        let f = &self.api.functions;
        // SAFETY: the pipeline's profile is alive, and with it its list and the list's profiles.
        unsafe {
            let list = self.api.make(f.delete_stream_profiles_list, |e| {
                (f.pipeline_profile_get_streams)(self.profile.get(), e)
            })?;
            for i in 0..self
                .api
                .call(|e| (f.get_stream_profiles_count)(list.get(), e))?
            {
                let profile = self
                    .api
                    .call(|e| (f.get_stream_profile)(list.get(), i, e))?;
                if self.stream(profile)? == GYRO {
                    return Ok(Some(self.pose(profile, colour_profile)));
                }
            }
        }
        Ok(None)
    }

    /// A sample of the gyroscope or the accelerometer; `None` for other frames.
    fn motion(&self, frame: &Handle, stream: c_int) -> Result<Option<Motion>, String> {
        let f = &self.api.functions;
        // SAFETY: the frame is alive, and its data has the stated size.
        unsafe {
            let size = self.api.call(|e| (f.get_frame_data_size)(frame.get(), e))?;
            let data = self.api.call(|e| (f.get_frame_data)(frame.get(), e))?;
            if data.is_null() || size < 12 || !matches!(stream, GYRO | ACCEL) {
                return Ok(None);
            }
            Ok(Some(Motion {
                is_rate: stream == GYRO,
                stamp_us: self.stamp_us(frame)?,
                value: data.cast::<[f32; 3]>().read_unaligned(),
            }))
        }
    }

    fn stamp_us(&self, frame: &Handle) -> Result<i64, String> {
        // SAFETY: the frame is alive.
        let ms = self
            .api
            .call(|e| unsafe { (self.api.functions.get_frame_timestamp)(frame.get(), e) })?;
        Ok((ms * 1e3).round() as i64)
    }

    fn intrinsics(&self, profile: Object) -> Result<(Intrinsics, String), String> {
        let f = &self.api.functions;
        let mut found = Intrinsics::default();
        // SAFETY: the profile of a video stream whose frame is alive.
        unsafe {
            self.api
                .call(|e| (f.get_video_stream_intrinsics)(profile, &mut found, e))?;
            Ok((found, text((f.distortion_to_string)(found.model))))
        }
    }

    fn image(&self, frame: &Handle) -> Result<Image, String> {
        let f = &self.api.functions;
        // SAFETY: the frame is alive, and its data has the stated size.
        unsafe {
            let number = |get: unsafe extern "C" fn(Object, Fault) -> c_int| {
                let found = self.api.call(|e| get(frame.get(), e))?;
                u32::try_from(found).map_err(|_| format!("an image with a size of {found}"))
            };
            let size = number(f.get_frame_data_size)? as usize;
            let data = self
                .api
                .call(|e| (f.get_frame_data)(frame.get(), e))?
                .cast::<u8>();
            if data.is_null() {
                return Err("an image without data".to_owned());
            }
            Ok(Image {
                width: number(f.get_frame_width)?,
                height: number(f.get_frame_height)?,
                stride: number(f.get_frame_stride_in_bytes)?,
                data: std::slice::from_raw_parts(data, size).to_vec(),
                stamp_us: self.stamp_us(frame)?,
            })
        }
    }
}
