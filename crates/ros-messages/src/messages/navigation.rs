//! Poses, paths and maps of a robot.

use super::{
    ColorRgba, CompressedImage, Duration, Header, Point, Pose, PoseStamped, PoseWithCovariance,
    Time, TwistWithCovariance, Vector3,
};
use std::borrow::Cow;

messages! {
    Path<'a> "nav_msgs/msg/Path" "6227e2b7e9cce15051f669a5e197bbf7" { header: Header<'a>, poses: Vec<PoseStamped<'a>>, }
    Odometry<'a> "nav_msgs/msg/Odometry" "cd5e73d190d741a2f92e81eda573aca7" {
        header: Header<'a>,
        child_frame_id: Cow<'a, str>,
        pose: PoseWithCovariance,
        twist: TwistWithCovariance,
    }
    MapMetaData "nav_msgs/msg/MapMetaData" {
        map_load_time: Time,
        resolution: f32,
        width: u32,
        height: u32,
        origin: Pose,
    }
    /// Occupancy in percent, row by row from the origin; -1 is unknown.
    OccupancyGrid<'a> "nav_msgs/msg/OccupancyGrid" "3381f2d731d4076ec5c71b0759edbe4e" {
        header: Header<'a>,
        info: MapMetaData,
        data: Vec<i8>,
    }
    UvCoordinate "visualization_msgs/msg/UVCoordinate" { u: f32, v: f32, }
    MeshFile<'a> "visualization_msgs/msg/MeshFile" { filename: Cow<'a, str>, data: Cow<'a, [u8]>, }
    Marker<'a> "visualization_msgs/msg/Marker" {
        header: Header<'a>,
        ns: Cow<'a, str>,
        id: i32,
        r#type: i32,
        action: i32,
        pose: Pose,
        scale: Vector3,
        color: ColorRgba,
        lifetime: Duration,
        frame_locked: bool,
        points: Vec<Point>,
        colors: Vec<ColorRgba>,
        [ros2] texture_resource: Cow<'a, str>,
        [ros2] texture: CompressedImage<'a>,
        [ros2] uv_coordinates: Vec<UvCoordinate>,
        text: Cow<'a, str>,
        mesh_resource: Cow<'a, str>,
        [ros2] mesh_file: MeshFile<'a>,
        mesh_use_embedded_materials: bool,
    }
    MarkerArray<'a> "visualization_msgs/msg/MarkerArray" "d155b9ce5188fbaf89745847fd5882d7" { markers: Vec<Marker<'a>>, }
    ObjectHypothesis<'a> "vision_msgs/msg/ObjectHypothesis" { class_id: Cow<'a, str>, score: f64, }
    ObjectHypothesisWithPose<'a> "vision_msgs/msg/ObjectHypothesisWithPose" {
        hypothesis: ObjectHypothesis<'a>,
        pose: PoseWithCovariance,
    }
    BoundingBox3D "vision_msgs/msg/BoundingBox3D" { center: Pose, size: Vector3, }
    /// Of vision_msgs 4, ROS 2 only.
    Detection3D<'a> "vision_msgs/msg/Detection3D" {
        header: Header<'a>,
        results: Vec<ObjectHypothesisWithPose<'a>>,
        bbox: BoundingBox3D,
        id: Cow<'a, str>,
    }
    /// Of vision_msgs 4, ROS 2 only.
    Detection3DArray<'a> "vision_msgs/msg/Detection3DArray" { header: Header<'a>, detections: Vec<Detection3D<'a>>, }
}
