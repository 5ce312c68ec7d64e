//! Health as diagnostics.

use std::borrow::Cow;
use stillpoint_ros_messages as ros;
use stillpoint_slam::{FrameEvent, Outcome};

const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;
/// Below this quality a pose is reported as a warning.
const POOR: f64 = 0.3;

pub(crate) fn message<'a>(frame: &FrameEvent, header: ros::Header<'a>) -> ros::DiagnosticArray<'a> {
    let (report, health) = (&frame.report, &frame.health);
    let quality = health.quality.value();
    let begins = report.outcome == Outcome::Initialised;
    let level = match () {
        () if health.loss.is_some() => ERROR,
        () if health.undecided || (quality < POOR && !begins) => WARN,
        () => OK,
    };
    let number = |x: f64| format!("{x:.6}");
    let optional = |x: Option<f64>| x.map_or_else(|| "unknown".to_owned(), number);
    let c = &report.counts;
    let values: [(&'static str, String); 13] = [
        ("frame", report.frame.to_string()),
        ("quality", number(quality)),
        ("position_sigma_m", optional(health.sigma_m())),
        ("direction_sigma_rad", optional(health.sigma_rad())),
        ("static_share", number(health.static_share)),
        ("dynamic_share", number(health.dynamic_share)),
        ("depth_share", number(health.depth_share)),
        ("detections_age_s", optional(health.detections_age)),
        ("map_age_s", optional(health.map_age)),
        ("undecided", health.undecided.to_string()),
        ("inliers", c.inliers.to_string()),
        ("keypoints", c.keypoints.to_string()),
        ("map_version", report.map_version.to_string()),
    ];
    let values = values.map(|(key, value)| ros::KeyValue {
        key: Cow::Borrowed(key),
        value: value.into(),
    });
    ros::DiagnosticArray {
        header,
        status: vec![ros::DiagnosticStatus {
            level,
            name: "stillpoint: tracking".into(),
            message: health.to_string().into(),
            hardware_id: "".into(),
            values: values.into(),
        }],
    }
}
