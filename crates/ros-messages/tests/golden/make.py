"""Writes messages.txt: messages as PyPI `rosbags` 0.11.9 serialises them (pip install rosbags numpy; python make.py > messages.txt).
Each line: type, format, bytes in hexadecimal. The messages are those of tests/golden.rs."""
import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


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
    if ros1:  # not among the types that rosbags knows of Noetic
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    yield t["tf2_msgs/msg/TFMessage"](tree)
    pose = t["geometry_msgs/msg/Pose"](t["geometry_msgs/msg/Point"](0.1, 0.2, 0.3), q)
    yield t["nav_msgs/msg/Path"](header("map"), [t["geometry_msgs/msg/PoseStamped"](header(f), pose) for f in ("", "odom")])
    yield t["std_msgs/msg/String"]("k=v;")


for store, ros1 in ((get_typestore(Stores.ROS2_JAZZY), False), (get_typestore(Stores.ROS1_NOETIC), True)):
    for m in messages(store, ros1):
        name = m.__msgtype__.split("/")[-1]
        if ros1:
            print(name, "ros1", bytes(store.serialize_ros1(m, m.__msgtype__)).hex())
        else:
            for form, little in (("cdr_le", True), ("cdr_be", False)):
                print(name, form, bytes(store.serialize_cdr(m, m.__msgtype__, little_endian=little)).hex())
