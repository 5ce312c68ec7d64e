"""Writes golden files of the crate ros-messages: messages serialised and definitions printed by PyPI `rosbags` 0.11.9.
usage: ros_messages.py FOLDER      pip install rosbags numpy
messages.txt    type, format, bytes in hexadecimal: the messages of tests/golden.rs
filled.txt      likewise for every type, filled with counting numbers and letters
definitions.txt per type: version, name, MD5 sum of ROS 1, then the definition without its constants"""
import sys
from pathlib import Path

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

COVARIANCE = "float64[36] covariance"
# vision_msgs 4 (branch ros2), which rosbags lacks.
VISION = {
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\nstring id",
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
}
# Halves of services, from their definitions in rcl_interfaces and std_srvs.
SERVICES = {
    "rcl_interfaces/srv/GetParameters_Request": "string[] names",
    "rcl_interfaces/srv/GetParameters_Response": "rcl_interfaces/ParameterValue[] values",
    "rcl_interfaces/srv/GetParameterTypes_Request": "string[] names",
    "rcl_interfaces/srv/GetParameterTypes_Response": "uint8[] types",
    "rcl_interfaces/srv/SetParameters_Request": "rcl_interfaces/Parameter[] parameters",
    "rcl_interfaces/srv/SetParameters_Response": "rcl_interfaces/SetParametersResult[] results",
    "rcl_interfaces/srv/SetParametersAtomically_Request": "rcl_interfaces/Parameter[] parameters",
    "rcl_interfaces/srv/SetParametersAtomically_Response": "rcl_interfaces/SetParametersResult result",
    "rcl_interfaces/srv/DescribeParameters_Request": "string[] names",
    "rcl_interfaces/srv/DescribeParameters_Response": "rcl_interfaces/ParameterDescriptor[] descriptors",
    "rcl_interfaces/srv/ListParameters_Request": "string[] prefixes\nuint64 depth",
    "rcl_interfaces/srv/ListParameters_Response": "rcl_interfaces/ListParametersResult result",
    "std_srvs/srv/Empty_Request": "uint8 structure_needs_at_least_one_member",
    "std_srvs/srv/Trigger_Response": "bool success\nstring message",
    "std_srvs/srv/SetBool_Request": "bool data",
    "std_srvs/srv/SetBool_Response": "bool success\nstring message",
}
BOTH = """sensor_msgs/msg/Image sensor_msgs/msg/CompressedImage sensor_msgs/msg/CameraInfo sensor_msgs/msg/Imu sensor_msgs/msg/PointCloud2 std_msgs/msg/String
tf2_msgs/msg/TFMessage geometry_msgs/msg/PoseStamped geometry_msgs/msg/TransformStamped nav_msgs/msg/Path nav_msgs/msg/Odometry nav_msgs/msg/OccupancyGrid
visualization_msgs/msg/MarkerArray diagnostic_msgs/msg/DiagnosticArray""".split()
ROS1 = ["rosgraph_msgs/msg/Log"]
ROS2 = ["rcl_interfaces/msg/Log", "rcl_interfaces/msg/ParameterEvent", "vision_msgs/msg/Detection3DArray", *SERVICES]


def messages(store, ros1):
    t = store.types
    time = t["builtin_interfaces/msg/Time"](sec=1305031102, nanosec=175304000)
    header = lambda f: t["std_msgs/msg/Header"](stamp=time, frame_id=f, **({"seq": 7} if ros1 else {}))
    u = (lambda s: s.upper()) if ros1 else (lambda s: s)
    v = lambda x, y, z: t["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)
    q = t["geometry_msgs/msg/Quaternion"](x=0.5, y=-0.5, z=0.5, w=-0.5)
    yield t["sensor_msgs/msg/Image"](header("cam"), 1, 2, "rgb8", 0, 6, np.arange(1, 7, dtype=np.uint8))
    yield t["sensor_msgs/msg/CompressedImage"](header("camera"), "16UC1; compressedDepth png", np.array([9, 8, 7], np.uint8))
    roi = t["sensor_msgs/msg/RegionOfInterest"](x_offset=1, y_offset=2, height=3, width=4, do_rectify=True)
    k = np.array([517.3, 0, 318.6, 0, 516.5, 255.3, 0, 0, 1])
    p = np.array([517.3, 0, 318.6, 0.25, 0, 516.5, 255.3, 0, 0, 0, 1, 0])
    yield t["sensor_msgs/msg/CameraInfo"](header=header("camera_"), height=480, width=640, distortion_model="plumb_bob", binning_x=1, binning_y=2, roi=roi,
        **{u("d"): np.array([0.25, -0.5, 0.125]), u("k"): k, u("r"): np.eye(3).ravel(), u("p"): p})
    yield t["sensor_msgs/msg/Imu"](header("imu"), q, np.arange(9.0), v(1.0, 2.0, 3.0), np.arange(9.0) + 9, v(4.0, 5.0, 6.0), np.arange(9.0) + 18)
    transform = t["geometry_msgs/msg/Transform"](v(0.1, 0.2, 0.3), q)
    tree = [t["geometry_msgs/msg/TransformStamped"](header("map"), child, transform) for child in ("a", "base_link")]
    transforms = t["tf2_msgs/msg/TFMessage"](tree)
    yield transforms
    pose = t["geometry_msgs/msg/Pose"](t["geometry_msgs/msg/Point"](0.1, 0.2, 0.3), q)
    yield t["nav_msgs/msg/Path"](header("map"), [t["geometry_msgs/msg/PoseStamped"](header(f), pose) for f in ("", "odom")])
    yield t["std_msgs/msg/String"]("k=v;")


class Fill:
    """Gives every leaf a distinct value, and every sequence two elements."""

    def __init__(self, store):
        self.store, self.n = store, 0

    def leaf(self, kind):
        self.n += 1
        if kind == "string":
            return "abcdefgh"[: self.n % 9] + str(self.n)
        if kind == "bool":
            return self.n % 3 != 0
        return self.n + 0.5 if kind.startswith("float") else self.n % 100

    def value(self, desc):
        kind, what = desc
        if kind == Nodetype.BASE:
            return self.leaf(what[0])
        if kind == Nodetype.NAME:
            return self.message(what)
        inner, limit = what
        length = limit if kind == Nodetype.ARRAY else min(2, limit or 2)
        values = [self.value(inner) for _ in range(length)]
        if inner[0] == Nodetype.BASE and inner[1][0] != "string":
            name = {"byte": "uint8", "octet": "uint8", "char": "uint8"}.get(inner[1][0], inner[1][0])
            return np.array(values, name)
        return values

    def message(self, name):
        fields = self.store.fielddefs[name][1]
        return self.store.types[name](**{f: self.value(d) for f, d in fields})


def without_constants(text):
    return "".join(line + "\n" for line in text.splitlines() if line.startswith("=====") or "=" not in line.replace("<=", "") )


def main(folder):
    two, one = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
    # Missing in the Noetic types of rosbags.
    one.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    for name, text in VISION.items():
        two.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    for name, text in SERVICES.items():
        (fields,) = get_types_from_msg(text, name).values()
        two.register({name: fields})
    lines, filled, definitions = [], [], []
    for store, ros1 in ((two, False), (one, True)):
        def add(to, m, name):
            if ros1:
                to.append(f"{name} ros1 {bytes(store.serialize_ros1(m, m.__msgtype__)).hex()}")
            else:
                for form, little in (("cdr_le", True), ("cdr_be", False)):
                    to.append(f"{name} {form} {bytes(store.serialize_cdr(m, m.__msgtype__, little_endian=little)).hex()}")

        for m in messages(store, ros1):
            add(lines, m, m.__msgtype__.split("/")[-1])
        for name in BOTH + (ROS1 if ros1 else ROS2):
            add(filled, Fill(store).message(name), name)
            text, md5 = store.generate_msgdef(name, ros_version=1 if ros1 else 2)
            known = name.replace("/msg/", "/") if ros1 else name
            definitions.append(f"#### {'ros1' if ros1 else 'ros2'} {known} {md5 if ros1 else '-'}\n{without_constants(text)}")
    Path(folder, "messages.txt").write_text("\n".join(lines) + "\n")
    Path(folder, "filled.txt").write_text("\n".join(filled) + "\n")
    Path(folder, "definitions.txt").write_text("".join(definitions))


main(sys.argv[1])
