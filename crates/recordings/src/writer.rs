//! Writes frames to an MCAP file that ROS 2 tools open.

use crate::error::Result;
use crate::messages::{MessageFile, TopicInfo};
use std::path::Path;
use stillpoint_datasets::StampedPose;
use stillpoint_geometry::{Camera, ImuModel, OdometryModel, Se3};
use stillpoint_imaging::{ImuSample, OdometrySample, RgbdFrame};
use stillpoint_ros_messages as ros;

/// Topics of the files, named as by RealSense drivers.
const COLOUR: &str = "/camera/color/image_raw";
const COLOUR_INFO: &str = "/camera/color/camera_info";
const DEPTH: &str = "/camera/aligned_depth_to_color/image_raw";
const DEPTH_INFO: &str = "/camera/aligned_depth_to_color/camera_info";
const IMU: &str = "/camera/imu";
const IMU_FRAME: &str = "camera_imu_optical_frame";
const ODOMETRY: &str = "/odom";
const ODOM_FRAME: &str = "odom";
const BASE_FRAME: &str = "base_link";
/// Ground truth topic, for `--truth-topic`.
pub const TRUTH_TOPIC: &str = "/ground_truth/pose";
const FRAME: &str = "camera_color_optical_frame";

/// Writes frames. The file gets its name only when [`McapRecorder::finish`] succeeds.
#[derive(Debug)]
pub struct McapRecorder {
    file: MessageFile,
    camera: Camera,
    /// Offsets added to the stamps of inertial and odometry samples, s.
    imu_offset: f64,
    odometry_offset: f64,
}

impl McapRecorder {
    /// Starts a new file.
    ///
    /// # Errors
    /// The path exists, or is not writable.
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
            odometry_offset: 0.0,
        }
    }

    /// The file, for other messages.
    pub fn file(&mut self) -> &mut MessageFile {
        &mut self.file
    }

    /// Writes a frame: colour unchanged (grey without colour), depth in metres, both with their stamps and the camera.
    ///
    /// # Errors
    /// A failed write.
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

    /// Writes the mounting of an inertial sensor as a static transform; its noise is not stored.
    ///
    /// # Errors
    /// A failed write.
    pub fn add_imu(&mut self, model: &ImuModel, stamp: f64) -> Result<()> {
        self.imu_offset = model.time_offset;
        self.add_mount([FRAME, IMU_FRAME], &model.camera_from_imu, stamp)
    }

    /// Writes the camera's pose on a base with odometry as a static transform; the error model of the wheels is not stored.
    ///
    /// # Errors
    /// A failed write.
    pub fn add_base(&mut self, model: &OdometryModel, stamp: f64) -> Result<()> {
        self.odometry_offset = model.time_offset;
        self.add_mount([BASE_FRAME, FRAME], &model.base_from_camera, stamp)
    }

    fn add_mount(
        &mut self,
        [parent, child]: [&'static str; 2],
        parent_from_child: &Se3,
        stamp: f64,
    ) -> Result<()> {
        let time = nanoseconds(stamp);
        let ros::Pose {
            position: p,
            orientation: rotation,
        } = pose(parent_from_child);
        let translation = ros::Vector3 {
            x: p.x,
            y: p.y,
            z: p.z,
        };
        let mount = ros::TransformStamped {
            header: ros::Header {
                frame_id: parent.into(),
                ..header(time)
            },
            child_frame_id: child.into(),
            transform: ros::Transform {
                translation,
                rotation,
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

    /// Writes odometry samples, with stamps on the camera's clock after [`Self::add_base`]. Returns their number: a file has no times
    /// before 0.
    ///
    /// # Errors
    /// A failed write.
    pub fn add_odometry(&mut self, samples: &[OdometrySample]) -> Result<usize> {
        let mut written = 0;
        for sample in samples {
            let Some(time) = time_in_file(sample.stamp + self.odometry_offset) else {
                continue;
            };
            let ([x, y, z], [i, j, k, w]) = (sample.position, sample.orientation);
            // Zeros mean unknown.
            let [place, turn] = sample.sigmas.unwrap_or_default().map(|s| s * s);
            let mut covariance = [0.0; 36];
            for (axis, variance) in [place, place, place, turn, turn, turn].iter().enumerate() {
                covariance[7 * axis] = *variance;
            }
            let pose = ros::PoseWithCovariance {
                pose: ros::Pose {
                    position: ros::Point { x, y, z },
                    orientation: ros::Quaternion {
                        x: i,
                        y: j,
                        z: k,
                        w,
                    },
                },
                covariance: ros::Covariance6(covariance),
            };
            let message = ros::Odometry {
                header: ros::Header {
                    frame_id: ODOM_FRAME.into(),
                    ..header(time)
                },
                child_frame_id: BASE_FRAME.into(),
                pose,
                ..ros::Odometry::default()
            };
            self.file.write_value(ODOMETRY, time, &message)?;
            written += 1;
        }
        Ok(written)
    }

    /// Writes inertial samples, with stamps on the camera's clock after [`Self::add_imu`].
    ///
    /// # Errors
    /// A failed write.
    pub fn add_inertial(&mut self, samples: &[ImuSample]) -> Result<()> {
        for sample in samples {
            let Some(time) = time_in_file(sample.stamp + self.imu_offset) else {
                continue;
            };
            let vector = |[x, y, z]: [f64; 3]| ros::Vector3 { x, y, z };
            // Begins with -1 to mark the missing orientation (`sensor_msgs/Imu`).
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

    /// Writes a ground truth pose, `world_from_camera`.
    ///
    /// # Errors
    /// A failed write.
    pub fn add_truth(&mut self, pose: &StampedPose) -> Result<()> {
        let time = nanoseconds(pose.stamp);
        let message = ros::PoseStamped {
            header: ros::Header {
                frame_id: "world".into(),
                ..header(time)
            },
            pose: self::pose(&pose.world_from_camera),
        };
        self.file.write_value(TRUTH_TOPIC, time, &message)
    }

    /// Writes indexes and summary, and gives the file its name.
    ///
    /// # Errors
    /// A failed write.
    pub fn finish(self) -> Result<()> {
        self.file.finish()
    }
}

/// Stamps of data sets have microseconds; further digits are rounding errors.
fn nanoseconds(stamp: f64) -> u64 {
    let micro = (stamp * 1e6).round();
    if micro > 0.0 {
        (micro as u64).saturating_mul(1000)
    } else {
        0
    }
}

fn time_in_file(stamp: f64) -> Option<u64> {
    (stamp >= 0.0).then(|| nanoseconds(stamp))
}

fn pose(pose: &Se3) -> ros::Pose {
    let (t, q) = (pose.translation, pose.rotation);
    ros::Pose {
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
    let (pinhole, lens) = ([c.fx, c.fy, c.cx, c.cy], [d.k1, d.k2, d.p1, d.p2, d.k3]);
    ros::CameraInfo::plumb_bob(header(time), [c.width, c.height], pinhole, lens)
}
