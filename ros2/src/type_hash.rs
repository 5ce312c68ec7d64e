//! Hashes that identify versions of a type in ROS 2: RIHS01 of REP-2011 and REP-2016, SHA-256 of a description in JSON.

use crate::services;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use stillpoint::ros_events::Topic;
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Described, Message, Section, Version};

#[derive(Clone, Debug)]
struct Field {
    name: String,
    type_id: u32,
    capacity: u32,
    nested: String,
}

#[derive(Clone, Debug)]
struct Type {
    name: String,
    fields: Vec<Field>,
}

/// Offsets of type numbers for arrays, and for bounded and unbounded sequences.
const ARRAY: u32 = 48;
const BOUNDED: u32 = 96;
const UNBOUNDED: u32 = 144;
const NESTED: u32 = 1;

/// The hash of a message: `RIHS01_` and 64 hexadecimal digits.
#[must_use]
pub fn of_message<T: Message>() -> String {
    hash(T::NAME, types::<T>())
}

/// The hash of a service, from its name and its two messages.
#[must_use]
pub fn of_service<Q: Message, A: Message>(name: &str) -> String {
    let mut all = types::<Q>();
    all.extend(types::<A>());
    let nested = |field: &str, name: String| Field {
        name: field.to_owned(),
        type_id: NESTED,
        capacity: 0,
        nested: name,
    };
    let at_most_one = |field: &str, name: String| Field {
        type_id: NESTED + BOUNDED,
        capacity: 1,
        ..nested(field, name)
    };
    let plain = |field: &str, type_id: u32, capacity: u32| Field {
        name: field.to_owned(),
        type_id,
        capacity,
        nested: String::new(),
    };
    let info = "service_msgs/msg/ServiceEventInfo";
    let time = "builtin_interfaces/msg/Time";
    let [request, answer, event] =
        ["_Request", "_Response", "_Event"].map(|half| format!("{name}{half}"));
    all.push(Type {
        name: name.to_owned(),
        fields: vec![
            nested("request_message", request.clone()),
            nested("response_message", answer.clone()),
            nested("event_message", event.clone()),
        ],
    });
    all.push(Type {
        name: event,
        fields: vec![
            nested("info", info.to_owned()),
            at_most_one("request", request),
            at_most_one("response", answer),
        ],
    });
    all.push(Type {
        name: info.to_owned(),
        fields: vec![
            plain("event_type", 3, 0),
            nested("stamp", time.to_owned()),
            plain("client_gid", 3 + ARRAY, 16),
            plain("sequence_number", 8, 0),
        ],
    });
    all.push(Type {
        name: time.to_owned(),
        fields: vec![plain("sec", 6, 0), plain("nanosec", 7, 0)],
    });
    hash(name, all)
}

/// Of the service, its requests and its answers.
pub(crate) fn of_halves<Q: Message, A: Message>(name: &str) -> [String; 3] {
    [
        of_service::<Q, A>(name),
        of_message::<Q>(),
        of_message::<A>(),
    ]
}

fn types<T: Described>() -> Vec<Type> {
    let mut sections = Vec::new();
    T::sections(Version::Ros2, &mut sections);
    sections.iter().map(read).collect()
}

/// The full name: `std_msgs/Header` is `std_msgs/msg/Header`.
fn whole(name: &str) -> String {
    match name.matches('/').count() {
        1 => name.replacen('/', "/msg/", 1),
        _ => name.to_owned(),
    }
}

fn read(section: &Section) -> Type {
    let mut fields: Vec<Field> = section
        .fields
        .lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(type_text, name)| field(type_text, name))
        .collect();
    if fields.is_empty() {
        // For languages without empty structs.
        fields.push(field("uint8", "structure_needs_at_least_one_member"));
    }
    Type {
        name: whole(&section.name),
        fields,
    }
}

/// `float64[36] covariance`.
fn field(type_text: &str, name: &str) -> Field {
    let (base, bounds) = match type_text.split_once('[') {
        Some((base, rest)) => (base, Some(rest.trim_end_matches(']'))),
        None => (type_text, None),
    };
    let number = match base {
        "int8" => 2,
        "uint8" => 3,
        "int16" => 4,
        "uint16" => 5,
        "int32" => 6,
        "uint32" => 7,
        "int64" => 8,
        "uint64" => 9,
        "float32" => 10,
        "float64" => 11,
        "bool" => 15,
        "byte" => 16,
        "string" => 17,
        _ => NESTED,
    };
    let (more, capacity) = match bounds {
        None => (0, 0),
        Some("") => (UNBOUNDED, 0),
        Some(text) => match text.strip_prefix("<=") {
            Some(most) => (BOUNDED, most.parse().unwrap_or(0)),
            None => (ARRAY, text.parse().unwrap_or(0)),
        },
    };
    Field {
        name: name.to_owned(),
        type_id: number + more,
        capacity,
        nested: if number == NESTED {
            whole(base)
        } else {
            String::new()
        },
    }
}

fn json(of: &Type) -> String {
    let fields: Vec<String> = of
        .fields
        .iter()
        .map(|f| {
            format!(
                "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {}, \"string_capacity\": 0, \"nested_type_name\": \"{}\"}}}}",
                f.name, f.type_id, f.capacity, f.nested
            )
        })
        .collect();
    format!(
        "{{\"type_name\": \"{}\", \"fields\": [{}]}}",
        of.name,
        fields.join(", ")
    )
}

fn hash(name: &str, mut all: Vec<Type>) -> String {
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all.dedup_by(|a, b| a.name == b.name);
    let own = all.iter().find(|t| t.name == name).map(json);
    let others: Vec<String> = all.iter().filter(|t| t.name != name).map(json).collect();
    let text = format!(
        "{{\"type_description\": {}, \"referenced_type_descriptions\": [{}]}}",
        own.unwrap_or_default(),
        others.join(", ")
    );
    let digest = Sha256::digest(text.as_bytes());
    let digits: String = digest.iter().map(|b| format!("{b:02x}")).collect();
    format!("RIHS01_{digits}")
}

/// All published, subscribed and served types, with their hashes.
#[must_use]
pub fn all() -> Vec<(&'static str, String)> {
    let mut all: Vec<(&'static str, String)> = Topic::ALL
        .iter()
        .map(|topic| (topic.type_name(), of_topic(*topic)))
        .collect();
    all.push((ros::Log::NAME, of_message::<ros::Log<'_>>()));
    all.push((ros::Imu::NAME, of_message::<ros::Imu<'_>>()));
    all.push((
        ros::ParameterEvent::NAME,
        of_message::<ros::ParameterEvent<'_>>(),
    ));
    let services = services::hashes().into_iter();
    all.extend(services.map(|(name, [service, ..])| (name, service)));
    all.sort();
    all.dedup();
    all
}

/// The hashes of all topic types by name, including those of services.
#[must_use]
pub fn of_topics() -> BTreeMap<String, String> {
    let mut all: BTreeMap<String, String> = all()
        .into_iter()
        .map(|(name, hash)| (name.to_owned(), hash))
        .collect();
    for (name, [_, request, answer]) in services::hashes() {
        all.remove(name);
        all.insert(format!("{name}_Request"), request);
        all.insert(format!("{name}_Response"), answer);
    }
    all
}

fn of_topic(topic: Topic) -> String {
    match topic {
        Topic::TfStatic | Topic::Tf => of_message::<ros::TfMessage<'_>>(),
        Topic::Odometry => of_message::<ros::Odometry<'_>>(),
        Topic::Path => of_message::<ros::Path<'_>>(),
        Topic::Map | Topic::Surface => of_message::<ros::PointCloud2<'_>>(),
        Topic::Objects => of_message::<ros::Detection3DArray<'_>>(),
        Topic::Markers => of_message::<ros::MarkerArray<'_>>(),
        Topic::CameraInfo => of_message::<ros::CameraInfo<'_>>(),
        Topic::Image => of_message::<ros::CompressedImage<'_>>(),
        Topic::Mask => of_message::<ros::Image<'_>>(),
        Topic::Grid => of_message::<ros::OccupancyGrid<'_>>(),
        Topic::Diagnostics => of_message::<ros::DiagnosticArray<'_>>(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_hashes_match_ros_jazzy() {
        // Of ROS 2 Jazzy, from PyPI's ros2_pyterfaces; tools/ros2/check_hashes.py compares all.
        let expected = [
            (
                "std_srvs/srv/Trigger",
                "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
            ),
            (
                "sensor_msgs/msg/Image",
                "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
            ),
            (
                "sensor_msgs/msg/Imu",
                "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
            ),
            (
                "nav_msgs/msg/Odometry",
                "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
            ),
            (
                "rcl_interfaces/srv/GetParameters",
                "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
            ),
            (
                "visualization_msgs/msg/MarkerArray",
                "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
            ),
            (
                "diagnostic_msgs/msg/DiagnosticArray",
                "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
            ),
            (
                "rcl_interfaces/srv/GetParameterTypes",
                "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
            ),
            (
                "rcl_interfaces/srv/SetParameters",
                "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
            ),
            (
                "rcl_interfaces/srv/ListParameters",
                "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
            ),
            (
                "rcl_interfaces/srv/SetParametersAtomically",
                "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
            ),
            (
                "rcl_interfaces/msg/ParameterEvent",
                "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
            ),
        ];
        let all = all();
        for (name, hash) in expected {
            let found = all.iter().find(|(n, _)| *n == name);
            assert_eq!(found.map(|(_, h)| h.as_str()), Some(hash), "{name}");
        }
    }

    #[test]
    fn every_type_has_a_hash() {
        let all = all();
        assert!(all.len() >= 20);
        for (name, hash) in all {
            assert_eq!(hash.len(), 71, "{name}");
        }
    }
}
