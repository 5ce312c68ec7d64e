//! The description of a run in its log.

use crate::parameters::to_table;
use crate::run::Plan;
use serde::Serialize;
use std::path::PathBuf;
use stillpoint::slam::{Config, MapUse};

/// Facts that a replay needs; the command line reads them.
#[derive(Serialize)]
struct About {
    stillpoint: &'static str,
    color_topic: String,
    depth_topic: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    imu_topic: Option<String>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    no_imu: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    odometry_topic: Option<String>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    no_odometry: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    depth_scale: Option<f64>,
    start: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    load_map: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    localize: Option<PathBuf>,
    config: toml::Table,
}

pub(crate) fn about(plan: &Plan<'_>, config: &Config) -> Result<String, String> {
    let [color_topic, depth_topic] = plan.topics.map(str::to_owned);
    let file = |wanted: MapUse| {
        let known = plan.known.as_ref().filter(|k| k.map_use == wanted)?;
        let path = known.path.as_deref()?;
        Some(path.canonicalize().unwrap_or_else(|_| path.to_owned()))
    };
    let used = |topic: Option<&str>, is_used: bool| topic.filter(|_| is_used).map(str::to_owned);
    let about = About {
        stillpoint: env!("CARGO_PKG_VERSION"),
        color_topic,
        depth_topic,
        no_imu: plan.ready.imu.is_none(),
        imu_topic: used(plan.imu_topic, plan.ready.imu.is_some()),
        no_odometry: plan.ready.wheels.is_none(),
        odometry_topic: used(plan.odometry_topic, plan.ready.wheels.is_some()),
        depth_scale: plan.options.depth_scale,
        start: 0,
        load_map: file(MapUse::Grow),
        localize: file(MapUse::Localize),
        config: to_table(config),
    };
    toml::to_string(&about).map_err(|e| format!("the run cannot be described as TOML: {e}"))
}
