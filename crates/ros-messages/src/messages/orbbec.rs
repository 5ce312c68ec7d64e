//! Messages of Orbbec's SDK in its bags besides images: definitions of OrbbecSDK 2.

use super::Header;
use std::borrow::Cow;

messages! {
    /// Calibration of a stream. `rotation_matrix` (row by row) and `translation_matrix` (mm) map points of the depth camera into the colour
    /// camera, and are zero for other streams; `camera_intrinsic` is fx, fy, cx, cy in pixels, `camera_distortion` is k1 to k6, p1, p2.
    ObStreamProfileInfo<'a> "custom_msg/msg/OBStreamProfileInfo" {
        header: Header<'a>,
        stream_type / streamType: u8,
        format: u8,
        rotation_matrix / rotationMatrix: [f32; 9],
        translation_matrix / translationMatrix: [f32; 3],
        width: u16,
        height: u16,
        fps: u16,
        camera_intrinsic / cameraIntrinsic: [f32; 4],
        camera_distortion / cameraDistortion: [f32; 8],
        distortion_model / distortionModel: u8,
    }
    ObDeviceInfo<'a> "custom_msg/msg/OBDeviceInfo" {
        header: Header<'a>,
        name: Cow<'a, str>,
        full_name / fullName: Cow<'a, str>,
        asic_name / asicName: Cow<'a, str>,
        vid: u16,
        pid: u16,
        uid: Cow<'a, str>,
        sn: Cow<'a, str>,
    }
}
