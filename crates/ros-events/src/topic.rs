//! Topics, and outgoing messages.

use stillpoint_ros_messages as ros;
use stillpoint_ros_messages::{Format, Message, Version, Wire};

/// A topic of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Constant transforms.
    TfStatic,
    /// Changing transforms.
    Tf,
    /// Pose and velocity.
    Odometry,
    /// Keyframes.
    Path,
    /// Landmarks.
    Map,
    /// Objects.
    Objects,
    /// Markers of objects.
    Markers,
    /// The camera of the pictures.
    CameraInfo,
    /// Pictures.
    Image,
    /// An image of the moving regions.
    Mask,
    /// The drivable floor.
    Grid,
    /// The surface, as points.
    Surface,
    /// Health.
    Diagnostics,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::TfStatic,
        Self::Tf,
        Self::Odometry,
        Self::Path,
        Self::Map,
        Self::Objects,
        Self::Markers,
        Self::CameraInfo,
        Self::Image,
        Self::Mask,
        Self::Grid,
        Self::Surface,
        Self::Diagnostics,
    ];

    /// Its name: `/stillpoint/odometry`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TfStatic => "/tf_static",
            Self::Tf => "/tf",
            Self::Odometry => "/stillpoint/odometry",
            Self::Path => "/stillpoint/path",
            Self::Map => "/stillpoint/map",
            Self::Objects => "/stillpoint/objects",
            Self::Markers => "/stillpoint/objects/markers",
            Self::CameraInfo => "/stillpoint/camera_info",
            Self::Image => "/stillpoint/image/compressed",
            Self::Mask => "/stillpoint/mask",
            Self::Grid => "/stillpoint/grid",
            Self::Surface => "/stillpoint/surface",
            Self::Diagnostics => "/diagnostics",
        }
    }

    /// Type of its messages: `nav_msgs/msg/Odometry`.
    #[must_use]
    pub fn type_name(self) -> &'static str {
        match self {
            Self::TfStatic | Self::Tf => ros::TfMessage::NAME,
            Self::Odometry => ros::Odometry::NAME,
            Self::Path => ros::Path::NAME,
            Self::Map | Self::Surface => ros::PointCloud2::NAME,
            Self::Objects => ros::Detection3DArray::NAME,
            Self::Markers => ros::MarkerArray::NAME,
            Self::CameraInfo => ros::CameraInfo::NAME,
            Self::Image => ros::CompressedImage::NAME,
            Self::Mask => ros::Image::NAME,
            Self::Grid => ros::OccupancyGrid::NAME,
            Self::Diagnostics => ros::DiagnosticArray::NAME,
        }
    }

    /// Definition of that type in ROS 2, with nested ones.
    #[must_use]
    pub fn definition(self) -> String {
        let version = Version::Ros2;
        match self {
            Self::TfStatic | Self::Tf => ros::definition::<ros::TfMessage<'_>>(version),
            Self::Odometry => ros::definition::<ros::Odometry<'_>>(version),
            Self::Path => ros::definition::<ros::Path<'_>>(version),
            Self::Map | Self::Surface => ros::definition::<ros::PointCloud2<'_>>(version),
            Self::Objects => ros::definition::<ros::Detection3DArray<'_>>(version),
            Self::Markers => ros::definition::<ros::MarkerArray<'_>>(version),
            Self::CameraInfo => ros::definition::<ros::CameraInfo<'_>>(version),
            Self::Image => ros::definition::<ros::CompressedImage<'_>>(version),
            Self::Mask => ros::definition::<ros::Image<'_>>(version),
            Self::Grid => ros::definition::<ros::OccupancyGrid<'_>>(version),
            Self::Diagnostics => ros::definition::<ros::DiagnosticArray<'_>>(version),
        }
    }

    /// Whether late subscribers receive its last message too (durability *transient local*).
    #[must_use]
    pub fn is_latched(self) -> bool {
        matches!(
            self,
            Self::TfStatic | Self::Path | Self::Map | Self::Grid | Self::Surface
        )
    }
}

/// A message to be written or sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outgoing {
    /// Destination.
    pub topic: Topic,
    /// Its stamp, ns.
    pub time: u64,
    /// The message in little-endian CDR with its encapsulation header, as recorded and as sent.
    pub bytes: Vec<u8>,
}

impl Outgoing {
    pub(crate) fn new<'a, T: Message + Wire<'a>>(topic: Topic, time: u64, message: &T) -> Self {
        debug_assert_eq!(topic.type_name(), T::NAME);
        Self {
            topic,
            time,
            bytes: ros::to_bytes(message, Format::CdrLittleEndian),
        }
    }
}
