//! ROS names of types, and the texts of their definitions, which recordings store beside the messages.

use std::borrow::Cow;

use crate::messages::{Duration, Time};

/// A generation of ROS: definitions and names of types differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// ROS 1.
    Ros1,
    /// ROS 2.
    Ros2,
}

/// Name and fields of a nested message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Section {
    /// `std_msgs/Header`.
    pub name: String,
    /// Lines of type and name.
    pub fields: String,
}

/// A type that definitions can name.
pub trait Described {
    /// `float64`, `uint8[]`, `std_msgs/Header`.
    fn type_text(version: Version) -> String;

    /// Adds the messages contained in one of this type, itself first, each once. Nothing for primitive types.
    fn sections(version: Version, to: &mut Vec<Section>);
}

/// A top-level message, on a topic or as half of a service.
pub trait Message: Described {
    /// `sensor_msgs/msg/Image`.
    const NAME: &'static str;
    /// MD5 sum of the definition in ROS 1; empty for types that ROS 1 does not have, or that only occur within others.
    const ROS1_MD5: &'static str;
}

/// The type's name in recordings: `sensor_msgs/msg/Image` in ROS 2, `sensor_msgs/Image` in ROS 1.
#[must_use]
pub fn type_name<T: Message>(version: Version) -> String {
    match version {
        Version::Ros2 => T::NAME.to_owned(),
        Version::Ros1 => short_name(T::NAME),
    }
}

/// The definition with all nested ones, in the format of bags and of MCAP's schema `ros2msg`. Constants are omitted: no reader of a
/// recording needs them, and the sums of ROS 1, which do, are [`Message::ROS1_MD5`].
#[must_use]
pub fn definition<T: Message>(version: Version) -> String {
    let mut sections = Vec::new();
    T::sections(version, &mut sections);
    let mut text = String::new();
    for (i, section) in sections.iter().enumerate() {
        if i > 0 {
            text += &"=".repeat(80);
            text += &format!("\nMSG: {}\n", section.name);
        }
        text += &section.fields;
    }
    text
}

/// Without the folder of the package: `sensor_msgs/Image`.
pub(crate) fn short_name(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}

macro_rules! primitive {
    ($($type:ty => $text:literal),*) => {$(
        impl Described for $type {
            fn type_text(_: Version) -> String {
                $text.to_owned()
            }
            fn sections(_: Version, _: &mut Vec<Section>) {}
        }
    )*};
}
primitive! {
    bool => "bool", u8 => "uint8", i8 => "int8", u16 => "uint16", i16 => "int16", u32 => "uint32", i32 => "int32",
    u64 => "uint64", i64 => "int64", f32 => "float32", f64 => "float64", Cow<'_, str> => "string", Cow<'_, [u8]> => "uint8[]"
}

impl<T: Described> Described for Vec<T> {
    fn type_text(version: Version) -> String {
        format!("{}[]", T::type_text(version))
    }

    fn sections(version: Version, to: &mut Vec<Section>) {
        T::sections(version, to);
    }
}

impl<T: Described, const N: usize> Described for [T; N] {
    fn type_text(version: Version) -> String {
        format!("{}[{N}]", T::type_text(version))
    }

    fn sections(version: Version, to: &mut Vec<Section>) {
        T::sections(version, to);
    }
}

/// Times are primitive in ROS 1 and messages in ROS 2.
macro_rules! time {
    ($type:ty, $ros1:literal, $ros2:literal) => {
        impl Described for $type {
            fn type_text(version: Version) -> String {
                match version {
                    Version::Ros1 => $ros1.to_owned(),
                    Version::Ros2 => $ros2.to_owned(),
                }
            }
            fn sections(version: Version, to: &mut Vec<Section>) {
                if version == Version::Ros2 && to.iter().all(|s| s.name != $ros2) {
                    let (name, fields) =
                        ($ros2.to_owned(), "int32 sec\nuint32 nanosec\n".to_owned());
                    to.push(Section { name, fields });
                }
            }
        }
    };
}
time!(Time, "time", "builtin_interfaces/Time");
time!(Duration, "duration", "builtin_interfaces/Duration");
