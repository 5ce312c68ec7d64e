//! Bytes written by another implementation: `tools/recordings/ros_messages.py`, with PyPI `rosbags` (0.11).

use std::fmt::Debug;

use stillpoint_ros_messages::*;

const STAMP: Time = Time {
    sec: 1_305_031_102,
    nanosec: 175_304_000,
};
const Q: Quaternion = Quaternion {
    x: 0.5,
    y: -0.5,
    z: 0.5,
    w: -0.5,
};
const P: Point = Point {
    x: 0.1,
    y: 0.2,
    z: 0.3,
};

/// Reads the other implementation's bytes, and writes the same bytes.
fn check<T: PartialEq + Debug>(
    name: &str,
    expected: impl Fn(u32) -> T,
    read: impl Fn(&[u8], Format, &T),
    write: impl Fn(&T, Format) -> Vec<u8>,
) {
    let mut seen = 0;
    for line in include_str!("golden/messages.txt").lines() {
        let words: Vec<&str> = line.split(' ').collect();
        if words[0] != name {
            continue;
        }
        let (format, seq) = match words[1] {
            "cdr_le" => (Format::CdrLittleEndian, 0),
            "cdr_be" => (Format::CdrBigEndian, 0),
            _ => (Format::Ros1, 7),
        };
        let hex = words[2].as_bytes().chunks(2);
        let byte = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap();
        let bytes: Vec<u8> = hex.map(byte).collect();
        let expected = expected(seq);
        read(&bytes, format, &expected);
        assert_eq!(write(&expected, format), bytes, "{name} {format:?}");
        seen += 1;
    }
    assert_eq!(seen, 3, "formats of {name}");
}

macro_rules! golden {
    ($test:ident, $name:literal, $type:ident, $expected:expr) => {
        #[test]
        fn $test() {
            let read = |bytes: &[u8], format, expected: &$type<'static>| {
                let found = from_bytes::<$type<'_>>(bytes, format).unwrap();
                assert_eq!(&found, expected, "{format:?}");
            };
            check($name, $expected, read, |m, format| to_bytes(m, format));
        }
    };
}

fn header(seq: u32, frame_id: &'static str) -> Header<'static> {
    Header {
        seq,
        stamp: STAMP,
        frame_id: frame_id.into(),
    }
}

golden!(image, "Image", Image, |seq| Image {
    header: header(seq, "cam"),
    height: 1,
    width: 2,
    encoding: "rgb8".into(),
    is_bigendian: 0,
    step: 6,
    data: vec![1, 2, 3, 4, 5, 6].into(),
});

golden!(
    compressed_image,
    "CompressedImage",
    CompressedImage,
    |seq| CompressedImage {
        header: header(seq, "camera"),
        format: "16UC1; compressedDepth png".into(),
        data: vec![9, 8, 7].into(),
    }
);

golden!(camera_info, "CameraInfo", CameraInfo, |seq| CameraInfo {
    header: header(seq, "camera_"),
    height: 480,
    width: 640,
    distortion_model: "plumb_bob".into(),
    d: vec![0.25, -0.5, 0.125],
    k: [517.3, 0., 318.6, 0., 516.5, 255.3, 0., 0., 1.],
    r: [1., 0., 0., 0., 1., 0., 0., 0., 1.],
    p: [517.3, 0., 318.6, 0.25, 0., 516.5, 255.3, 0., 0., 0., 1., 0.],
    binning_x: 1,
    binning_y: 2,
    roi: RegionOfInterest {
        x_offset: 1,
        y_offset: 2,
        height: 3,
        width: 4,
        do_rectify: true
    },
});

fn from(first: f64) -> [f64; 9] {
    std::array::from_fn(|i| first + i as f64)
}

golden!(imu, "Imu", Imu, |seq| Imu {
    header: header(seq, "imu"),
    orientation: Q,
    orientation_covariance: from(0.0),
    angular_velocity: Vector3 {
        x: 1.0,
        y: 2.0,
        z: 3.0
    },
    angular_velocity_covariance: from(9.0),
    linear_acceleration: Vector3 {
        x: 4.0,
        y: 5.0,
        z: 6.0
    },
    linear_acceleration_covariance: from(18.0),
});

golden!(tf, "TFMessage", TfMessage, |seq| TfMessage {
    transforms: ["a", "base_link"]
        .map(|child| TransformStamped {
            header: header(seq, "map"),
            child_frame_id: child.into(),
            transform: Transform {
                translation: Vector3 {
                    x: 0.1,
                    y: 0.2,
                    z: 0.3
                },
                rotation: Q
            },
        })
        .into(),
});

golden!(path, "Path", Path, |seq| Path {
    header: header(seq, "map"),
    poses: ["", "odom"]
        .map(|frame| PoseStamped {
            header: header(seq, frame),
            pose: Pose {
                position: P,
                orientation: Q
            },
        })
        .into(),
});

golden!(string, "String", StringMessage, |_| StringMessage {
    data: "k=v;".into()
});

/// Reads and rewrites the messages that `tools/recordings/ros_messages.py` filled with generated numbers and letters, and compares the
/// definitions.
macro_rules! repeated {
    ($($type:ident),* $(,)?) => {
        #[test]
        fn messages_of_every_type_round_trip() {
            let mut seen = 0;
            $(seen += repeated::<$type<'_>>(|bytes, format| {
                let message = from_bytes::<$type<'_>>(bytes, format).unwrap();
                to_bytes(&message, format)
            });)*
            assert_eq!(seen, include_str!("golden/filled.txt").lines().count());
        }
    };
}

fn repeated<T: Message>(again: impl Fn(&[u8], Format) -> Vec<u8>) -> usize {
    let mut seen = 0;
    for line in include_str!("golden/filled.txt").lines() {
        let words: Vec<&str> = line.split(' ').collect();
        if words[0] != T::NAME {
            continue;
        }
        let (format, version) = match words[1] {
            "cdr_le" => (Format::CdrLittleEndian, Version::Ros2),
            "cdr_be" => (Format::CdrBigEndian, Version::Ros2),
            _ => (Format::Ros1, Version::Ros1),
        };
        let bytes = unhex(words[2]);
        assert_eq!(again(&bytes, format), bytes, "{} {format:?}", T::NAME);
        let (name, sum, text) = described(&type_name::<T>(version), version);
        assert_eq!(type_name::<T>(version), name);
        if version == Version::Ros1 {
            assert_eq!(T::ROS1_MD5, sum, "{name}");
        }
        assert_eq!(definition::<T>(version), text, "{name}");
        seen += 1;
    }
    assert!(seen > 0, "{}", T::NAME);
    seen
}

/// Name, sum and definition, without constants, of the other implementation.
fn described(name: &str, version: Version) -> (String, String, String) {
    let all = include_str!("golden/definitions.txt");
    let ros = if version == Version::Ros1 {
        "ros1"
    } else {
        "ros2"
    };
    let entry = all.split("#### ").find_map(|entry| {
        let (head, text) = entry.split_once('\n')?;
        let words: Vec<&str> = head.split(' ').collect();
        (words[0] == ros && words[1] == name)
            .then(|| (name.to_owned(), words[2].to_owned(), text.to_owned()))
    });
    entry.unwrap_or_else(|| panic!("{ros} {name}"))
}

fn unhex(text: &str) -> Vec<u8> {
    let byte = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap();
    text.as_bytes().chunks(2).map(byte).collect()
}

/// Types without text have no lifetime; the macro gives one to all.
type EmptyHalf<'a> = EmptyRequest;
type SetBoolHalf<'a> = SetBoolRequest;
repeated!(
    Image,
    CompressedImage,
    CameraInfo,
    Imu,
    PointCloud2,
    StringMessage,
    TfMessage,
    PoseStamped,
    TransformStamped,
    Path,
    Odometry,
    OccupancyGrid,
    MarkerArray,
    DiagnosticArray,
    RosgraphLog,
    Log,
    ParameterEvent,
    Detection3DArray,
    GetParametersRequest,
    GetParametersResponse,
    GetParameterTypesRequest,
    GetParameterTypesResponse,
    SetParametersRequest,
    SetParametersResponse,
    SetParametersAtomicallyRequest,
    SetParametersAtomicallyResponse,
    DescribeParametersRequest,
    DescribeParametersResponse,
    ListParametersRequest,
    ListParametersResponse,
    EmptyHalf,
    TriggerResponse,
    SetBoolHalf,
    SetBoolResponse,
);
