//! Diagnostics and logs of nodes.

use super::{Header, Time};
use std::borrow::Cow;

messages! {
    KeyValue<'a> "diagnostic_msgs/msg/KeyValue" { key: Cow<'a, str>, value: Cow<'a, str>, }
    /// Levels: 0 ok, 1 a warning, 2 an error, 3 stale.
    DiagnosticStatus<'a> "diagnostic_msgs/msg/DiagnosticStatus" {
        level: u8 = "byte",
        name: Cow<'a, str>,
        message: Cow<'a, str>,
        hardware_id: Cow<'a, str>,
        values: Vec<KeyValue<'a>>,
    }
    DiagnosticArray<'a> "diagnostic_msgs/msg/DiagnosticArray" "60810da900de1dd6ddd437c3503511da" {
        header: Header<'a>,
        status: Vec<DiagnosticStatus<'a>>,
    }
    /// Of ROS 2. Levels: 10, 20, 30, 40, 50 from debug to fatal.
    Log<'a> "rcl_interfaces/msg/Log" {
        stamp: Time,
        level: u8,
        name: Cow<'a, str>,
        msg: Cow<'a, str>,
        file: Cow<'a, str>,
        function: Cow<'a, str>,
        line: u32,
    }
    /// Of ROS 1. Levels: 1, 2, 4, 8, 16 from debug to fatal.
    RosgraphLog<'a> "rosgraph_msgs/msg/Log" "acffd30cd6b6de30f120938c17c593fb" {
        header: Header<'a>,
        level: u8 = "byte",
        name: Cow<'a, str>,
        msg: Cow<'a, str>,
        file: Cow<'a, str>,
        function: Cow<'a, str>,
        line: u32,
        topics: Vec<Cow<'a, str>>,
    }
}
