//! Serialisation of ROS messages.
//!
//! Reads ([`from_bytes`]) and writes ([`to_bytes`]) messages in the CDR of ROS 2 (XCDR version 1, of both byte orders, with its
//! encapsulation header) and in the serialisation of ROS 1. Large fields borrow from the bytes. Does not know files, topics or encodings of
//! images, and does not parse message definitions: each type has the fields of its definition, in order, and provides the text of that
//! definition ([`definition`]) for programs that write recordings.
//!
//! Bytes are not trusted: every length is compared with the remaining bytes before any allocation, so memory use is proportional to the
//! input.
//!
//! ```
//! use stillpoint_ros_messages::{Format, Header, Image, Time, from_bytes, to_bytes};
//!
//! let header = Header { seq: 0, stamp: Time { sec: 12, nanosec: 5 }, frame_id: "camera".into() };
//! let data = vec![7_u8; 6].into();
//! let image = Image { header, height: 1, width: 2, encoding: "rgb8".into(), is_bigendian: 0, step: 6, data };
//! let bytes = to_bytes(&image, Format::CdrLittleEndian);
//! assert_eq!(from_bytes::<Image>(&bytes, Format::CdrLittleEndian)?, image);
//! # Ok::<(), stillpoint_ros_messages::WireError>(())
//! ```

mod describe;
mod messages;
mod wire;

pub use describe::{Described, Message, Section, Version, definition, type_name};
pub use messages::*;
pub use wire::{Format, Reader, Wire, WireError, Writer, from_bytes, to_bytes};
