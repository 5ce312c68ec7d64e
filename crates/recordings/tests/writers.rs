//! Small recordings, written record by record as the formats are specified.

use stillpoint_ros_messages::*;

pub(crate) struct Sent {
    pub(crate) topic: String,
    pub(crate) type_name: &'static str,
    /// ns.
    pub(crate) time: u64,
    pub(crate) ros1: Vec<u8>,
    pub(crate) cdr: Vec<u8>,
}

pub(crate) fn sent<'a, T: Message + Wire<'a>>(topic: &str, time: u64, message: &T) -> Sent {
    Sent {
        topic: topic.to_owned(),
        type_name: T::NAME,
        time,
        ros1: to_bytes(message, Format::Ros1),
        cdr: to_bytes(message, Format::CdrLittleEndian),
    }
}

pub(crate) const WIDTH: u32 = 32;
pub(crate) const HEIGHT: u32 = 24;

/// Depth of frame `k` at a pixel, mm, and its grey value.
pub(crate) fn depth_mm(k: usize, x: u32, y: u32) -> u16 {
    (1000 + 10 * k as u32 + 3 * x + y) as u16
}

pub(crate) fn grey(k: usize, x: u32, y: u32) -> u8 {
    // Incompressible noise.
    let n = (x + WIDTH * (y + HEIGHT * k as u32) + 1).wrapping_mul(0x9e37_79b9);
    ((n ^ (n >> 15)).wrapping_mul(0x85eb_ca6b) >> 24) as u8
}

/// `frames` frames of a camera at 30 Hz below a namespace.
pub(crate) fn camera(space: &str, frames: usize) -> Vec<Sent> {
    stamped_camera(space, frames, arrived)
}

pub(crate) fn arrived(k: usize) -> u64 {
    5_000_000_000 + k as u64 * 33_333_333
}

/// With the given header stamps, ns.
pub(crate) fn stamped_camera(space: &str, frames: usize, stamp: fn(usize) -> u64) -> Vec<Sent> {
    let mut all = Vec::new();
    let pixels = || (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    for k in 0..frames {
        let time = stamp(k);
        let stamp = Time {
            sec: (time / 1_000_000_000) as i64,
            nanosec: (time % 1_000_000_000) as u32,
        };
        let header = Header {
            seq: k as u32,
            stamp,
            frame_id: format!("{}_optical", space.trim_matches('/')).into(),
        };
        let info = CameraInfo {
            header: header.clone(),
            height: HEIGHT,
            width: WIDTH,
            distortion_model: "plumb_bob".into(),
            d: vec![0.0; 5],
            k: [30.0, 0.0, 15.5, 0.0, 30.0, 11.5, 0.0, 0.0, 1.0],
            ..CameraInfo::default()
        };
        let image = |encoding: &'static str, bytes: u32, data: Vec<u8>| Image {
            header: header.clone(),
            height: HEIGHT,
            width: WIDTH,
            encoding: encoding.into(),
            is_bigendian: 0,
            step: bytes * WIDTH,
            data: data.into(),
        };
        let rgb = pixels().flat_map(|(x, y)| [grey(k, x, y); 3]).collect();
        let mm = pixels().flat_map(|(x, y)| depth_mm(k, x, y).to_le_bytes());
        let arrival = arrived(k) + 2_000_000;
        all.push(sent(
            &format!("{space}/color/image_raw"),
            arrival,
            &image("rgb8", 3, rgb),
        ));
        all.push(sent(&format!("{space}/color/camera_info"), arrival, &info));
        let topic = format!("{space}/aligned_depth_to_color/image_raw");
        all.push(sent(&topic, arrival, &image("16UC1", 2, mm.collect())));
    }
    all
}

pub(crate) fn odometry(frames: usize) -> Vec<Sent> {
    stamped_odometry(frames, arrived)
}

/// With the given stamps, ns, which are also the times of arrival.
pub(crate) fn stamped_odometry(frames: usize, stamp: impl Fn(usize) -> u64) -> Vec<Sent> {
    let one = |k: usize| {
        let time = stamp(k);
        let mut m = Odometry::default();
        m.header.stamp.sec = (time / 1_000_000_000) as i64;
        m.header.stamp.nanosec = (time % 1_000_000_000) as u32;
        m.child_frame_id = "base".into();
        m.pose.pose.position.x = k as f64;
        m.pose.pose.orientation.w = 1.0;
        sent("/odom", time, &m)
    };
    let mut all: Vec<Sent> = (0..frames).map(one).collect();
    let mut mount = TransformStamped::default();
    mount.header.frame_id = "base".into();
    mount.child_frame_id = "camera_optical".into();
    mount.transform.translation.z = 0.5;
    mount.transform.rotation.w = 1.0;
    let transforms = vec![mount];
    all.push(sent("/tf_static", 1, &TfMessage { transforms }));
    all
}

pub(crate) fn text(to: &mut Vec<u8>, text: &str) {
    to.extend((text.len() as u32).to_le_bytes());
    to.extend(text.as_bytes());
}

pub(crate) fn record(to: &mut Vec<u8>, op: u8, body: &[u8]) {
    to.push(op);
    to.extend((body.len() as u64).to_le_bytes());
    to.extend(body);
}

fn topics(messages: &[Sent]) -> Vec<(&str, &'static str)> {
    let mut all: Vec<(&str, &str)> = Vec::new();
    for m in messages {
        if all.iter().all(|(t, _)| *t != m.topic) {
            all.push((&m.topic, m.type_name));
        }
    }
    all
}

/// MCAP without chunks, or in chunks of some messages, compressed by `lz4` on request. Neither has a summary.
pub(crate) fn mcap(messages: &[Sent], chunk: Option<(usize, bool)>) -> Vec<u8> {
    let magic = b"\x89MCAP0\r\n";
    let mut file = magic.to_vec();
    let mut body = Vec::new();
    text(&mut body, "ros2");
    text(&mut body, "test");
    record(&mut file, 1, &body);
    let topics = topics(messages);
    let mut declared = Vec::new();
    for (i, (topic, type_name)) in topics.iter().enumerate() {
        let mut body = (i as u16 + 1).to_le_bytes().to_vec();
        text(&mut body, type_name);
        text(&mut body, "ros2msg");
        text(&mut body, "");
        record(&mut declared, 3, &body);
        let mut body = (i as u16).to_le_bytes().to_vec();
        body.extend((i as u16 + 1).to_le_bytes());
        text(&mut body, topic);
        text(&mut body, "cdr");
        body.extend(0_u32.to_le_bytes());
        record(&mut declared, 4, &body);
    }
    let one = |m: &Sent| {
        let channel = topics.iter().position(|(t, _)| *t == m.topic).unwrap() as u16;
        let mut body = channel.to_le_bytes().to_vec();
        body.extend(0_u32.to_le_bytes());
        body.extend(m.time.to_le_bytes());
        body.extend(m.time.to_le_bytes());
        body.extend(&m.cdr);
        let mut out = Vec::new();
        record(&mut out, 5, &body);
        out
    };
    match chunk {
        None => {
            file.extend(declared);
            messages.iter().for_each(|m| file.extend(one(m)));
        }
        Some((size, compressed)) => {
            for part in messages.chunks(size) {
                let mut records = declared.clone();
                part.iter().for_each(|m| records.extend(one(m)));
                let mut body = vec![0; 16];
                body.extend((records.len() as u64).to_le_bytes());
                body.extend(0_u32.to_le_bytes());
                text(&mut body, if compressed { "lz4" } else { "" });
                let stored = if compressed { lz4(&records) } else { records };
                body.extend((stored.len() as u64).to_le_bytes());
                body.extend(stored);
                record(&mut file, 6, &body);
                // A record of a later version, and an attachment.
                record(&mut file, 0x80, &[1, 2, 3]);
                record(&mut file, 9, &[0; 40]);
            }
        }
    }
    record(&mut file, 15, &[0; 4]);
    record(&mut file, 2, &[0; 20]);
    file.extend(magic);
    file
}

pub(crate) fn lz4(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn bz2(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn fields(fields: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut out = Vec::new();
    for (name, value) in fields {
        out.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        out.extend(name.as_bytes());
        out.push(b'=');
        out.extend(value);
    }
    out
}

pub(crate) fn bag_record(to: &mut Vec<u8>, header: &[(&str, Vec<u8>)], data: &[u8]) {
    let header = fields(header);
    to.extend((header.len() as u32).to_le_bytes());
    to.extend(header);
    to.extend((data.len() as u32).to_le_bytes());
    to.extend(data);
}

/// A ROS 1 bag in chunks of some messages, without an index. `how`: none, lz4 or bz2.
pub(crate) fn bag(messages: &[Sent], how: &str) -> Vec<u8> {
    let mut file = b"#ROSBAG V2.0\n".to_vec();
    let op = |op: u8| ("op", vec![op]);
    let number = |n: u32| n.to_le_bytes().to_vec();
    let zero = || 0_u64.to_le_bytes().to_vec();
    let header = [
        op(3),
        ("index_pos", zero()),
        ("conn_count", number(0)),
        ("chunk_count", number(0)),
    ];
    bag_record(&mut file, &header, &[b' '; 4027]);
    let topics = topics(messages);
    for part in messages.chunks(7) {
        let mut records = Vec::new();
        for (i, (topic, type_name)) in topics.iter().enumerate() {
            let short = type_name.replace("/msg/", "/");
            let inner = fields(&[
                ("topic", topic.as_bytes().to_vec()),
                ("type", short.into_bytes()),
                ("md5sum", b"*".to_vec()),
                ("message_definition", Vec::new()),
            ]);
            let header = [
                op(7),
                ("conn", number(i as u32)),
                ("topic", topic.as_bytes().to_vec()),
            ];
            bag_record(&mut records, &header, &inner);
        }
        for m in part {
            let conn = topics.iter().position(|(t, _)| *t == m.topic).unwrap() as u32;
            let mut time = number((m.time / 1_000_000_000) as u32);
            time.extend(number((m.time % 1_000_000_000) as u32));
            bag_record(
                &mut records,
                &[op(2), ("conn", number(conn)), ("time", time)],
                &m.ros1,
            );
        }
        let stored = match how {
            "lz4" => lz4(&records),
            "bz2" => bz2(&records),
            _ => records.clone(),
        };
        let header = [
            op(5),
            ("compression", how.as_bytes().to_vec()),
            ("size", number(records.len() as u32)),
        ];
        bag_record(&mut file, &header, &stored);
    }
    file
}
