//! The used functions of librealsense, and the structs that they fill.

use libloading::Library;
use std::ffi::{c_char, c_double, c_float, c_int, c_uint, c_void};

/// An object of the library.
pub(super) type Object = *mut c_void;
/// Error output of a function.
pub(super) type Fault = *mut Object;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Intrinsics {
    pub(crate) width: c_int,
    pub(crate) height: c_int,
    pub(crate) ppx: c_float,
    pub(crate) ppy: c_float,
    pub(crate) fx: c_float,
    pub(crate) fy: c_float,
    pub(super) model: c_int,
    pub(crate) coefficients: [c_float; 5],
}

/// `rs2_extrinsics`: the rotation column by column, and the translation, m.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Extrinsics {
    pub(crate) rotation: [c_float; 9],
    pub(crate) translation: [c_float; 3],
}

macro_rules! functions {
    ($($name:ident($($argument:ty),*) $(-> $returned:ty)?;)*) => {
        pub(super) struct Functions {
            $(pub(super) $name: unsafe extern "C" fn($($argument),*) $(-> $returned)?,)*
        }

        impl Functions {
            /// Looks up all of them; the error is the name of the first missing one.
            pub(super) fn find(library: &Library) -> Result<Self, String> {
                Ok(Self {
                    $($name: {
                        let name = concat!("rs2_", stringify!($name));
                        // SAFETY: the type is that of the function in the headers of version 2.
                        let found = unsafe { library.get(name.as_bytes()) };
                        *found.map_err(|_| name.to_owned())?
                    },)*
                })
            }
        }
    };
}

functions! {
    get_api_version(Fault) -> c_int;
    get_error_message(Object) -> *const c_char;
    free_error(Object);
    create_context(c_int, Fault) -> Object;
    delete_context(Object);
    query_devices(Object, Fault) -> Object;
    delete_device_list(Object);
    get_device_count(Object, Fault) -> c_int;
    create_device(Object, c_int, Fault) -> Object;
    delete_device(Object);
    supports_device_info(Object, c_int, Fault) -> c_int;
    get_device_info(Object, c_int, Fault) -> *const c_char;
    create_pipeline(Object, Fault) -> Object;
    delete_pipeline(Object);
    create_config(Fault) -> Object;
    delete_config(Object);
    config_enable_device(Object, *const c_char, Fault);
    config_enable_device_from_file_repeat_option(Object, *const c_char, c_int, Fault);
    config_enable_stream(Object, c_int, c_int, c_int, c_int, c_int, c_int, Fault);
    create_frame_queue(c_int, Fault) -> Object;
    delete_frame_queue(Object);
    enqueue_frame(Object, Object);
    wait_for_frame(Object, c_uint, Fault) -> Object;
    pipeline_start_with_config_and_callback(Object, Object, unsafe extern "C" fn(Object, Object), Object, Fault) -> Object;
    pipeline_stop(Object, Fault);
    pipeline_profile_get_device(Object, Fault) -> Object;
    pipeline_profile_get_streams(Object, Fault) -> Object;
    get_stream_profiles_count(Object, Fault) -> c_int;
    get_stream_profile(Object, c_int, Fault) -> Object;
    delete_stream_profiles_list(Object);
    delete_pipeline_profile(Object);
    playback_device_get_current_status(Object, Fault) -> c_int;
    query_sensors(Object, Fault) -> Object;
    delete_sensor_list(Object);
    get_sensors_count(Object, Fault) -> c_int;
    create_sensor(Object, c_int, Fault) -> Object;
    delete_sensor(Object);
    get_sensor_info(Object, c_int, Fault) -> *const c_char;
    option_to_string(c_int) -> *const c_char;
    supports_option(Object, c_int, Fault) -> c_int;
    get_option_range(Object, c_int, *mut c_float, *mut c_float, *mut c_float, *mut c_float, Fault);
    set_option(Object, c_int, c_float, Fault);
    distortion_to_string(c_int) -> *const c_char;
    is_frame_extendable_to(Object, c_int, Fault) -> c_int;
    embedded_frames_count(Object, Fault) -> c_int;
    extract_frame(Object, c_int, Fault) -> Object;
    release_frame(Object);
    get_frame_data(Object, Fault) -> *const c_void;
    get_frame_data_size(Object, Fault) -> c_int;
    get_frame_width(Object, Fault) -> c_int;
    get_frame_height(Object, Fault) -> c_int;
    get_frame_stride_in_bytes(Object, Fault) -> c_int;
    get_frame_timestamp(Object, Fault) -> c_double;
    get_frame_stream_profile(Object, Fault) -> Object;
    get_stream_profile_data(Object, *mut c_int, *mut c_int, *mut c_int, *mut c_int, *mut c_int, Fault);
    get_video_stream_intrinsics(Object, *mut Intrinsics, Fault);
    get_extrinsics(Object, Object, *mut Extrinsics, Fault);
    depth_frame_get_units(Object, Fault) -> c_float;
}
