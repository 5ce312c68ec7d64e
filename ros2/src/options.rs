//! Parameters of the node itself; parameters of the system have the names of its configuration.

use crate::parameters::Parameters;
use crate::value::Value;

/// When a changed parameter takes effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    /// Immediately.
    AtOnce,
    /// At the start of the next run: after a reset, a loaded map or a change of mode.
    NextRun,
    /// Only at the start of the node.
    AtStart,
}

/// A parameter of the node.
#[derive(Clone, Copy, Debug)]
pub struct Described {
    /// Name.
    pub name: &'static str,
    /// Default value, as YAML.
    pub default: &'static str,
    /// When changes take effect.
    pub counts: Counts,
    /// Description.
    pub text: &'static str,
}

const fn described(
    name: &'static str,
    default: &'static str,
    counts: Counts,
    text: &'static str,
) -> Described {
    Described {
        name,
        default,
        counts,
        text,
    }
}

use Counts::{AtOnce, AtStart, NextRun};

/// All parameters of the node.
pub const ALL: &[Described] = &[
    described(
        "map_frame",
        "map",
        NextRun,
        "Frame of the map: it is corrected, and may jump.",
    ),
    described(
        "odom_frame",
        "odom",
        NextRun,
        "Frame of the odometry: it never jumps.",
    ),
    described(
        "base_frame",
        "base_link",
        NextRun,
        "Frame of the robot. Where it stands to the camera is read from /tf_static; where nothing is said of it, the camera's own body takes its place.",
    ),
    described(
        "base_frame_timeout",
        "1.0",
        NextRun,
        "Time to wait for that, s, once somebody publishes on /tf_static. Poses of that time are published afterwards.",
    ),
    described(
        "publish_tf",
        "true",
        NextRun,
        "Whether map -> odom -> base is published on /tf.",
    ),
    described("color_transport", "raw", AtStart, "raw or compressed."),
    described(
        "depth_transport",
        "raw",
        AtStart,
        "raw, compressedDepth or compressed.",
    ),
    described(
        "reliability",
        "best_effort",
        AtStart,
        "Of the images: best_effort takes what arrives; reliable asks again for what was lost, and only of publishers that are reliable.",
    ),
    described(
        "subscribe_odometry",
        "false",
        AtStart,
        "Whether wheel_odometry (of the robot's wheels, never what this node publishes) is used. Where the camera stands on its base is read from /tf_static.",
    ),
    described(
        "subscribe_imu",
        "false",
        AtStart,
        "Whether camera/imu (angular rates and forces) is used. Where the sensor stands to the camera is read from /tf_static.",
    ),
    described(
        "max_dt",
        "0.02",
        NextRun,
        "Largest difference between the stamps of a colour and a depth image of one frame, s.",
    ),
    described(
        "depth_scale",
        "0.0",
        NextRun,
        "Depth values per metre; 0 for 1000.",
    ),
    described(
        "frames",
        "newest",
        NextRun,
        "newest: a frame that comes while tracking is busy gives way to the next; all: it waits, and poses may come late.",
    ),
    described(
        "model",
        "none",
        NextRun,
        "none, or the file of a model (ONNX) that looks at the frames.",
    ),
    described(
        "map_file",
        "stillpoint.spmap",
        AtOnce,
        "Where save_map and load_map look.",
    ),
    described("load_map", "", AtStart, "A map to begin with."),
    described(
        "localize_only",
        "false",
        NextRun,
        "Whether a map that is loaded stays as it is.",
    ),
    described(
        "record",
        "",
        NextRun,
        "A file (MCAP) for what is received and what is found.",
    ),
    described(
        "record_images",
        "true",
        NextRun,
        "Whether images are among it.",
    ),
    described(
        "log",
        "",
        NextRun,
        "A file for the log of the run, with which `stillpoint replay` repeats it on the recording.",
    ),
    described(
        "pictures",
        "true",
        NextRun,
        "Whether ~/image/compressed and ~/mask are drawn while somebody subscribes to them.",
    ),
    described(
        "dense",
        "false",
        NextRun,
        "Whether surface and floor plan are fused.",
    ),
    described(
        "dense_voxel",
        "0.02",
        NextRun,
        "Distance between its voxels, m.",
    ),
    described(
        "dense_period",
        "2.0",
        NextRun,
        "Time between two floor plans, and between two surfaces, s.",
    ),
    described(
        "surface_spacing",
        "0.05",
        NextRun,
        "Distance between points of the surface that is published, m.",
    ),
    described(
        "use_sim_time",
        "false",
        AtOnce,
        "Of no effect: all times are those of the images.",
    ),
];

/// Values of the parameters for a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Frame of the map; for this and all others see [`ALL`].
    pub map_frame: String,
    /// Frame of the odometry.
    pub odom_frame: String,
    /// Frame of the robot.
    pub base_frame: String,
    /// Time to wait for it, s.
    pub base_frame_timeout: f64,
    /// Whether transforms are published.
    pub publish_tf: bool,
    /// Transport of colour images.
    pub color_transport: String,
    /// Transport of depth images.
    pub depth_transport: String,
    /// Whether lost packets are retransmitted.
    pub reliable: bool,
    /// Whether wheel odometry is used.
    pub subscribe_odometry: bool,
    /// Whether the inertial sensor is used.
    pub subscribe_imu: bool,
    /// Maximum time difference of paired images, s.
    pub max_dt: f64,
    /// Values per metre, if given.
    pub depth_scale: Option<f64>,
    /// Whether late frames are dropped.
    pub drop_late: bool,
    /// File of the detector's model.
    pub model: Option<String>,
    /// The initial map.
    pub load_map: Option<String>,
    /// Whether loaded maps stay unchanged.
    pub localize_only: bool,
    /// The recording's file.
    pub record: Option<String>,
    /// Whether images are recorded.
    pub record_images: bool,
    /// The log's file.
    pub log: Option<String>,
    /// Whether pictures are drawn.
    pub pictures: bool,
    /// Whether surfaces are fused.
    pub dense: bool,
    /// Voxel size, m.
    pub dense_voxel: f64,
    /// Publication interval of surfaces, s.
    pub dense_period: f64,
    /// Spacing of published surface points, m.
    pub surface_spacing: f64,
}

impl Options {
    /// Checks the parameters.
    ///
    /// # Errors
    /// The first invalid value.
    pub fn new(of: &Parameters) -> Result<Self, String> {
        let text = |name: &str| match of.get(name) {
            Some(Value::Text(text)) => text.clone(),
            _ => String::new(),
        };
        let named = |name: &str| Some(text(name)).filter(|t| !t.is_empty() && t != "none");
        let is = |name: &str| of.get(name) == Some(&Value::Bool(true));
        let number = |name: &str| of.get(name).and_then(Value::double).unwrap_or(0.0);
        let within = |name: &str, low: f64, high: f64| {
            let x = number(name);
            if (low..=high).contains(&x) {
                return Ok(x);
            }
            Err(format!("{name}: expected {low} to {high}, found {x}"))
        };
        let one_of = |name: &str, words: &[&str]| {
            let found = text(name);
            if words.contains(&found.as_str()) {
                return Ok(found);
            }
            Err(format!(
                "{name}: expected {}, found \"{found}\"",
                words.join(" or ")
            ))
        };
        let frame = |name: &str| {
            let found = text(name).trim_start_matches('/').to_owned();
            if found.is_empty() {
                return Err(format!("{name}: expected the name of a frame, found none"));
            }
            Ok(found)
        };
        let scale = within("depth_scale", 0.0, 1e6)?;
        Ok(Self {
            map_frame: frame("map_frame")?,
            odom_frame: frame("odom_frame")?,
            base_frame: frame("base_frame")?,
            base_frame_timeout: within("base_frame_timeout", 0.0, 600.0)?,
            publish_tf: is("publish_tf"),
            color_transport: one_of("color_transport", &["raw", "compressed"])?,
            depth_transport: one_of("depth_transport", &["raw", "compressedDepth", "compressed"])?,
            reliable: one_of("reliability", &["best_effort", "reliable"])? == "reliable",
            subscribe_odometry: is("subscribe_odometry"),
            subscribe_imu: is("subscribe_imu"),
            max_dt: within("max_dt", 1e-6, 1.0)?,
            depth_scale: (scale > 0.0).then_some(scale),
            drop_late: one_of("frames", &["newest", "all"])? == "newest",
            model: named("model"),
            load_map: named("load_map"),
            localize_only: is("localize_only"),
            record: named("record"),
            record_images: is("record_images"),
            log: named("log"),
            pictures: is("pictures"),
            dense: is("dense"),
            dense_voxel: within("dense_voxel", 0.002, 0.5)?,
            dense_period: within("dense_period", 0.1, 3600.0)?,
            surface_spacing: within("surface_spacing", 0.005, 10.0)?,
        })
    }
}
