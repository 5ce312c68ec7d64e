//! Frames as an MCAP file that the tools of ROS 2 open.

use crate::error::Result;
use crate::messages::{MessageFile, TopicInfo};
use std::path::Path;
use stillpoint_datasets::StampedPose;
use stillpoint_geometry::{Camera, ImuModel};
use stillpoint_imaging::{ImuSample, RgbdFrame};
use stillpoint_ros_messages as ros;

/// Topics of the files, named as the drivers of RealSense name theirs.
const COLOUR: &str = "/camera/color/image_raw";
const COLOUR_INFO: &str = "/camera/color/camera_info";
const DEPTH: &str = "/camera/aligned_depth_to_color/image_raw";
const DEPTH_INFO: &str = "/camera/aligned_depth_to_color/camera_info";
const IMU: &str = "/camera/imu";
const IMU_FRAME: &str = "camera_imu_optical_frame";
/// Ground truth, as `--truth-topic` takes it.
pub const TRUTH_TOPIC: &str = "/ground_truth/pose";
const FRAME: &str = "camera_color_optical_frame";

/// Writes frames. The file has its name only when [`McapRecorder::finish`] has come to its end.
#[derive(Debug)]
pub struct McapRecorder {
    file: MessageFile,
    camera: Camera,
    /// What is added to the stamps of inertial samples, s.
    imu_offset: f64,
}

impl McapRecorder {
    /// Begins a file at a path where nothing is.
    ///
    /// # Errors
    /// Something is there, or cannot be written.
    pub fn create(path: &Path, camera: &Camera) -> Result<Self> {
        Ok(Self::into_file(MessageFile::create(path)?, camera))
    }

    /// Writes frames into a file that may have other messages too.
    #[must_use]
    pub fn into_file(file: MessageFile, camera: &Camera) -> Self {
        Self {
            file,
            camera: *camera,
            imu_offset: 0.0,
        }
    }

    /// The file, for other messages.
    pub fn file(&mut self) -> &mut MessageFile {
        &mut self.file
    }

    /// Writes a frame: colour as it is (grey where there is none), depth as metres, both with their stamps and the camera.
    ///
    /// # Errors
    /// The system's reason.
    pub fn add(&mut self, frame: &RgbdFrame) -> Result<()> {
        let (time, depth_time) = (nanoseconds(frame.stamp), nanoseconds(frame.depth_stamp));
        let (encoding, bytes, data) = match &frame.colour {
            Some(colour) => ("rgb8", 3, colour.data()),
            None => ("mono8", 1, frame.gray.data()),
        };
        let width = frame.gray.width() as u32;
        let colour = ros::Image {
            header: header(time),
            height: frame.gray.height() as u32,
            width,
            encoding: encoding.into(),
            is_bigendian: 0,
            step: bytes * width,
            data: data.into(),
        };
        self.file.write_value(COLOUR, time, &colour)?;
        self.file
            .write_value(COLOUR_INFO, time, &info(&self.camera, time))?;
        let metres: Vec<u8> = frame
            .depth
            .data()
            .iter()
            .flat_map(|z| z.to_le_bytes())
            .collect();
        let width = frame.depth.width() as u32;
        let depth = ros::Image {
            header: header(depth_time),
            height: frame.depth.height() as u32,
            width,
            encoding: "32FC1".into(),
            is_bigendian: 0,
            step: 4 * width,
            data: metres.into(),
        };
        self.file.write_value(DEPTH, time, &depth)?;
        self.file
            .write_value(DEPTH_INFO, time, &info(&self.camera, depth_time))?;
        Ok(())
    }

    /// Writes how an inertial sensor is mounted, as a transform that stands still; its noise has no message.
    ///
    /// # Errors
    /// The system's reason.
    pub fn add_imu(&mut self, model: &ImuModel, stamp: f64) -> Result<()> {
        self.imu_offset = model.time_offset;
        let time = nanoseconds(stamp);
        let (t, q) = (
            model.camera_from_imu.translation,
            model.camera_from_imu.rotation,
        );
        let mount = ros::TransformStamped {
            header: header(time),
            child_frame_id: IMU_FRAME.into(),
            transform: ros::Transform {
                translation: ros::Vector3 {
                    x: t.x,
                    y: t.y,
                    z: t.z,
                },
                rotation: ros::Quaternion {
                    x: q.i,
                    y: q.j,
                    z: q.k,
                    w: q.w,
                },
            },
        };
        let message = ros::TfMessage {
            transforms: vec![mount],
        };
        let topic = TopicInfo {
            name: "/tf_static",
            type_name: <ros::TfMessage<'_> as ros::Message>::NAME,
            definition: || ros::definition::<ros::TfMessage<'_>>(ros::Version::Ros2),
            is_latched: true,
        };
        let cdr = ros::to_bytes(&message, ros::Format::CdrLittleEndian);
        self.file.write(topic, time, &cdr)
    }

    /// Writes samples of the inertial sensor, with stamps on the camera's clock once [`Self::add_imu`] has said how they differ.
    ///
    /// # Errors
    /// The system's reason.
    pub fn add_inertial(&mut self, samples: &[ImuSample]) -> Result<()> {
        for sample in samples {
            let time = nanoseconds(sample.stamp + self.imu_offset);
            let vector = |[x, y, z]: [f64; 3]| ros::Vector3 { x, y, z };
            // Begins with -1 where there is no such value: it has no orientation (`sensor_msgs/Imu`).
            let mut none = [0.0; 9];
            none[0] = -1.0;
            let message = ros::Imu {
                header: ros::Header {
                    frame_id: IMU_FRAME.into(),
                    ..header(time)
                },
                orientation: ros::Quaternion {
                    w: 1.0,
                    ..ros::Quaternion::default()
                },
                orientation_covariance: none,
                angular_velocity: vector(sample.angular_rate),
                linear_acceleration: vector(sample.specific_force),
                ..ros::Imu::default()
            };
            self.file.write_value(IMU, time, &message)?;
        }
        Ok(())
    }

    /// Writes a pose of ground truth, `world_from_camera`.
    ///
    /// # Errors
    /// The system's reason.
    pub fn add_truth(&mut self, pose: &StampedPose) -> Result<()> {
        let time = nanoseconds(pose.stamp);
        let (t, q) = (
            pose.world_from_camera.translation,
            pose.world_from_camera.rotation,
        );
        let message = ros::PoseStamped {
            header: ros::Header {
                frame_id: "world".into(),
                ..header(time)
            },
            pose: ros::Pose {
                position: ros::Point {
                    x: t.x,
                    y: t.y,
                    z: t.z,
                },
                orientation: ros::Quaternion {
                    x: q.i,
                    y: q.j,
                    z: q.k,
                    w: q.w,
                },
            },
        };
        self.file.write_value(TRUTH_TOPIC, time, &message)
    }

    /// Writes indexes and summary, and gives the file its name.
    ///
    /// # Errors
    /// The system's reason.
    pub fn finish(self) -> Result<()> {
        self.file.finish()
    }
}

/// The stamps of data sets have microseconds; what a number of seconds has beyond is rounding.
fn nanoseconds(stamp: f64) -> u64 {
    let micro = (stamp * 1e6).round();
    if micro > 0.0 {
        (micro as u64).saturating_mul(1000)
    } else {
        0
    }
}

fn header(time: u64) -> ros::Header<'static> {
    ros::Header {
        seq: 0,
        stamp: ros::Time {
            sec: (time / 1_000_000_000) as i64,
            nanosec: (time % 1_000_000_000) as u32,
        },
        frame_id: FRAME.into(),
    }
}

fn info(camera: &Camera, time: u64) -> ros::CameraInfo<'static> {
    let (c, d) = (camera, &camera.distortion);
    ros::CameraInfo {
        header: header(time),
        height: c.height,
        width: c.width,
        distortion_model: "plumb_bob".into(),
        d: vec![d.k1, d.k2, d.p1, d.p2, d.k3],
        k: [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [
            c.fx, 0.0, c.cx, 0.0, 0.0, c.fy, c.cy, 0.0, 0.0, 0.0, 1.0, 0.0,
        ],
        ..ros::CameraInfo::default()
    }
}
